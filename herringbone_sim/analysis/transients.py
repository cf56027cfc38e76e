"""Length of the transient of a motion in mesh cycles."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from herringbone_sim.arrays import Array

LEAST_SHARE, LEAST_CYCLES = 0.05, 50
REFERENCES = 2000
MARGIN = 2.0
WINDOW, STRAY_SHARE = 25, 0.2
RESOLUTION = 1e-4


def settling_cycles(points: Array) -> tuple[int, bool]:
    """Number of section points of the transient, and whether the motion settled in the first half.

    The second half of the points represents the settled motion. A point of the first half counts
    as transient if it is farther from the second half than 1e-4 of the scale and than twice the
    99th percentile of the nearest-neighbour distances within the second half. All points up to the
    last window of 25 with more than 20 % transient points are dropped, and at least the smaller of
    5 % of all points and 50.

    Args:
        points: (m, k) section points in units of the scale of the motion.
    """
    half = len(points) // 2
    least = min(int(np.ceil(LEAST_SHARE * len(points))), LEAST_CYCLES)
    if half < 4:
        return least, True
    settled = points[half:]
    settled = settled[:: -(-len(settled) // REFERENCES)]
    tree = cKDTree(settled)
    own = tree.query(settled, k=2)[0][:, 1]
    limit = max(MARGIN * float(np.quantile(own, 0.99)), RESOLUTION)
    astray = tree.query(points[:half])[0] > limit
    window = min(WINDOW, half)
    strays = np.convolve(astray, np.ones(window))[:half]
    crowded = np.flatnonzero(strays > STRAY_SHARE * window)
    last = int(crowded[-1]) + 1 if crowded.size else 0
    return max(last, least), last < half
