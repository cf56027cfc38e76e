"""Largest Lyapunov exponent from the divergence of two trajectories, without tangent vectors.

After Benettin, Galgani and Strelcyn, Phys. Rev. A 14 (1976) 2338: the distance is rescaled to its
initial value once a period. If it is too small, rounding dominates; if too large, the growth is no
longer linear. Between the two lies a plateau, which ``over_distances`` shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.flow import Flow, iterate, settle
from herringbone_sim.dynamics.growth import Growth
from herringbone_sim.errors import AnalysisError

DISTANCE = 1e-7
DISTANCES = tuple(10.0**e for e in range(-14, 0))


def over_distances(
    flow: Flow,
    y: Array,
    distances: Sequence[float] = DISTANCES,
    periods: int = 400,
    transient: int = 100,
    at: int = 0,
) -> Array:
    """Estimate the largest Lyapunov exponent of a motion with each of several initial distances.

    Args:
        flow: see ``Flow``; its tangents are not used.
        y: (n,) state on the attractor.
        distances: (m,) of the second trajectory after each rescaling, in the units of the state.
        periods: number of periods averaged over.
        transient: periods discarded first, in which the difference aligns with the fastest
            direction.
        at: periods elapsed before y, see ``Flow``.

    Returns:
        Exponent and standard error (m, 2) [1/time of the flow]; NaN where the two trajectories
        became equal.

    Raises:
        AnalysisError: a distance is not positive, or there are fewer than 20 periods.
        DivergenceError: the motion left the range of the flow.
    """
    for distance in distances:
        if not distance > 0.0:
            raise AnalysisError(f"distance must be positive, got {distance}: try {DISTANCE:g}")
    exponents = np.full((len(distances), 2), np.nan)
    path = iterate(flow, y, transient + periods + 1, at)
    for i, distance in enumerate(distances):
        logarithms = _growth(flow, path, distance, at)[transient:]
        if np.isfinite(logarithms).all():
            growth = Growth(logarithms[:, None], flow.period, path[-1])
            exponents[i] = growth.exponents[0], growth.errors[0]
    return exponents


def _growth(flow: Flow, path: Array, distance: float, at: int) -> Array:
    """Log growth (periods,) of the distance between two trajectories in each period.

    NaN from the period in which the two become equal.

    Args:
        path: (periods + 1, n) states of the first trajectory.
        distance: of the second trajectory at the beginning of each period.
        at: periods elapsed before the first state.
    """
    apart = np.random.default_rng(0).normal(size=flow.n)
    apart = distance * apart / np.linalg.norm(apart)
    logarithms = np.full(len(path) - 1, np.nan)
    for i, (y, ahead) in enumerate(pairwise(path)):
        other = y + apart
        start = float(np.linalg.norm(other - y))  # rounded: not quite the distance asked for
        apart = settle(flow, other, 1, at + i) - ahead
        length = float(np.linalg.norm(apart))
        if not min(start, length) > 0.0:
            break
        logarithms[i] = np.log(length / start)
        apart *= distance / length
    return logarithms
