"""What is remembered of states that were fitted to windows, and what fits learn of one another."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gap_support import practised

from herringbone_sim.diagnosis.search import CHANCE_CHI2
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.windows.memory import Failure, StateMemory
from herringbone_sim.gap.observations.windows.restarts import WindowRange
from herringbone_sim.gap.observations.windows.shooting import FittedStates


def states(chi2: float) -> FittedStates:
    """States of two windows whose components are their numbers."""
    starts = np.tile(np.arange(18.0), (2, 1))
    return FittedStates(starts, np.stack([starts, starts], axis=1), np.zeros(0), chi2)


def test_the_best_states_of_a_key_are_kept() -> None:
    memory = StateMemory()
    for chi2 in (5.0, 7.0, 4.0, 6.0):
        memory.known(("k",)).keep(states(chi2))
    assert memory.known(("k",)).chi2 == 4.0
    assert memory.known(("other",)).chi2 == np.inf


def test_a_memory_learns_what_a_copy_fitted_better() -> None:
    """Of two copies, each with a fit of its own and one that both made."""
    memory = StateMemory()
    memory.known(("known",)).keep(states(9.0))
    known = memory.known(("known",)).best
    memory.copy().known(("known",)).keep(states(1.0))  # of a copy that is forgotten
    first, second = memory.copy(), memory.copy()
    for copy, name, chi2 in ((first, "one", 5.0), (second, "two", 3.0)):
        copy.known((name,)).keep(states(chi2))
        copy.known(("both",)).keep(states(chi2))
        copy.keep_least(states(chi2))
        copy.failures.append(Failure(WindowRange(1, 2), chi2, 1))
    assert list(memory.by_key) == [("known",)]
    added = second.since(memory), first.since(memory)
    for new in added:
        assert ("known",) not in new.by_key
        memory.add(new)
    chi2 = {key: known.chi2 for (key,), known in memory.by_key.items()}
    assert chi2 == {"known": 9.0, "one": 5.0, "two": 3.0, "both": 3.0}
    assert memory.least is not None
    assert memory.least.cost == 3.0
    assert memory.failures == [Failure(WindowRange(1, 2), chi2, 1) for chi2 in (3.0, 5.0)]
    assert memory.known(("known",)).best is known


def test_what_a_copy_tried_in_vain_is_not_tried_again() -> None:
    memory = StateMemory()
    memory.known(("k",)).keep(states(5.0))
    memory.known(("k",)).anew = states(9.0)
    copy = memory.copy()
    known = copy.known(("k",))
    known.anew, known.tried_chi2, known.restarted_at_rest = None, 3.0, True
    memory.add(copy.since(memory))
    assert memory.known(("k",)) == known


def test_states_in_another_order_are_those_of_the_other_bodies() -> None:
    """What was tried from other states counts no more: they are in the old order."""
    memory = StateMemory(least=states(2.0))
    fits = memory.known(("k",))
    fits.keep(states(5.0))
    fits.anew, fits.tried_chi2 = states(4.0), 2.0
    order = np.roll(np.arange(18), 1)
    other = memory.reordered(order)
    best = other.known(("k",)).best
    assert best is not None
    np.testing.assert_array_equal(best.starts[0], order)
    assert (other.least, other.known(("k",)).anew, other.known(("k",)).tried_chi2) == (None,) * 3
    assert fits.anew is not None


@pytest.fixture(scope="module")
def gear() -> GearObservations:
    """Two runs of a healthy practice rig of which three rotations are recorded."""
    return practised(600001, "none", runs=2).gear


def test_fits_side_by_side_know_nothing_of_one_another(gear: GearObservations) -> None:
    """One fit made again and again has the same start; later ones start from its states."""
    machine = GearMachine(gear)
    change = {"trajectory": {"kappa of 0": np.full((machine.runs, 1), 0.02)}}
    key = ("kappa of 0",)

    def fitted(own: Any, _: int) -> tuple[float, float]:
        return own.gear.trajectory_of(0).memory.known(key).chi2, own.gear.states(0, change).cost

    assert gear.trajectory_of(0).memory.known(key).chi2 == np.inf
    fits = machine.fitted_in_parallel(fitted, range(5))  # more than one a process
    assert {before for before, _ in fits} == {np.inf}
    assert {after for _, after in fits} == {gear.trajectory_of(0).memory.known(key).chi2}


def test_states_of_exchanged_channels_are_remembered(gear: GearObservations) -> None:
    """Those of both suns, which move alike; the windows are made by the fit."""
    machine, swap = GearMachine(gear), "swap of u_s_L and u_s_R"
    change = {"trajectory": {swap: np.ones((machine.runs, 1))}}
    (cost,) = machine.fitted_in_parallel(lambda own, run: own.gear.states(run, change).cost, (1,))
    (known,) = gear.swapped_trajectory(1, swap).memory.by_key.values()
    assert known.chi2 == cost


def test_states_improve_where_better_ones_were_found(gear: GearObservations) -> None:
    """Between two fits under a change, those of one run were in a wrong minimum."""
    machine = GearMachine(gear)
    change = {"trajectory": {"kappa of 1": np.full((machine.runs, 1), 0.02)}}
    assert machine.states_improve(change)  # there were none
    assert not machine.states_improve(change)
    known = gear.trajectory_of(0).memory.known(("kappa of 1",))
    assert known.best is not None
    known.best = replace(known.best, cost=known.chi2 + 2.0 * CHANCE_CHI2)
    assert machine.states_improve(change)
