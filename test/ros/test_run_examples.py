"""The examples of helps that begin with a run of the node, as a user pastes them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from help_support import commands_in, example_of, help_of
from support import wait_until


def test_examples_with_a_run_work(
    domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = {
        verb: commands_in(example_of(help_of(verb, capsys)))
        for verb in ("info", "replay", "analyze", "recover")
    }
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    records = {tuple(words[0]) for words in shown.values()}
    assert len(records) == 1
    (record,) = records
    command = [sys.executable, "-m", *record]
    file = tmp_path / "runs" / "first" / "first_0.mcap"
    with subprocess.Popen(command, cwd=tmp_path, env=environment) as node:
        try:  # the kernel may have to be compiled first
            wait_until(lambda: file.exists() and file.stat().st_size > 5_000_000, 300.0)
            node.send_signal(signal.SIGINT)
            assert node.wait(60.0) == 0
        finally:
            node.kill()
    for words in (words for examples in shown.values() for words in examples[1:]):
        command = [sys.executable, "-m", *words]
        subprocess.run(command, cwd=tmp_path, env=environment, check=True, timeout=120.0)
    assert (tmp_path / "analysis" / "report.html").exists()
