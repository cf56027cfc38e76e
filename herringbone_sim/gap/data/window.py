"""A smooth window for averages and derivatives over samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import oaconvolve

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Window:
    """A Gaussian window and its derivative over the samples.

    Attributes:
        mean, slope: (w,) weights; those of the derivative [1/s].
        deviation: standard deviation in samples.
        step_s: time between samples [s].
    """

    mean: Array
    slope: Array
    deviation: float
    step_s: float

    def average(self, values: Array) -> Array:
        """Averages (n - w + 1, m) of values (n, m)."""
        average: Array = oaconvolve(values, self.mean[:, None], mode="valid", axes=0)
        return average

    def derivative(self, values: Array) -> Array:
        """Averages (n - w + 1, m) of the time derivative of values (n, m)."""
        rate: Array = oaconvolve(values, self.slope[:, None], mode="valid", axes=0)
        return rate

    def finer(self, parts: int) -> Window:
        return window(self.deviation * parts, self.step_s / parts)


def window(deviation: float, step_s: float) -> Window:
    """Gaussian window of a standard deviation in samples, and its derivative [1/s]."""
    reach = int(np.ceil(4.5 * deviation))
    j = np.arange(-reach, reach + 1)
    bell = np.exp(-0.5 * (j / deviation) ** 2)
    bell /= bell.sum()
    # A convolution turns the window round; the derivative of a ramp is its slope, to rounding.
    return Window(bell, -j * bell / (j * bell @ j) / step_s, deviation, step_s)
