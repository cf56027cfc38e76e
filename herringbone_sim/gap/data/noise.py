"""How much noise a channel carries, when the campaign does not say."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def spectral_floor(values: Array, share: float = 0.2) -> Array:
    """Standard deviation (k,) of white noise on channels (n, k), from the top of their spectra.

    The median of the periodogram over the highest ``share`` of the band; a periodogram of white
    noise is exponential, whose median is log 2 of its mean. Motion that reaches so high adds to
    it, so this is an upper bound. NaN for a channel with NaN in it.
    """
    n = len(values)
    window = np.hanning(n)[:, None]
    power = np.abs(np.fft.rfft(values * window, axis=0)) ** 2 / np.sum(window**2)
    top = power[int(len(power) * (1.0 - share)) : -1]
    floor: Array = np.sqrt(np.median(top, axis=0) / np.log(2.0))
    return floor
