"""Period of a motion in mesh cycles, found in its stroboscopic section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array

MAX_PERIOD = 16
TOLERANCE = 1e-3  # largest RMS distance of repeats, in units of the scale of the motion
NOISE_MARGIN = 1.15  # largest RMS distance of repeats, as a multiple of the noise
MIN_REPEATS = 5
GROWTH = 3.0  # largest growth of the distance of repeats from the first third to the last
LEAST_LARGEST = 8  # periods to have tried before a motion is called aperiodic


@dataclass(frozen=True)
class Period:
    """Period of a motion.

    Attributes:
        value: mesh cycles; 0 = aperiodic; None = could not be determined, see ``reason``.
        residual: RMS distance of the section points from the centres of their ``value`` groups,
            per coordinate, in units of the scale; for an aperiodic motion the smallest of all
            periods tried.
        reason: why ``value`` is 0 or None, in words; else empty.
    """

    value: int | None
    residual: float
    reason: str = ""

    @property
    def label(self) -> str:
        """Text of the period: ``P3``, ``aperiodic`` (0) or ``-`` (None)."""
        return "-" if self.value is None else f"P{self.value}" if self.value else "aperiodic"


def find_period(
    points: Array, noise: float = 0.0, max_period: int = MAX_PERIOD, tolerance: float = TOLERANCE
) -> Period:
    """Find the smallest p for which every p-th section point is the same over the whole window.

    The points n, n + p, n + 2p, ... must all lie near one centre: slow drift and slow chaos differ
    little from point to point, but do over the window. The distance between repeats must not grow
    either, as it does when a motion leaves an unstable orbit.

    Args:
        points: (m, k) section points, each coordinate in units of the scale of the motion.
        noise: RMS of the measurement noise per coordinate, in the same units.
        max_period: largest period tried; each needs 5 repeats within the window.
        tolerance: largest RMS distance from the centres without noise.
    """
    threshold = float(max(tolerance, NOISE_MARGIN * noise))
    largest = min(max_period, len(points) // MIN_REPEATS)
    if largest < 1:
        reason = f"{len(points)} cycles are too few: a period needs {MIN_REPEATS} repeats"
        return Period(None, float("nan"), reason)
    residuals = [spread_of_repeats(points, p) for p in range(1, largest + 1)]
    fits = [p for p, residual in enumerate(residuals, start=1) if residual <= threshold]
    if not fits:
        nearest = int(np.argmin(residuals)) + 1
        reason = f"no repeat within {largest} cycles (nearest: P{nearest})"
        if largest < LEAST_LARGEST:
            return Period(None, min(residuals), f"{reason}, and too short to look on")
        return Period(0, min(residuals), reason)
    period = fits[0]
    if _grows(points, period, noise):
        return Period(0, residuals[period - 1], f"leaves a period of {period}")
    return Period(period, residuals[period - 1])


def spread_of_repeats(points: Array, period: int) -> float:
    """RMS distance per coordinate of points (m, k) from the centres of every ``period``-th."""
    groups = (points[first::period] for first in range(period))
    squares = sum(float(np.sum((group - group.mean(0)) ** 2)) for group in groups)
    return float(np.sqrt(squares / ((len(points) - period) * points.shape[1])))


def _grows(points: Array, period: int, noise: float) -> bool:
    """Whether the distance of repeats grows more than ``GROWTH`` times, first to last third."""
    returns = np.sqrt(np.mean((points[period:] - points[:-period]) ** 2, axis=1))
    third = max(len(returns) // 3, 1)
    early, late = float(np.median(returns[:third])), float(np.median(returns[-third:]))
    return late > GROWTH * max(early, noise, 1e-9)
