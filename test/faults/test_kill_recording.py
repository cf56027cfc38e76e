"""A recording that is killed at any instant keeps all that was flushed, and is recovered."""

from __future__ import annotations

from pathlib import Path

from benchmarks.faults.recording_kill import recording_kill
from benchmarks.faults.trial import MOST_LOST_S


def test_a_recording_killed_at_any_call_keeps_what_was_flushed(tmp_path: Path) -> None:
    trials = []
    while not trials or trials[-1].fault:
        folder = tmp_path / str(len(trials))
        folder.mkdir()
        trials.append(recording_kill(len(trials), folder))
    assert [(one.fault, one.failures()) for one in trials if one.failures()] == []
    assert len(trials) > 80
    assert 0.0 < max(one.lost_s for one in trials) < MOST_LOST_S
