"""Largest Lyapunov exponent from two neighbouring trajectories, without tangents.

After Benettin, Galgani and Strelcyn, Phys. Rev. A 14 (1976) 2338: the distance is rescaled to its
initial value once a period. If it is too small, rounding dominates; if too large, the growth is no
longer linear. Between the two lies a plateau, which ``over_distances`` shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.flow import Flow, settle
from herringbone_sim.dynamics.growth import Growth
from herringbone_sim.errors import AnalysisError

DISTANCE = 1e-7
DISTANCES = tuple(10.0**e for e in range(-14, 0))


@dataclass(frozen=True)
class Offset:
    """How the second trajectory differs from the first at the start.

    Attributes:
        distance: in the units of the state.
        direction: (n,) of any length; random by default. One that keeps a symmetry of the flow
            gives the exponent within it.

    Raises:
        AnalysisError: the distance is not positive.
    """

    distance: float = DISTANCE
    direction: Array | None = None

    def __post_init__(self) -> None:
        if not self.distance > 0.0:
            raise AnalysisError(
                f"distance must be positive, got {self.distance}: try {DISTANCE:g}"
            )


OFFSET = Offset()


def two_trajectory_exponent(
    flow: Flow,
    y: Array,
    periods: int = 1000,
    transient: int = 200,
    offset: Offset = OFFSET,
    every: int = 1,
    at: int = 0,
) -> Growth:
    """Largest Lyapunov exponent of the motion from y on.

    Args:
        flow: see ``Flow``; its tangents are not used.
        y: (n,) state on the attractor.
        periods: number of periods averaged over.
        transient: periods left out first, in which the difference aligns with the fastest
            direction.
        offset: of the second trajectory at the start, and its distance after each rescaling.
        every: periods between two rescalings.
        at: periods that have passed before y, see ``Flow``.

    Raises:
        AnalysisError: the two trajectories became equal.
        DivergenceError: the motion left the range of the flow.
    """
    path = _path(flow, y, (transient + periods) // every, every, at)
    logarithms = _growth(flow, path, offset, every, at)[transient // every :]
    return Growth(logarithms[:, None], every * flow.period, path[-1])


def over_distances(
    flow: Flow,
    y: Array,
    distances: Sequence[float] = DISTANCES,
    periods: int = 400,
    transient: int = 100,
    at: int = 0,
) -> Array:
    """Exponent and standard error (m, 2) at each distance; NaN where the trajectories became
    equal.

    Raises:
        AnalysisError: a distance is not positive.
    """
    offsets = [Offset(distance) for distance in distances]
    found = np.full((len(distances), 2), np.nan)
    path = _path(flow, y, transient + periods, at=at)
    for i, offset in enumerate(offsets):
        try:
            logarithms = _growth(flow, path, offset, at=at)[transient:]
        except AnalysisError:
            continue
        growth = Growth(logarithms[:, None], flow.period, path[-1])
        found[i] = growth.exponents[0], growth.errors[0]
    return found


def _path(flow: Flow, y: Array, steps: int, every: int = 1, at: int = 0) -> Array:
    """States (steps + 1, n) of the first trajectory, ``every`` periods apart."""
    path = [y]
    for i in range(steps):
        path.append(settle(flow, path[-1], every, at + i * every))
    return np.array(path)


def _growth(flow: Flow, path: Array, offset: Offset, every: int = 1, at: int = 0) -> Array:
    """Log growth (steps,) of the distance of the second trajectory between states of the first."""
    distance, apart = offset.distance, offset.direction
    if apart is None:
        apart = np.random.default_rng(0).normal(size=flow.n)
    apart = distance * apart / np.linalg.norm(apart)
    logarithms = np.empty(len(path) - 1)
    for i, (y, ahead) in enumerate(pairwise(path)):
        other = y + apart
        start = float(np.linalg.norm(other - y))  # rounded: not quite the distance asked for
        apart = settle(flow, other, every, at + i * every) - ahead
        length = float(np.linalg.norm(apart))
        if not min(start, length) > 0.0:
            raise AnalysisError(
                f"the two trajectories became one from a distance of {distance:g}: raise it"
            )
        logarithms[i] = np.log(length / start)
        apart *= distance / length
    return logarithms
