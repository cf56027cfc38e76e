"""How many cycles a motion takes to settle on what it does in the end."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from herringbone_sim.core.timeseries import Array

LEAST_SHARE, LEAST_CYCLES = 0.05, 50
REFERENCES = 2000
MARGIN = 2.0
STRAY_SHARE = 0.02
RESOLUTION = 1e-4


def settling_cycles(points: Array) -> tuple[int, bool]:
    """Section points to drop, and whether the motion has settled by half of them.

    The second half stands for the settled motion. A point of the first half is astray when it is
    farther from the second half than 2 times what the second half's points are from each other
    (99th percentile), and farther than 1e-4 of the scale. All is dropped up to where at most 2 %
    of the points until half-time stray; at least 5 % of the points, up to 50.

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
    behind = np.cumsum(astray[::-1])[::-1] / np.arange(half, 0, -1)
    calm = np.flatnonzero(behind <= STRAY_SHARE)
    return (max(int(calm[0]), least), True) if calm.size else (half, False)
