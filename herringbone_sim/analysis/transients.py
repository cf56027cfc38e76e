"""How many cycles a motion takes to settle on what it does in the end."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from herringbone_sim.core.timeseries import Array

LEAST_SHARE, LEAST_CYCLES = 0.05, 50
REFERENCES = 2000
MARGIN = 2.0
WINDOW, STRAY_SHARE = 25, 0.2
RESOLUTION = 1e-4


def settling_cycles(points: Array) -> tuple[int, bool]:
    """Section points to drop, and whether the motion has settled by half of them.

    The second half stands for the settled motion. A point of the first half is astray when it is
    farther from the second half than 2 times what the second half's points are from each other
    (99th percentile), and farther than 1e-4 of the scale. All is dropped up to the last stretch of
    25 points of which more than 20 % stray; at least 5 % of the points, up to 50.

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
