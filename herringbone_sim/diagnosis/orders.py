"""Number hidden parts that are alike in one order in all runs.

Where no channel tells equal parts apart, such as the planets, states of motion are fitted in an
arbitrary order of them, another one in each run. Without an effect every order fits as well. An
effect at one of the parts needs the same order in all runs: it is found by the effect that, with
the best order of each run, removes most chi2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.diagnosis.coefficients import Coefficient, functions_used
from herringbone_sim.diagnosis.fits import (
    NEAR_SHARE,
    FittedExplanation,
    fit_effect,
    near_best,
)
from herringbone_sim.diagnosis.machine import Hypothesis, Machine
from herringbone_sim.diagnosis.parallel import forked_map
from herringbone_sim.diagnosis.refits import fit_anew
from herringbone_sim.diagnosis.search import CHANCE_CHI2, Search

MAX_REFERENCES = 3  # runs from whose own fit the orders of all others are sought; for run time
MAX_ROUNDS = 10  # alternations between orders and fit, for run time

MAX_TRIED = 3  # kinds of effects that are fitted, each in its own order; for run time

Renaming = Mapping[str, str]  # name of each function that an order of the parts exchanges


class Ordered(NamedTuple):
    """An effect in the order of parts that it needs.

    Attributes:
        gain: chi2 that it removes in a linear fit.
        hypothesis: the effect at its place.
        orders: number of the order of each run, see ``Machine.orders``.
        mean: (p,) mean of the linear fit, the base first.
    """

    gain: float
    hypothesis: Hypothesis
    orders: list[int]
    mean: Array


def in_best_orders(search: Search, catalogue: Sequence[Hypothesis]) -> Machine:
    """The machine with its parts in the order that some effect of a catalogue needs in each run.

    The same machine if no order of the parts gains more than chance. Where several kinds of
    effects gain, each with its own order, that counts whose fit leaves least.
    """
    renamings, free = search.machine.orders()
    if not free.any():
        return search.machine
    search = search.onwards(search.machine)
    plain = max(-search.quick(h.coefficients) for h in catalogue)
    by_chance = CHANCE_CHI2 + 2.0 * np.log(len(renamings)) * np.count_nonzero(free)
    best: dict[object, Ordered] = {}
    sought = _told_apart(search, catalogue, renamings)
    every = forked_map(lambda h: _best_orders(search, h.coefficients, renamings, free), sought)
    for hypothesis, (gain, orders, mean) in zip(sought, every, strict=True):
        found = Ordered(gain, hypothesis, orders, mean)
        kind = hypothesis.effect, _heads(search, hypothesis)
        if found.gain > plain + by_chance and (kind not in best or found.gain > best[kind].gain):
            best[kind] = found
    tried = sorted(best.values(), key=lambda o: -o.gain)[:MAX_TRIED]
    ordered = [search.machine.reordered(o.orders) for o in tried]
    if len(tried) < 2:
        return ordered[0] if tried else search.machine
    searches = [search.with_machine(machine) for machine in ordered]
    fits = [fit_effect(s, o.hypothesis, o.mean) for s, o in zip(searches, tried, strict=True)]
    near = set(map(id, near_best(FittedExplanation((), search.null), fits, NEAR_SHARE)))
    if len(near) > 1:
        fits = [
            fit_anew(s, f) if id(f) in near else f for s, f in zip(searches, fits, strict=True)
        ]
    return ordered[int(np.argmin([f.loss for f in fits]))]


def _heads(search: Search, hypothesis: Hypothesis) -> frozenset[str]:
    """Names of the functions of a hypothesis without their places."""
    return frozenset(
        f.rpartition(" of ")[0] or f
        for c in hypothesis.coefficients
        for o in search.campaign.observations
        if o in c.placements
        for f in c.placements[o].functions
    )


def _told_apart(
    search: Search, catalogue: Sequence[Hypothesis], renamings: Sequence[Renaming]
) -> list[Hypothesis]:
    """Hypotheses that an order changes, one of those that an order turns into one another."""
    observations = search.campaign.observations
    seen: set[object] = set()
    chosen = []
    for hypothesis in catalogue:
        if not hypothesis.vanishes_at_zero:
            continue
        # What identifies coefficients: where they act, with which weights.
        entries = [
            (i, o, row, f, w.tobytes())
            for i, c in enumerate(hypothesis.coefficients)
            for o in observations
            if o in c.placements
            for row, f, w in c.placements[o].entries
        ]
        if frozenset(entries) in seen:
            continue
        keys = {
            frozenset((i, o, row, r.get(f, f), w) for i, o, row, f, w in entries)
            for r in renamings
        }
        seen |= keys
        if len(keys) > 1:
            chosen.append(hypothesis)
    return chosen


def renamed(coefficients: Sequence[Coefficient], renaming: Renaming) -> list[Coefficient]:
    """Coefficients that act on the functions to which a renaming leads."""
    return [
        replace(
            c,
            placements={
                o: replace(p, functions=tuple(renaming.get(f, f) for f in p.functions))
                for o, p in c.placements.items()
            },
        )
        for c in coefficients
    ]


def _best_orders(
    search: Search,
    coefficients: Sequence[Coefficient],
    renamings: Sequence[Renaming],
    free: NDArray[np.bool_],
) -> tuple[float, list[int], Array]:
    """The order of each run in which a linear fit of an effect removes most chi2.

    Orders and coefficients are found in turn, from the fit to all runs in their first order and
    from the fits to single runs.

    Returns:
        ``gain``, ``orders`` and ``mean`` of ``Ordered``.
    """
    used = [f for names in functions_used(coefficients).values() for f in names]
    images = [tuple(renaming.get(f, f) for f in used) for renaming in renamings]
    unlike = dict(zip(images, renamings, strict=True))  # orders that differ for this effect
    of_image = {
        image: search.campaign.normal_equations(renamed(coefficients, renaming))
        for image, renaming in unlike.items()
    }
    each = [of_image[image] for image in images]
    A, b = (np.stack(parts) for parts in zip(*each, strict=True))  # (orders, runs, p, p)
    prior = np.diag([c.sd**-2.0 for c in (*search.base, *coefficients)])
    runs = np.arange(A.shape[1])

    def solved(orders: Indices, of: Indices) -> Array:
        right, whole = b[orders[of], of].sum(0), A[orders[of], of].sum(0) + prior
        return np.asarray(np.linalg.solve(whole, right))

    def gains(mean: Array) -> Array:
        """Chi2 (orders, runs) removed at a mean."""
        return np.asarray(2.0 * b @ mean - np.einsum("erpq,p,q->er", A, mean, mean))

    first = np.zeros(len(runs), dtype=int)
    own = [float(b[0, r] @ solved(first, runs[r : r + 1])) for r in runs]
    references = [r for r in np.argsort(own)[::-1] if free[r]][:MAX_REFERENCES]
    best, choice = -np.inf, first
    for of in (runs, *(runs[r : r + 1] for r in references)):
        mean, orders = solved(first, of), first
        for _ in range(MAX_ROUNDS):
            found = np.where(free, np.argmax(gains(mean), axis=0), 0)
            mean = solved(found, runs)
            if np.array_equal(found, orders):
                break
            orders = found
        gain = float(b[orders, runs].sum(0) @ solved(orders, runs))
        if gain > best:
            best, choice = gain, orders
    mean = solved(choice, runs)
    mean[: len(search.base)] += search.null.mean
    return best, choice.tolist(), mean
