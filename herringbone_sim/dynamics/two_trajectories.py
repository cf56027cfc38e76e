"""Largest exponent from two trajectories: no tangents, only a second run close by.

After Benettin, Galgani and Strelcyn, Phys. Rev. A 14 (1976) 2338. The distance is brought back to
where it started once a period. Too near, rounding makes the distance; too far, the border of
linearity does: between the two lies a plateau, which ``over_distances`` shows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.dynamics.flow import Flow
from herringbone_sim.dynamics.growth import Growth
from herringbone_sim.errors import AnalysisError

Array = NDArray[np.float64]

DISTANCE = 1e-7
DISTANCES = tuple(10.0**e for e in range(-14, 0))


def two_trajectory_exponent(
    flow: Flow,
    y: Array,
    periods: int = 1000,
    transient: int = 200,
    distance: float = DISTANCE,
    every: int = 1,
    direction: Array | None = None,
) -> Growth:
    """Largest exponent of the motion from y on.

    Args:
        flow: see ``Flow``; its tangents are not used.
        y: (n,) state on the motion.
        periods: averaged over.
        transient: periods in which the difference turns into the fastest direction, left out.
        distance: of the second trajectory, in the units of the state.
        every: periods between two renormalisations.
        direction: (n,) of the first distance; a random one by default. One that keeps a symmetry
            of the flow sees the exponent within it.

    Raises:
        AnalysisError: the distance is not positive, or the two trajectories became one.
        DivergenceError: a motion left the range of the flow.
    """
    if not distance > 0.0:
        raise AnalysisError(f"distance must be positive, got {distance}: try {DISTANCE:g}")
    apart = np.random.default_rng(0).normal(size=flow.n) if direction is None else direction
    apart = distance * apart / np.linalg.norm(apart)
    none, growth = np.zeros((0, flow.n)), []
    for _ in range((transient + periods) // every):
        other = y + apart
        start = float(np.linalg.norm(other - y))
        for _ in range(every):
            (y, _), (other, _) = flow.advance(y, none), flow.advance(other, none)
        length = float(np.linalg.norm(other - y))
        if length == 0.0:
            raise AnalysisError(
                f"the two trajectories became one from a distance of {distance:g}: raise it"
            )
        growth.append(np.log(length / start))
        apart = (other - y) * (distance / length)
    kept = np.array(growth[transient // every :])[:, None]
    return Growth(kept, every * flow.period, y)


def over_distances(
    flow: Flow,
    y: Array,
    distances: Sequence[float] = DISTANCES,
    periods: int = 400,
    transient: int = 100,
) -> Array:
    """Exponent and standard error (m, 2) at each distance; NaN where the two became one."""
    found = np.full((len(distances), 2), np.nan)
    for i, distance in enumerate(distances):
        try:
            growth = two_trajectory_exponent(flow, y, periods, transient, distance)
        except AnalysisError:
            continue
        found[i] = growth.exponents[0], growth.errors[0]
    return found
