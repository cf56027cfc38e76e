"""Spoilt MCAP files: no traceback, no hang, no bomb, no value that was never written."""

from __future__ import annotations

import pytest

from benchmarks.faults.mcap_files import mcap

FILES, AT_ONCE = 200, 25


@pytest.mark.parametrize("first", range(0, FILES, AT_ONCE))
def test_spoilt_files_break_no_promise(tmp_path, first):
    failed = []
    for seed in range(first, first + AT_ONCE):
        folder = tmp_path / str(seed)
        folder.mkdir()
        trial = mcap(seed, folder)
        failed += [(trial.fault, failure) for failure in trial.failures()]
    assert failed == []
