"""Changes of live parameters, without a jump; long runs, without a drift."""

from __future__ import annotations

import numpy as np
import pytest
from gears import samples

from herringbone_sim.core.integrate import change

LIVE = [
    {"K": 0.3},
    {"delta_T": 20.0},
    {"xi": 0.2},
    {"T_1": 400.0},
    {"Omega": 1.3},
    {"control_phase": 1.0},
]


@pytest.mark.parametrize("values", LIVE, ids=str)
def test_a_live_change_keeps_displacement_and_velocity(gear, values):
    """In the middle of a cycle: the next sample has the same x and v, whatever changed."""
    old = gear(delta_T=60.0, K=0.1)
    state = samples(old, 20.3).end
    new = gear(**{"delta_T": 60.0, "K": 0.1} | values)
    before = samples(old, 0.0625, state).rows[0]
    after_change = samples(new, 0.0625, change(old, new, state)).rows[0]
    assert after_change[:2].tolist() == before[:2].tolist()
    assert after_change[5:13] == pytest.approx(before[5:13], rel=1e-12, abs=1e-16)


def test_a_change_back_and_forth_is_no_change(gear):
    old, new = gear(), gear(K=0.3)
    state = samples(old, 7.5).end
    again = change(new, old, change(old, new, state))
    assert np.array_equal(again.y, state.y)
    assert (again.cycle, again.index, again.t) == (state.cycle, state.index, state.t)


def test_samples_per_cycle_may_change_at_phase_zero(gear):
    old, new = gear(delta_T=90.0), gear(delta_T=90.0, samples_per_cycle=40)
    state = change(old, new, samples(old, 10).end)
    moved = samples(new, 5, state)
    assert np.abs(moved.end.y - samples(old, 5, samples(old, 10).end).end.y).max() < 1e-10
    assert (state.cycle, state.index, moved.end.cycle) == (10, 0, 15)


@pytest.mark.parametrize("model", ["reduced", "full"])
def test_nothing_drifts_with_the_control_on(gear, model):
    """2000 cycles under K = 0.3: the span of every displacement stays what it was."""
    block = samples(gear(model=model, K=0.3, delta_T=50.0), 2000)
    early, late = np.abs(block.rows[1600:9600, 5:]), np.abs(block.rows[-8000:, 5:])
    assert not block.diverged
    assert np.all(late.max(axis=0) < 1.5 * early.max(axis=0))
    assert np.abs(late).max(axis=0)[-1] < 3e-4
