"""Solve for the size of a cause that gives the requested detectability."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from herringbone_sim.errors import DivergenceError
from herringbone_sim.practice.cause import Cause
from herringbone_sim.practice.observe import largest, observe_run, pooled, simulate_run
from herringbone_sim.practice.plan import FIT_RUNS, KINDS, Plan
from herringbone_sim.practice.record import Sampling
from herringbone_sim.practice.rig_model import NOMINAL, Constants

NEAR = 0.08  # accepted error of log d
TRIES = 8
SHORT = Sampling(30, 40)  # mesh cycles of the trial runs
SHORT_OF_RING = Sampling(30, 78)  # a revolution against the ring has 77 cycles
Solved = tuple[tuple[Cause, float], ...]
Tries = list[tuple[float, float]]


def solve_plan(plan: Plan) -> Solved:
    """Return the causes with sizes for the plan's detectability, and the detectability of each.

    Raises:
        DivergenceError: the motion diverges at every size tried of a cause.
    """
    rig = NOMINAL.scaled(plan.factors)
    return tuple(solve_size(plan, rig, cause) for cause in plan.causes)


def solve_size(plan: Plan, rig: Constants, cause: Cause) -> tuple[Cause, float]:
    """Return the cause at the size for the plan's detectability, and the detectability reached.

    The size is sought with short runs by following the slope of log d over log size, then
    corrected once with full runs; it stays within the limits of its kind. The detectability after
    that correction is extrapolated.

    Raises:
        DivergenceError: the motion diverges at every size tried.
    """
    kind = KINDS[cause.internal]
    tries = _sought(plan, rig, cause)
    if not tries:
        raise DivergenceError(
            f"the rig of seed {plan.seed} leaves the range of any gear with {cause.internal} "
            "of any size tried: take another seed"
        )
    slope = _slope(tries)
    size, d = min(tries, key=lambda attempt: abs(np.log(attempt[1] / plan.d)))
    d_full = _detectability(plan, rig, cause.sized(size), Sampling())
    if d_full is None:
        return cause.sized(size), d
    if abs(np.log(d_full / plan.d)) < NEAR:
        return cause.sized(size), d_full
    right = float(np.clip(_next(size, d_full, plan.d, slope), kind.least, kind.cap))
    return cause.sized(right), d_full * (right / size) ** slope


def _sought(plan: Plan, rig: Constants, cause: Cause) -> Tries:
    """Return the sizes tried with short runs, and detectabilities; diverged ones are omitted."""
    kind, tries, size = KINDS[cause.internal], Tries(), KINDS[cause.internal].start
    sampling = SHORT_OF_RING if cause.shape.get("member") == "ring" else SHORT
    for _ in range(TRIES):
        d = _detectability(plan, rig, cause.sized(size), sampling)
        if d is None:
            size *= 0.5
            continue
        tries.append((size, d))
        stuck = (size >= kind.cap and d < plan.d) or (size <= kind.least and d > plan.d)
        if abs(np.log(d / plan.d)) < NEAR or stuck:
            break
        size = float(np.clip(_next(size, d, plan.d, _slope(tries)), kind.least, kind.cap))
    return tries


def _slope(tries: Tries) -> float:
    """Return the slope of log d over log size from the last two trials, limited to 0.4 .. 2.5."""
    if len(tries) < 2 or tries[-2][0] == tries[-1][0]:
        return 1.0
    (size, d), (before, d_before) = tries[-1], tries[-2]
    return float(np.clip(np.log(d / d_before) / np.log(size / before), 0.4, 2.5))


def _next(size: float, d: float, wanted: float, slope: float) -> float:
    """Return the next size by the slope, changed by at most a factor of ten."""
    return size * float(np.clip((wanted / max(d, 1e-6)) ** (1.0 / slope), 0.1, 10.0))


def _detectability(plan: Plan, rig: Constants, cause: Cause, sampling: Sampling) -> float | None:
    """Return the detectability of a cause alone in the fit runs; None if one of them diverges."""
    alone = replace(plan, causes=(cause,))
    measures = []
    try:
        for i in range(FIT_RUNS):
            moved = simulate_run(alone, rig, (cause,), i, sampling)
            measures.append(
                observe_run(alone, rig, (cause,), i, moved, largest([moved.now])).measure
            )
    except DivergenceError:
        return None
    return pooled(measures)
