"""Left is right, and the same input gives the same output: to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from gears import UNEVEN, make, samples
from hypothesis import given, settings
from hypothesis import strategies as st

from herringbone_sim.core.integrate import Stepper


@pytest.mark.parametrize("model", ["reduced", "full"])
def test_left_is_right_to_the_bit_in_chaos(gear, model):
    gears = gear(model=model, delta_T=20.0, K=0.02, control_phase=0.3)
    rows = samples(gears, 1500).rows
    names = gears.layout.channels
    for name in names:
        if name.endswith("_L"):
            other = names.index(f"{name[:-1]}R")
            assert np.array_equal(rows[:, names.index(name)], rows[:, other]), name


def test_left_is_right_to_the_bit_with_unequal_planets(uneven):
    half = {"k_factor": (1.0, 1.1, 0.9, 1.0, 1.1, 0.9, 0.8, 1.2, 1.0, 0.8, 1.2, 1.0)}
    alike = dict.fromkeys(("c_factor", "e_factor", "I_s_factor", "I_p_factor"), (1.0,))
    alike |= dict.fromkeys(("e_offset", "b_offset", "phi_a", "phi_b", "initial_x"), (0.0,))
    model = uneven(**half | alike, initial_noise=0.0, delta_T=20.0)
    rows = samples(model, 500).rows
    assert np.array_equal(rows[:, 5:8], rows[:, 8:11])
    assert np.array_equal(rows[:, 11:14], rows[:, 14:17])
    assert not np.allclose(rows[:, 5], rows[:, 6])


@settings(max_examples=15)
@given(cuts=st.lists(st.integers(1, 60), min_size=1, max_size=6), rk4=st.booleans())
def test_blocks_of_whatever_size_give_the_same_bits(cuts, rk4):
    model = make(**UNEVEN, K=0.1, control_order=1.5, method="rk4" if rk4 else "taylor")
    stepper = Stepper(model)
    whole = stepper.advance(stepper.start(tangents=2), sum(cuts))
    state, rows, section = stepper.start(tangents=2), [], []
    for n in cuts:
        section += list(stepper.advance(state, n).section + sum(map(len, rows)))
        block = stepper.advance(state, n)
        rows.append(block.rows)
        state = block.end
    assert np.array_equal(np.concatenate(rows), whole.rows)
    assert section == whole.section.tolist()
    assert np.array_equal(state.y, whole.end.y)
    assert np.array_equal(state.tangents, whole.end.tangents)
    assert np.array_equal(state.growth, whole.end.growth)
    assert (state.cycle, state.index, state.t) == (
        whole.end.cycle,
        whole.end.index,
        whole.end.t,
    )


def test_a_second_stepper_gives_the_same_bits(uneven):
    first, second = (samples(uneven(delta_T=20.0), 100) for _ in range(2))
    assert np.array_equal(first.rows, second.rows)
    assert first.switches == second.switches


def test_advancing_leaves_the_state_it_started_from(gear):
    stepper = Stepper(gear())
    start = stepper.start(tangents=1)
    before = (start.y.copy(), start.tangents.copy(), start.growth.copy())
    stepper.advance(start, 50)
    assert all(
        np.array_equal(a, b)
        for a, b in zip(before, (start.y, start.tangents, start.growth), strict=True)
    )
