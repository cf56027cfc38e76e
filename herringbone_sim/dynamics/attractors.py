"""Attractors told apart by their stroboscopic sections.

Periodic ones are the same when their points agree, from whichever of them one begins. Others are
the same when their points mix: attractors that coexist are disjoint sets, so the nearest neighbour
of a point of one lies on the same one, while two pieces of one attractor interleave. The count of
such neighbours is the test of Schilling, J. Am. Stat. Assoc. 81 (1986) 799, and Henze, Ann. Stat.
16 (1988) 772: one half for one attractor, 1 for two. It needs no mean, which intermittency shifts;
it needs points enough to see the gap between two sets that run through each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from herringbone_sim.analysis.periods import MIN_REPEATS, TOLERANCE, find_period

Array = NDArray[np.float64]
Exchange = NDArray[np.int64]

ALIKE, AS_A_SET, PAIR = "left = right", "symmetric as a set", "one of a mirror pair"
SAME_POINTS = 10.0  # times the tolerance
MIXED = 0.75


@dataclass(frozen=True)
class Attractor:
    """One attractor, or one and its mirror image.

    Attributes:
        period: in periods of the forcing; 0 = aperiodic.
        symmetry: under the exchange: every state is its own image (``ALIKE``), the set is its own
            image (``AS_A_SET``), or the image is another attractor (``PAIR``); empty without one.
        points: (period, n) section points, or (m, n) of an aperiodic one.
    """

    period: int
    symmetry: str
    points: Array

    @property
    def label(self) -> str:
        kind = f"P{self.period}" if self.period else "aperiodic"
        return f"{kind}, {self.symmetry}" if self.symmetry else kind


def attractor_of(
    section: Array, exchange: Exchange | None = None, tolerance: float = TOLERANCE
) -> Attractor:
    """Attractor on which a section lies.

    Args:
        section: (m, n) successive section points after the transient, coordinates of order one.
        exchange: (n,) indices that swap the two sides; none for a flow without the symmetry.
        tolerance: up to which points are one.
    """
    longest = len(section) // MIN_REPEATS
    period = find_period(section, max_period=longest, tolerance=tolerance).value or 0
    points = section[-period:] if period else distinct(section, SAME_POINTS * tolerance)
    return Attractor(period, _symmetry(points, period, exchange, tolerance), points)


def same(
    a: Attractor, b: Attractor, exchange: Exchange | None = None, tolerance: float = TOLERANCE
) -> bool:
    """Whether two are one attractor, or mirror images of each other."""
    if (a.period, a.symmetry == ALIKE) != (b.period, b.symmetry == ALIKE):
        return False
    images = [b.points] if exchange is None else [b.points, b.points[:, exchange]]
    return any(_agree(a.points, image, a.period, tolerance) for image in images)


def recognise(
    found: Attractor,
    known: Sequence[Attractor],
    exchange: Exchange | None = None,
    tolerance: float = TOLERANCE,
) -> int:
    """Index of an attractor among those known; their number when it is new."""
    matches = (i for i, one in enumerate(known) if same(one, found, exchange, tolerance))
    return next(matches, len(known))


def like_neighbours(a: Array, b: Array) -> float:
    """Share of all points whose nearest neighbour is of the same set, corrected for unequal sizes.

    1/2 when both sets (m, n) and (l, n) are drawn from one attractor, 1 when they lie apart.
    """
    both = np.concatenate([a, b])
    own = np.arange(len(both)) < len(a)
    # A point that is in both sets may find its double first, or itself.
    nearest = cKDTree(both).query(both, k=2)[1]
    index = np.where(nearest[:, 0] == np.arange(len(both)), nearest[:, 1], nearest[:, 0])
    like = own[index] == own
    return float(0.5 * (like[own].mean() + like[~own].mean()))


def distinct(points: Array, distance: float) -> Array:
    """Points (m, n) less those that a later one comes close to.

    A period too long to be seen as one repeats its points, which would be their own neighbours.
    """
    again = cKDTree(points).query_pairs(distance, output_type="ndarray")
    kept = np.ones(len(points), dtype=bool)
    kept[again.min(axis=1, initial=len(points))] = False
    return points[kept]


def _agree(a: Array, b: Array, period: int, tolerance: float) -> bool:
    if period:
        shifts = (np.abs(a - np.roll(b, shift, axis=0)).max() for shift in range(period))
        return bool(min(shifts) <= SAME_POINTS * tolerance)
    return like_neighbours(a, b) < MIXED


def _symmetry(points: Array, period: int, exchange: Exchange | None, tolerance: float) -> str:
    if exchange is None:
        return ""
    image = points[:, exchange]
    if np.abs(points - image).max() <= SAME_POINTS * tolerance:
        return ALIKE
    return AS_A_SET if _agree(points, image, period, tolerance) else PAIR
