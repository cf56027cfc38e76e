"""What is remembered of states that were fitted to windows, and what fits learn of one another."""

from __future__ import annotations

import numpy as np

from herringbone_sim.gap.observations.shooting import FittedStates
from herringbone_sim.gap.observations.state_memory import StateMemory
from herringbone_sim.gap.observations.window_restarts import Group


def states(chi2: float) -> FittedStates:
    """States of two windows whose components are their numbers."""
    starts = np.tile(np.arange(18.0), (2, 1))
    return FittedStates(starts, np.stack([starts, starts], axis=1), np.zeros(0), chi2)


def test_the_best_states_of_a_key_are_kept() -> None:
    memory = StateMemory()
    for chi2 in (5.0, 7.0, 4.0, 6.0):
        memory.fits(("k",)).keep(states(chi2))
    assert memory.fits(("k",)).chi2 == 4.0
    assert memory.fits(("other",)).chi2 == np.inf


def test_a_memory_learns_what_a_copy_fitted_better() -> None:
    """Of two copies, each with a fit of its own and one that both made."""
    memory = StateMemory()
    memory.fits(("known",)).keep(states(9.0))
    known = memory.fits(("known",)).best
    memory.copy().fits(("known",)).keep(states(1.0))  # of a copy that is forgotten
    first, second = memory.copy(), memory.copy()
    for copy, name, chi2 in ((first, "one", 5.0), (second, "two", 3.0)):
        copy.fits((name,)).keep(states(chi2))
        copy.fits(("both",)).keep(states(chi2))
        copy.keep_least(states(chi2))
        copy.failures.append((Group(1, 2), chi2))
    assert list(memory.of_key) == [("known",)]
    added = second.since(memory), first.since(memory)
    for new in added:
        assert ("known",) not in new.of_key
        memory.add(new)
    chi2 = {key: fits.chi2 for (key,), fits in memory.of_key.items()}
    assert chi2 == {"known": 9.0, "one": 5.0, "two": 3.0, "both": 3.0}
    assert memory.least is not None
    assert memory.least.cost == 3.0
    assert memory.failures == [(Group(1, 2), 3.0), (Group(1, 2), 5.0)]
    assert memory.fits(("known",)).best is known


def test_states_in_another_order_are_those_of_the_other_bodies() -> None:
    """What was tried from other states counts no more: they are in the old order."""
    memory = StateMemory(least=states(2.0))
    fits = memory.fits(("k",))
    fits.keep(states(5.0))
    fits.anew, fits.tried_chi2 = states(4.0), 2.0
    order = np.roll(np.arange(18), 1)
    other = memory.reordered(order)
    best = other.fits(("k",)).best
    assert best is not None
    np.testing.assert_array_equal(best.starts[0], order)
    assert (other.least, other.fits(("k",)).anew, other.fits(("k",)).tried_chi2) == (None,) * 3
    assert fits.anew is not None
