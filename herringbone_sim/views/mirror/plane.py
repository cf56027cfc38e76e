"""Geometry of diagrams whose axes are drawn as data: limits, ticks, box; bifurcation points."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import ceil, floor, inf, log2, log10

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array, Indices

Range = tuple[float, float]


# Larger values are not drawn: limits that include them would overflow.
MOST = 1e150
# Least width of limits: the step of ticks would underflow below it.
LEAST_SPAN = 1e-150
# Least width of a bin of the parameter in a bifurcation diagram.
LEAST_BIN = 2.0**-40


def tick_step(span: float, count: int = 5) -> float:
    """The 1, 2 or 5 times a power of ten that cuts a span into at most about ``count`` parts."""
    raw = span / count
    power = 10.0 ** floor(log10(raw))
    return float(next(m * power for m in (1, 2, 5, 10) if m * power >= raw * (1 - 1e-9)))


def ticks(limits: Range, count: int = 5) -> Array:
    """Round values within limits, rising; none where the limits are no range."""
    if not 0.0 < limits[1] - limits[0] < inf:
        return np.empty(0)
    step = tick_step(limits[1] - limits[0], count)
    first, last = ceil(limits[0] / step - 1e-9), floor(limits[1] / step + 1e-9)
    return np.arange(first, last + 1, dtype=np.float64) * step


def limits_for(values: Array, before: Range | None = None, least_span: float = 1e-9) -> Range:
    """Limits around all finite values with a margin.

    Args:
        values: (n,), any finite number of them.
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
    """A box of width x height with its origin top left and y downwards; limits in data units."""

    x: Range
    y: Range
    width: float = 110.0
    height: float = 100.0

    def place(self, points: Array) -> NDArray[np.float32]:
        """Box coordinates (n, 2) of data points (n, 2)."""
        low = np.array([self.x[0], self.y[0]])
        span = np.array([self.x[1] - self.x[0], self.y[1] - self.y[0]])
        share = (np.asarray(points, dtype=np.float64).reshape(-1, 2) - low) / span
        boxed = np.column_stack((share[:, 0] * self.width, (1.0 - share[:, 1]) * self.height))
        return boxed.astype(np.float32)

    def vertical(self, x: float) -> Array:
        """Box coordinates (2, 2) of a line from bottom to top."""
        at = (x - self.x[0]) / (self.x[1] - self.x[0]) * self.width
        return np.array([[at, self.height], [at, 0.0]])

    def horizontal(self, y: float) -> Array:
        """Box coordinates (2, 2) of a line from left to right."""
        at = (1.0 - (y - self.y[0]) / (self.y[1] - self.y[0])) * self.height
        return np.array([[0.0, at], [self.width, at]])


class Bifurcation:
    """The newest section values over a parameter, at most ``n_bins`` bins of ``n_points`` each.

    Points are kept by the value of the parameter, so that an hour at one value displaces nothing
    that was seen at another, and apart for a rising and a falling parameter, so that hysteresis
    shows. Bins are ``bin_width`` wide, a power of two that doubles as larger
    values come; ``per_page`` neighbouring bins form a page, the unit that is drawn anew.
    """

    per_page = 10

    def __init__(self, n_bins: int = 400, n_points: int = 50) -> None:
        self.n_pages = n_bins // self.per_page
        self.n_points = n_points
        self.bin_width = 0.0
        self._bins: dict[int, dict[bool, deque[tuple[float, float, int]]]] = {}

    def __len__(self) -> int:
        return sum(len(kept) for ways in self._bins.values() for kept in ways.values())

    def add(self, x: Array, y: Array, state: Indices, rising: bool = True) -> set[int]:
        """Take points (m,) with their contact states (m,); which pages have changed."""
        good = np.isfinite(x) & np.isfinite(y)
        points = list(zip(x[good].tolist(), y[good].tolist(), state[good].tolist(), strict=True))
        largest = max((abs(point[0]) for point in points), default=0.0)
        if largest >= self.bin_width * self._half and largest > 0:
            self.bin_width = self._width_for(largest)
            before, self._bins = self._bins, {}
            for ways in before.values():
                for way, kept in ways.items():
                    self._put(list(kept), way)
            self._put(points, rising)
            return set(range(self.n_pages))
        return self._put(points, rising)

    def page(self, page: int) -> Array:
        """Points (k, 3) of a page: parameter, section value, contact state."""
        first = page * self.per_page - self._half
        bins = (self._bins.get(i, {}) for i in range(first, first + self.per_page))
        points = [p for ways in bins for kept in ways.values() for p in kept]
        return np.array(points, dtype=np.float64).reshape(-1, 3)

    def points(self) -> Array:
        """All points (k, 3)."""
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
    """Catmull-Rom spline ((m - 1) n + 1, 2) through samples (m, 2), for orbits of few samples."""
    if len(points) < 3:
        return points
    before = np.vstack((2 * points[0] - points[1], points[:-2]))
    after = np.vstack((points[2:], 2 * points[-1] - points[-2]))
    a, b = points[:-1], points[1:]
    u = (np.arange(n) / n)[None, :, None]
    slope_a, slope_b = (b - before)[:, None] / 2, (after - a)[:, None] / 2
    a, b = a[:, None], b[:, None]
    curve = (
        (2 * u**3 - 3 * u**2 + 1) * a
        + (u**3 - 2 * u**2 + u) * slope_a
        + (3 * u**2 - 2 * u**3) * b
        + (u**3 - u**2) * slope_b
    )
    return np.vstack((curve.reshape(-1, 2), points[-1:]))
