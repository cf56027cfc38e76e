"""Failing disks, vanishing files and altered parts: told, and never believed."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.faults.disk import FAULTS as DISK_FAULTS
from benchmarks.faults.disk import disk
from benchmarks.faults.parts import sweep_parts
from benchmarks.faults.trial import Campaign, Trial
from benchmarks.faults.vanish import FAULTS as VANISH_FAULTS
from benchmarks.faults.vanish import vanish


def tried(campaign: Campaign, seeds: range, folder: Path) -> list[Trial]:
    """Trials of the seeds, none of which broke a promise."""
    trials = []
    for seed in seeds:
        (folder / str(seed)).mkdir()
        trials.append(campaign(seed, folder / str(seed)))
    assert [(one.fault, one.failures()) for one in trials if one.failures()] == []
    return trials


@pytest.mark.parametrize("kind", range(len(DISK_FAULTS)), ids=DISK_FAULTS)
def test_what_a_failing_disk_took_is_readable_and_told(tmp_path: Path, kind: int) -> None:
    kinds = len(DISK_FAULTS)
    assert len(tried(disk, range(kind, 25 * kinds, kinds), tmp_path)) == 25


@pytest.mark.parametrize(
    "kind", range(len(VANISH_FAULTS)), ids=[fault.__name__ for fault in VANISH_FAULTS]
)
def test_a_file_that_vanishes_is_told_by_the_next_flush(tmp_path: Path, kind: int) -> None:
    kinds = len(VANISH_FAULTS)
    assert len(tried(vanish, range(kind, 6 * kinds, kinds), tmp_path)) == 6


def test_no_altered_part_is_believed(tmp_path: Path) -> None:
    assert len(tried(sweep_parts, range(300), tmp_path)) == 300
