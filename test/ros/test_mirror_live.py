"""The mirror of a running node: slow motion, and what it says when it fails."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import Log
from support import Bench, wait_until

from herringbone_sim.views.mirror.mirror import RerunMirror


@pytest.mark.parametrize("factor", [0.001, 0.01])
def test_a_slow_node_is_mirrored(bench: Bench, tmp_path: Path, factor: float) -> None:
    """Blocks of few rows are drawn; how many may be lost while Rerun is imported, is open."""
    file = tmp_path / "run.rrd"
    node = bench.simulator(mirror="save", mirror_path=str(file), real_time_factor=factor)
    wait_until(lambda: node.loop.pace.samples > 80, 120.0)
    wait_until(
        lambda: node.mirror.state != "running" or (file.exists() and file.stat().st_size), 120.0
    )
    assert node.mirror.state == "running"


def test_what_fails_in_the_mirror_is_logged(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise ValueError("math domain error")

    monkeypatch.setattr(RerunMirror, "_mirror", fail)
    logs = bench.listen(Log, "/rosout")
    node = bench.simulator(mirror="save", mirror_path=str(tmp_path / "run.rrd"))
    wait_until(lambda: [log for log in logs if "math domain error" in log.msg])
    assert node.mirror.state == "failed: math domain error"


def test_a_mirror_path_may_begin_with_the_home_folder(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    bench.simulator(mirror="save", mirror_path="~/run.rrd", real_time_factor=0.01)
    wait_until(lambda: (tmp_path / "run.rrd").exists(), 120.0)
