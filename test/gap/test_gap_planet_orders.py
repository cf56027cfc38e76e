"""Planets that no channel tells apart: orders of their states, and effects that need one order.

The run-out of a sun meets one planet after the other; seen at three shafts of a practice rig
whose label says what it has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from gap_support import of_shafts, practised, rig, without

from herringbone_sim.core.layout import Layout
from herringbone_sim.diagnosis.coefficients import amplitudes
from herringbone_sim.diagnosis.fits import FittedExplanation, fit_effect
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.orders import in_best_orders, renamed
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.effects.effect import Locus
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.searches import planet_permutations
from herringbone_sim.gap.observations.windows import trajectory

SEED, RUNS = 372101, 3
OTHER = 22  # number of an order that moves planets of both sides


@pytest.fixture(scope="module")
def ordered() -> Search:
    """Runs in the order that the run-out needs."""
    start = Search(practised(SEED, "runout", RUNS))
    return start.onwards(in_best_orders(start, start.machine.hypotheses()))


def runout(search: Search) -> Hypothesis:
    """The hypothesis of the catalogue that removes most."""
    every = [h for h in search.machine.hypotheses() if h.effect == "runout"]
    return min(every, key=lambda h: search.quick(h.coefficients))


@pytest.fixture(scope="module")
def fit(ordered: Search) -> FittedExplanation:
    """Fit of the run-out, from no size."""
    best = runout(ordered)
    start = np.concatenate([ordered.null.mean, np.zeros(len(best.coefficients))])
    return fit_effect(ordered, best, start)


def test_an_order_takes_planets_with_their_meshes() -> None:
    layout = Layout(3, True)
    orders = planet_permutations.orders(layout)
    assert len(orders) == 36
    np.testing.assert_array_equal(orders[0], np.arange(9))
    last = orders[-1]  # planets 1 and 3 exchanged on both sides
    moved = [layout.bodies[i] for i in last]
    assert moved[3:] == ["p3_L", "p2_L", "p1_L", "p3_R", "p2_R", "p1_R"]
    made = planet_permutations.renaming(layout, last, ("k of 0", "k of 11", "M_s"))
    named = {f: layout.meshes[int(g.split()[-1])] for f, g in made.items()}
    assert named == {"k of 0": "sp3_L", "k of 11": "rp1_R"}


def test_the_run_out_of_a_sun_is_seen_on_both_sides(ordered: Search) -> None:
    """The label: all sun meshes. With runs in other orders the ring of one side removed most."""
    best = runout(ordered)
    assert dict(best.options)["member"] == "sun"
    assert best.locus == Locus("sp", "all", "all")


def test_contradicting_orders_of_the_runs_are_put_into_one(ordered: Search) -> None:
    """As much is explained as before they were scrambled; columns are formed anew by then."""
    gain = -ordered.quick(runout(ordered).coefficients)
    renamings, free = ordered.machine.orders()
    scrambled = ordered.onwards(ordered.machine.reordered([OTHER * (r % 2) for r in range(RUNS)]))
    assert free.all()
    assert -scrambled.quick(runout(scrambled).coefficients) < 0.8 * gain
    # The columns of a scrambled run are those of the planets that took the place.
    best = runout(ordered).coefficients
    back = next(r for r in renamings if _undoes(r, renamings[OTHER]))
    b, now = (
        s.campaign.normal_equations(c)[1]
        for s, c in ((ordered, best), (scrambled, renamed(best, back)))
    )
    np.testing.assert_allclose(now[1], b[1], atol=0.05 * np.abs(b[1]).max())
    again = scrambled.onwards(in_best_orders(scrambled, scrambled.machine.hypotheses()))
    assert -again.quick(runout(again).coefficients) == pytest.approx(gain, rel=0.05)


def _undoes(one: Mapping[str, str], other: Mapping[str, str]) -> bool:
    """Whether a renaming leads back from another."""
    return all(one[other[name]] == name for name in other)


def test_an_order_without_worth_is_not_taken() -> None:
    """A gear that is as told: the states stay as they were fitted."""
    healthy = GearMachine(
        GearObservations([of_shafts(run) for run in rig({}, cycles=40).runs[:1]])
    )
    start = Search(healthy)
    assert in_best_orders(start, healthy.hypotheses()) is healthy


def test_another_run_is_ordered_as_the_effect_needs(
    ordered: Search, fit: FittedExplanation
) -> None:
    """A run that was not fitted leaves as little, in whatever order its planets were."""
    run = ordered.machine.gear.runs[1].run  # type: ignore[attr-defined]
    left = []
    for order in (0, OTHER):
        fresh = GearMachine(GearObservations([run])).reordered([order])
        fresh = fresh.ordered_for(fit.hypotheses, fit.score.mean)
        left.append(_chi2(fresh, fit.hypotheses, fit.score.mean))
    nominal = _chi2(GearMachine(GearObservations([run])), (), fit.score.mean[: len(ordered.base)])
    assert max(left) < 0.9 * nominal
    assert left[1] == pytest.approx(left[0], rel=0.05)


def test_a_run_without_shafts_is_left_as_it_is(ordered: Search, fit: FittedExplanation) -> None:
    """Such a run has no windows that could be reordered; the others are ordered all the same."""
    run = ordered.machine.gear.runs[1].run  # type: ignore[attr-defined]
    layout = run.model.layout
    empty = replace(run, u=without(run.u, layout.bodies, layout.bodies))
    machine = GearMachine(GearObservations([run])).for_runs([run, empty])
    there = machine.ordered_for(fit.hypotheses, fit.score.mean)
    assert _chi2(there, (), fit.score.mean[: len(ordered.base)]) > 0.0
    assert not there.gear.has_windows_of(1)


def _chi2(machine: GearMachine, hypotheses: Sequence[Hypothesis], mean: np.ndarray) -> float:
    """Squares that the windows of the first run leave under an explanation."""
    there, own = machine.transferred(hypotheses)
    every = (*there.base, *(c for h in own for c in h.coefficients))
    made = amplitudes(every, mean, there.runs, there.rows)
    block = there.blocks(made, {}, (trajectory.NAME,))[0][trajectory.NAME]
    return float(np.sum((block.residual / block.sigma) ** 2))


def test_a_size_far_off_is_found_with_states_of_its_own(
    ordered: Search, fit: FittedExplanation
) -> None:
    """From a fit that stands at 0.4 of the size: the trial is nearer, and leaves less."""
    n = len(ordered.base)
    stuck = fit.score.mean.copy()
    stuck[n:] *= 0.4
    start = ordered.machine.restarted_from_other_sizes(
        runout(ordered), replace(fit.score, mean=stuck)
    )
    assert start is not None
    size = np.linalg.norm(fit.score.mean[n : n + 2])
    assert 0.6 < np.linalg.norm(start[n : n + 2]) / size < 1.7
