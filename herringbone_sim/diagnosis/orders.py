"""Number hidden parts that are alike in one order in all runs.

Where no channel tells equal parts apart, such as the planets, states of motion are fitted in an
arbitrary order of them, another one in each run. Without an effect every order fits as well. An
effect at one of the parts needs the same order in all runs: it is found by the effect that, with
the best order of each run, removes most chi2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.diagnosis.coefficients import Coefficient
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.search import CHANCE_CHI2, Search

MAX_REFERENCES = 3  # runs from whose own fit the orders of all others are sought; for run time
MAX_ROUNDS = 10  # alternations between orders and fit, for run time

Renaming = Mapping[str, str]  # name of each function that an order of the parts exchanges


def with_best_orders(search: Search, catalogue: Sequence[Hypothesis]) -> Search:
    """Search on runs whose parts are in the order that some effect of a catalogue needs.

    The same search if no order of the parts gains more than chance.
    """
    renamings, free = search.machine.orders()
    if not free.any():
        return search
    search = search.onwards(search.machine)
    plain = max(-search.quick(h.coefficients) for h in catalogue)
    by_chance = CHANCE_CHI2 + 2.0 * np.log(len(renamings)) * np.count_nonzero(free)
    best, choice = plain + by_chance, None
    for hypothesis in _told_apart(search, catalogue, renamings):
        gain, orders = _best_orders(search, hypothesis.coefficients, renamings, free)
        if gain > best:
            best, choice = gain, orders
    if choice is None:
        return search
    return search.onwards(search.machine.reordered(choice))


def _told_apart(
    search: Search, catalogue: Sequence[Hypothesis], renamings: Sequence[Renaming]
) -> list[Hypothesis]:
    """Hypotheses that an order changes, one of those that an order turns into one another."""
    observations = search.campaign.observations
    seen: set[object] = set()
    chosen = []
    for hypothesis in catalogue:
        if not hypothesis.vanishes_at_zero or _key(hypothesis.coefficients, observations) in seen:
            continue
        keys = {_key(renamed(hypothesis.coefficients, r), observations) for r in renamings}
        seen |= keys
        if len(keys) > 1:
            chosen.append(hypothesis)
    return chosen


def _key(coefficients: Sequence[Coefficient], observations: Sequence[str]) -> object:
    """What identifies coefficients: where they act in some observations, with which weights."""
    return tuple(
        frozenset((o, row, f, w.tobytes()) for row, f, w in c.placements[o].entries)
        for c in coefficients
        for o in observations
        if o in c.placements
    )


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
) -> tuple[float, list[int]]:
    """Chi2 that an effect removes in a linear fit with the best order of each run, and the orders.

    Orders and coefficients are found in turn, from the fit to all runs in their first order and
    from the fits to single runs.
    """
    each = [search.campaign.normal_equations(renamed(coefficients, r)) for r in renamings]
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
    return best, choice.tolist()
