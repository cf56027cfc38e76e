"""A recovery that is killed at any instant can be repeated, and loses nothing."""

from __future__ import annotations

import pytest

from benchmarks.faults.recovery import WAYS, recover_kill


@pytest.mark.parametrize("way", range(len(WAYS)), ids=[name for name, *_ in WAYS])
def test_a_recovery_killed_at_any_call_can_be_repeated(tmp_path, way):
    trials = []
    while not trials or trials[-1].fault:
        folder = tmp_path / str(len(trials))
        folder.mkdir()
        trials.append(recover_kill(len(WAYS) * len(trials) + way, folder))
    assert [(one.fault, one.failures()) for one in trials if one.failures()] == []
    assert len(trials) > 20
