"""Motion at each value of a sweep, and where it changes from one motion to another."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from herringbone_sim.analysis.periods import TOLERANCE, find_period
from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.batch import Batch
from herringbone_sim.paper.scenarios import CHAOS, FAILED, motion_name

MAX_PERIOD = 12
POINTS = 64
REACH = 0.03  # of the sweep: distance on either side of a change that is evaluated
SEARCH = 0.25  # of the sweep: distance from the published value that is searched
LEAST_STRETCH = 0.02  # of the sweep: shorter stretches are not part of a route


@dataclass(frozen=True)
class Sweep:
    """Steady-state motion at each value of one swept parameter (data of a bifurcation diagram).

    Attributes:
        values: (n,) parameter values, ascending.
        motions: (n,) period in mesh cycles; 0 = aperiodic, -1 = run failed.
        x: (n, points) relative displacement x_sp_L / b_c at mesh phase 0 in the last mesh cycles.
        exponents: (n, 4) Lyapunov exponents per unit of tau = omega_n t: largest, its standard
            error, largest for perturbations that keep left = right, and for those that break
            it. NaN if not computed; the last two also if the motion's halves differ.
    """

    values: Array
    motions: Indices
    x: Array
    exponents: Array


@dataclass(frozen=True)
class Cut:
    """A change from motion ``before`` to motion ``after`` along a sweep.

    Attributes:
        at: middle between the two neighbouring values of the sweep.
        low, high: these two values.
        share_before: fraction of the values with motion ``before``, within 3 % of the sweep below
            ``at``.
        share_after: the same of ``after`` above it.
        clean: whether ``low`` has motion ``before`` and ``high`` has ``after``, so that bisection
            applies.
    """

    at: float
    low: float
    high: float
    share_before: float
    share_after: float
    clean: bool


def motions_of(batch: Batch, tolerance: float = TOLERANCE) -> Indices:
    """(n,) period in mesh cycles of each run of a batch; -1 if the run failed.

    0 if the motion is aperiodic, the period exceeds ``MAX_PERIOD``, or it repeats fewer than five
    times in the section. The section points of all states, in units of b_c and b_c omega_n, must
    gather around as many centres as there are cycles in the period, to ``tolerance`` RMS and
    without drifting apart.
    """
    return np.array([_motion(points, tolerance) for points in batch.sections], dtype=np.int64)


def _motion(points: Array, tolerance: float) -> int:
    if not np.isfinite(points).all():
        return FAILED
    period = find_period(points, max_period=MAX_PERIOD, tolerance=tolerance).value
    return CHAOS if period is None else period


def share(sweep: Sweep, low: float, high: float, motion: int) -> float:
    """Fraction of the values from low to high that have a motion; NaN if there are no values."""
    inside = (sweep.values >= low) & (sweep.values <= high)
    return float(np.mean(sweep.motions[inside] == motion)) if inside.any() else float("nan")


def find_cut(sweep: Sweep, before: int, after: int, near: float) -> Cut | None:
    """Find the change from motion ``before`` to ``after`` that is cleanest and nearest to a value.

    Of all values where the motion changes, the value with the largest product of three numbers:
    the fractions with ``before`` and ``after`` within 3 % of the sweep on either side, and a
    closeness that falls from 1 at ``near`` to 0 at a quarter of the sweep from it. None if all
    products are 0.
    """
    v, m = sweep.values, sweep.motions
    span = float(v[-1] - v[0])
    reach = max(REACH * span, span / (len(v) - 1))
    changes = np.flatnonzero(m[1:] != m[:-1])
    cuts = [_cut(sweep, int(i), before, after, reach) for i in changes]
    best = max(cuts, key=lambda c: _merit(c, near, span), default=None)
    return best if best and _merit(best, near, span) > 0.0 else None


def _merit(cut: Cut, near: float, span: float) -> float:
    closeness = max(1.0 - abs(cut.at - near) / (SEARCH * span), 0.0)
    return cut.share_before * cut.share_after * closeness


def _cut(sweep: Sweep, i: int, before: int, after: int, reach: float) -> Cut:
    v, m = sweep.values, sweep.motions
    at = float(v[i] + v[i + 1]) / 2.0
    return Cut(
        at=at,
        low=float(v[i]),
        high=float(v[i + 1]),
        share_before=share(sweep, at - reach, at, before),
        share_after=share(sweep, at, at + reach, after),
        clean=bool(m[i] == before and m[i + 1] == after),
    )


def stretches(sweep: Sweep) -> list[tuple[float, float, int]]:
    """Stretches of a sweep with equal motion: first value, last value, motion."""
    v, m = sweep.values, sweep.motions
    edges = [0, *(np.flatnonzero(m[1:] != m[:-1]) + 1), len(m)]
    return [(float(v[a]), float(v[b - 1]), int(m[a])) for a, b in pairwise(edges)]


def nearest_stretch(sweep: Sweep, motion: int, near: float) -> tuple[float, float] | None:
    """First and last value of the stretch of a motion that is nearest to a value, or None."""
    own = [(low, high) for low, high, kind in stretches(sweep) if kind == motion]
    return min(own, key=lambda s: max(s[0] - near, near - s[1], 0.0), default=None)


def route(sweep: Sweep) -> tuple[int, ...]:
    """Motions along a sweep in order, without stretches shorter than 2 % of it or repeats."""
    span = float(sweep.values[-1] - sweep.values[0])
    step = span / max(len(sweep.values) - 1, 1)
    long = [m for low, high, m in stretches(sweep) if high - low + step >= LEAST_STRETCH * span]
    return tuple(m for i, m in enumerate(long) if i == 0 or m != long[i - 1])


def shares_text(sweep: Sweep, low: float, high: float) -> str:
    """Fractions of the four commonest motions between two values, as ``P2 60%, chaos 40%``."""
    inside = sweep.motions[(sweep.values >= low) & (sweep.values <= high)]
    kinds, counts = np.unique(inside, return_counts=True)
    order = np.argsort(-counts, kind="stable")[:4]
    return ", ".join(f"{motion_name(int(kinds[i]))} {counts[i] / len(inside):.0%}" for i in order)
