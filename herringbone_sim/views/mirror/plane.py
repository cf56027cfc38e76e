"""Geometry of two-dimensional diagrams: limits, ticks, box; store of bifurcation points."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import ceil, floor, inf, log2, log10

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.analysis.sections import cubic
from herringbone_sim.arrays import Array, Indices

Range = tuple[float, float]


# Larger values are not drawn: limits that include them would overflow.
MOST = 1e150
# Least width of limits: the step of ticks would underflow below it.
LEAST_SPAN = 1e-150
# Least width of a bin of the parameter in a bifurcation diagram.
LEAST_BIN = 2.0**-40


def tick_step(span: float, count: int = 5) -> float:
    """Return 1, 2 or 5 times a power of ten that divides a span into ``count`` parts or fewer."""
    raw = span / count
    power = 10.0 ** floor(log10(raw))
    return float(next(m * power for m in (1, 2, 5, 10) if m * power >= raw * (1 - 1e-9)))


def ticks(limits: Range, count: int = 5) -> Array:
    """Return ascending round values within limits; empty unless these are a finite range."""
    if not 0.0 < limits[1] - limits[0] < inf:
        return np.empty(0)
    step = tick_step(limits[1] - limits[0], count)
    first, last = ceil(limits[0] / step - 1e-9), floor(limits[1] / step + 1e-9)
    return np.arange(first, last + 1, dtype=np.float64) * step


def limits_for(values: Array, before: Range | None = None, least_span: float = 1e-9) -> Range:
    """Return limits around all finite values, with a margin.

    Args:
        values: (n,); those not finite, or above 1e150, are ignored. Without any: about -1..1.
        before: earlier limits, returned again if they still include the values and are at most
            three times too wide, so that a live diagram does not move with every block.
        least_span: smallest difference of the limits.
    """
    finite = values[np.abs(values) < MOST]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (-1.0, 1.0)
    span = max(high - low, least_span, 1e-6 * max(abs(low), abs(high)), LEAST_SPAN)
    if before and before[0] <= low and high <= before[1] and before[1] - before[0] <= 3 * span:
        return before
    middle = (low + high) / 2
    return middle - 0.56 * span, middle + 0.56 * span


@dataclass(frozen=True)
class Axes:
    """Map from data, limits ``x`` and ``y``, to a box with its origin top left and y downwards."""

    x: Range
    y: Range
    width: float = 110.0
    height: float = 100.0

    def place(self, points: Array) -> NDArray[np.float32]:
        """Return the box coordinates (n, 2) of data points (n, 2)."""
        low = np.array([self.x[0], self.y[0]])
        span = np.array([self.x[1] - self.x[0], self.y[1] - self.y[0]])
        share = (np.asarray(points, dtype=np.float64).reshape(-1, 2) - low) / span
        boxed = np.column_stack((share[:, 0] * self.width, (1.0 - share[:, 1]) * self.height))
        return boxed.astype(np.float32)

    def vertical(self, x: float) -> Array:
        """Return the box coordinates (2, 2) of a line from bottom to top at data value ``x``."""
        at = (x - self.x[0]) / (self.x[1] - self.x[0]) * self.width
        return np.array([[at, self.height], [at, 0.0]])

    def horizontal(self, y: float) -> Array:
        """Return the box coordinates (2, 2) of a line from left to right at data value ``y``."""
        at = (1.0 - (y - self.y[0]) / (self.y[1] - self.y[0])) * self.height
        return np.array([[0.0, at], [self.width, at]])


class Bifurcation:
    """Store of the newest section points over a parameter, ``n_points`` in each of 400 bins.

    Bins by parameter value keep many points at one value from displacing those at others. Half of
    each bin is for a rising, half for a falling parameter, so that hysteresis shows. Bins are
    ``bin_width`` wide, a power of two that grows with the largest value; ``per_page``
    neighbouring bins form a page, the unit that is drawn again.
    """

    n_pages = 40
    per_page = 10
    n_points = 50

    def __init__(self) -> None:
        self.bin_width = 0.0
        self._bins: dict[int, dict[bool, deque[tuple[float, float, int]]]] = {}

    def add(self, x: Array, y: Array, state: Indices, rising: bool = True) -> set[int]:
        """Store points; return the numbers of the pages that have changed, all if the bins grow.

        The newest points displace the oldest of their bin and direction. Points whose parameter or
        section value is NaN or infinite are ignored.

        Args:
            x: (m,) parameter values.
            y: (m,) section values.
            state: (m,) contact states, indices into ``block.STATES``.
            rising: whether the parameter was rising, for all m points.
        """
        good = np.isfinite(x) & np.isfinite(y)
        points = list(zip(x[good].tolist(), y[good].tolist(), state[good].tolist(), strict=True))
        largest = max((abs(point[0]) for point in points), default=0.0)
        if largest >= self.bin_width * self._half and largest > 0:
            self.bin_width = self._width_for(largest)
            before, self._bins = self._bins, {}
            for ways in before.values():
                for way, stored in ways.items():
                    self._put(list(stored), way)
            self._put(points, rising)
            return set(range(self.n_pages))
        return self._put(points, rising)

    def page(self, page: int) -> Array:
        """Return the points (k, 3) of a page: parameter, section value, contact state."""
        first = page * self.per_page - self._half
        bins = (self._bins.get(i, {}) for i in range(first, first + self.per_page))
        points = [p for ways in bins for stored in ways.values() for p in stored]
        return np.array(points, dtype=np.float64).reshape(-1, 3)

    def points(self) -> Array:
        """Return the points (k, 3) of all pages."""
        return np.concatenate([self.page(page) for page in range(self.n_pages)])

    def _width_for(self, largest: float) -> float:
        return max(2.0 ** (floor(log2(max(largest, LEAST_BIN) / self._half)) + 1), LEAST_BIN)

    @property
    def _half(self) -> int:
        return self.n_pages * self.per_page // 2

    def _put(self, points: list[tuple[float, float, int]], rising: bool) -> set[int]:
        touched = set()
        for point in points:
            index = floor(point[0] / self.bin_width) if self.bin_width else 0
            ways = self._bins.setdefault(index, {})
            ways.setdefault(rising, deque(maxlen=self.n_points // 2)).append(point)
            touched.add((index + self._half) // self.per_page)
        return touched


def smooth(points: Array, n: int = 4) -> Array:
    """Return a Catmull-Rom spline ((m - 1) n + 1, 2) through points (m, 2); m < 3: unchanged."""
    if len(points) < 3:
        return points
    slopes = np.gradient(points, axis=0)
    left = np.repeat(np.arange(len(points) - 1), n)
    share = np.tile(np.arange(n) / n, len(points) - 1)
    ends = points[left], points[left + 1], slopes[left], slopes[left + 1]
    return np.vstack((cubic(*ends, share, np.ones(len(share))), points[-1:]))
