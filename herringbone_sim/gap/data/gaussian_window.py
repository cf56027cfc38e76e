"""Gaussian window for moving averages of samples and of their time derivative."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import oaconvolve, upfirdn

from herringbone_sim.arrays import Array


@dataclass(frozen=True)
class Window:
    """A Gaussian window and its derivative, for convolution with samples.

    Attributes:
        mean: (w,) weights of the average; they sum to 1.
        slope: (w,) weights of the average time derivative [1/s].
        deviation: standard deviation [samples].
        step_s: time between samples [s].
    """

    mean: Array
    slope: Array
    deviation: float
    step_s: float

    def average(self, values: Array) -> Array:
        """Return the moving averages (n - w + 1, m) of values (n, m)."""
        average: Array = oaconvolve(values, self.mean[:, None], mode="valid", axes=0)
        return average

    def averages(self, values: Array, stride: int) -> Array:
        """Every ``stride``-th moving average (m, k) of each of m signals (m, n)."""
        first = len(self.mean) - 1  # index of the first whole average in a full convolution
        lead = -first % stride
        every = upfirdn(self.mean, np.pad(values, ((0, 0), (lead, 0))), 1, stride, axis=1)
        count = (values.shape[1] - first - 1) // stride + 1
        begin = (first + lead) // stride
        return np.asarray(every[:, begin : begin + count])

    def derivative(self, values: Array) -> Array:
        """Return the moving averages (n - w + 1, m) of the time derivative of values (n, m)."""
        rate: Array = oaconvolve(values, self.slope[:, None], mode="valid", axes=0)
        return rate

    def finer(self, parts: int) -> Window:
        """Return a window of the same duration for samples ``parts`` times as dense."""
        return gaussian_window(self.deviation * parts, self.step_s / parts)


def gaussian_window(deviation: float, step_s: float) -> Window:
    """Return a Gaussian window of given standard deviation [samples], cut at 4.5 of them."""
    reach = int(np.ceil(4.5 * deviation))
    j = np.arange(-reach, reach + 1)
    bell = np.exp(-0.5 * (j / deviation) ** 2)
    bell /= bell.sum()
    # Convolution reverses the weights; scaled so that a ramp gives its slope to rounding.
    return Window(bell, -j * bell / (j * bell @ j) / step_s, deviation, step_s)
