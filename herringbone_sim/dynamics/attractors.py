"""Attractors identified and compared by their stroboscopic sections.

Two periodic attractors are the same if their section points agree up to a cyclic shift. Two
aperiodic ones are the same if their points mix: coexisting attractors are disjoint sets, so the
nearest neighbour of a point belongs to the same attractor, while the points of two samples of one
attractor interleave. The test counts such neighbours (Schilling, J. Am. Stat. Assoc. 81 (1986)
799; Henze, Ann. Stat. 16 (1988) 772): their fraction is one half for one attractor and 1 for two.
It uses no mean value, which intermittency would shift, but it needs enough points to resolve the
gap between two sets that are interwoven.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from herringbone_sim.analysis.periods import MIN_REPEATS, TOLERANCE, find_period
from herringbone_sim.arrays import Array, Indices

ALIKE, AS_A_SET, PAIR = "left = right", "symmetric as a set", "one of a mirror pair"
SAME_POINTS = 10.0 * TOLERANCE  # largest distance of points that count as one
MIXED = 0.75  # same_set_share below which two sets belong to one attractor


@dataclass(frozen=True)
class Attractor:
    """An attractor; an attractor and its mirror image count as one.

    Attributes:
        period: in forcing periods; 0 = aperiodic.
        symmetry: under the exchange of left and right: every state is its own image (``ALIKE``),
            the set is its own image (``AS_A_SET``), or the image is another attractor (``PAIR``);
            empty for a flow without the exchange.
        points: (period, n) section points, or (m, n) of an aperiodic attractor.
    """

    period: int
    symmetry: str
    points: Array

    def named(self, kind: str) -> str:
        """Text of a kind of motion with the symmetry of the attractor: ``P2, left = right``."""
        return f"{kind}, {self.symmetry}" if self.symmetry else kind


def attractor_of(section: Array, exchange: Indices | None = None) -> Attractor:
    """Classify the attractor that a stroboscopic section lies on.

    Args:
        section: (m, n) successive section points after the transient, coordinates of order one.
        exchange: (n,) indices that swap the two sides; None for a flow without the symmetry.
    """
    longest = len(section) // MIN_REPEATS
    period = find_period(section, max_period=longest).value or 0
    points = section[-period:] if period else drop_repeats(section, SAME_POINTS)
    return Attractor(period, _symmetry(points, period, exchange), points)


def same_attractor(a: Attractor, b: Attractor, exchange: Indices | None = None) -> bool:
    """Tell whether two attractors are the same, or mirror images of each other.

    See ``match_known`` for ``exchange``.
    """
    if (a.period, a.symmetry == ALIKE) != (b.period, b.symmetry == ALIKE):
        return False
    images = [b.points] if exchange is None else [b.points, b.points[:, exchange]]
    return any(_agree(a.points, image, a.period) for image in images)


def match_known(
    candidate: Attractor, known: Sequence[Attractor], exchange: Indices | None = None
) -> int:
    """Return the index of the first known attractor that is the same as the candidate.

    Points of periodic attractors agree to within ``SAME_POINTS``.

    Args:
        candidate: attractor to look up.
        known: attractors to compare it with.
        exchange: (n,) indices that swap the two sides: mirror images count as the same; None: they
            don't.

    Returns:
        ``len(known)`` if none is the same.
    """
    matches = (
        i for i, attractor in enumerate(known) if same_attractor(attractor, candidate, exchange)
    )
    return next(matches, len(known))


def same_set_share(a: Array, b: Array) -> float:
    """Fraction of points whose nearest neighbour belongs to the same set, averaged over two sets.

    1/2 if both sets (m, n) and (l, n) are drawn from one attractor, 1 if they lie apart.
    """
    both = np.concatenate([a, b])
    own = np.arange(len(both)) < len(a)
    # The first neighbour is the point itself, unless the other set holds the same point.
    nearest = cKDTree(both).query(both, k=2)[1]
    index = np.where(nearest[:, 0] == np.arange(len(both)), nearest[:, 1], nearest[:, 0])
    like = own[index] == own
    return float(0.5 * (like[own].mean() + like[~own].mean()))


def drop_repeats(points: Array, distance: float) -> Array:
    """Remove points (m, n) that have a later point within ``distance``.

    An attractor whose period is too long to be detected repeats its points; the repeats would be
    nearest neighbours of each other and spoil ``same_set_share``.
    """
    again = cKDTree(points).query_pairs(distance, output_type="ndarray")
    unique = np.ones(len(points), dtype=bool)
    unique[again.min(axis=1, initial=len(points))] = False
    return points[unique]


def _agree(a: Array, b: Array, period: int) -> bool:
    """Tell whether two sets of section points (m, n) belong to one attractor of that period."""
    if period:
        shifts = (np.abs(a - np.roll(b, shift, axis=0)).max() for shift in range(period))
        return bool(min(shifts) <= SAME_POINTS)
    return same_set_share(a, b) < MIXED


def _symmetry(points: Array, period: int, exchange: Indices | None) -> str:
    """Symmetry label of section points under the exchange of left and right, see ``Attractor``."""
    if exchange is None:
        return ""
    image = points[:, exchange]
    if np.abs(points - image).max() <= SAME_POINTS:
        return ALIKE
    return AS_A_SET if _agree(points, image, period) else PAIR
