"""Spoilt YAML files: no traceback, no hang, no bomb, no page of a value on the terminal."""

from __future__ import annotations

import pytest

from benchmarks.faults.yaml_files import yaml_files

FILES, AT_ONCE = 100, 25


@pytest.mark.parametrize("first", range(0, FILES, AT_ONCE))
def test_spoilt_files_break_no_promise(tmp_path, first):
    failed = []
    for seed in range(first, first + AT_ONCE):
        folder = tmp_path / str(seed)
        folder.mkdir()
        trial = yaml_files(seed, folder)
        failed += [(trial.fault, failure) for failure in trial.failures()]
    assert failed == []
