"""Periods of many motions at once: ``analysis.periods.find_period`` compiled, for noise-free
data.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from herringbone_sim.analysis.periods import (
    GROWTH,
    LEAST_LARGEST,
    MAX_PERIOD,
    MIN_REPEATS,
    TOLERANCE,
)
from herringbone_sim.arrays import Array

LEAST_RETURN = 1e-9

compiled: Any = njit(cache=True, nogil=True, error_model="numpy")


def find_periods(sections: Array, max_period: int = MAX_PERIOD) -> Array:
    """Period (n,) in mesh cycles of each motion; 0 = aperiodic; NaN = too few points to decide.

    The smallest p for which the points m, m + p, m + 2 p, ... scatter around their centre by no
    more than ``TOLERANCE`` (RMS), without drifting apart: slow chaos can pass close to a period,
    but not over the whole window.

    Args:
        sections: (n, m, k) section points in units of order one, as the states of the model are;
            NaN gives a NaN.
        max_period: largest period tried; each needs 5 repeats within the window.
    """
    periods: Array = np.full(len(sections), np.nan)
    largest = min(max_period, sections.shape[1] // MIN_REPEATS)
    if largest >= 1:
        aperiodic = 0.0 if largest >= LEAST_LARGEST else np.nan
        _find(np.ascontiguousarray(sections), largest, aperiodic, periods)
    return periods


@compiled
def _spread(points: Any, period: int) -> Any:
    """RMS distance per coordinate of points (m, k) from the centres of every p-th point."""
    m, k = points.shape
    squares = 0.0
    for first in range(period):
        count = (m - first + period - 1) // period
        for j in range(k):
            centre = 0.0
            for i in range(first, m, period):
                centre += points[i, j]
            centre /= count
            for i in range(first, m, period):
                squares += (points[i, j] - centre) ** 2
    return np.sqrt(squares / ((m - period) * k))


@compiled
def _grows(points: Any, period: int) -> Any:
    """Whether the distance of repeats grows more than ``GROWTH`` times, first to last third."""
    n = points.shape[0] - period
    returns = np.empty(n)
    for i in range(n):
        squares = 0.0
        for j in range(points.shape[1]):
            squares += (points[i + period, j] - points[i, j]) ** 2
        returns[i] = np.sqrt(squares / points.shape[1])
    third = max(n // 3, 1)
    early, late = np.median(returns[:third]), np.median(returns[-third:])
    return late > GROWTH * max(early, LEAST_RETURN)


@compiled
def _find(sections: Any, largest: int, aperiodic: float, periods: Any) -> None:
    """Write the period of each section (n, m, k) into ``periods`` (n,), or ``aperiodic``."""
    for i in range(sections.shape[0]):
        if np.isnan(sections[i, 0, 0]):
            continue
        periods[i] = aperiodic
        for period in range(1, largest + 1):
            if _spread(sections[i], period) <= TOLERANCE:
                periods[i] = 0.0 if _grows(sections[i], period) else period
                break
