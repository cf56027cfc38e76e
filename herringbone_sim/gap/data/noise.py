"""How much noise a channel carries, when the campaign does not say."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def spectral_floor(values: Array, share: float = 0.2) -> Array:
    """Standard deviation (k,) of white noise on channels (n, k), from the top of their spectra.

    The median of the periodogram over the highest ``share`` of the band; a periodogram of white
    noise is exponential, whose median is log 2 of its mean. Motion that reaches so high adds to
    it, so this is an upper bound. A channel with gaps is judged by its longest part without.
    """
    gaps = np.flatnonzero(np.isnan(values).any(axis=0) & ~np.isnan(values).all(axis=0))
    if len(gaps):
        found = np.full(values.shape[1], np.nan)
        whole = np.setdiff1d(np.arange(values.shape[1]), gaps)
        found[whole] = spectral_floor(values[:, whole], share)
        for j in gaps:
            found[j] = spectral_floor(longest(values[:, j])[:, None], share)[0]
        return found
    n = len(values)
    window = np.hanning(n)[:, None]
    power = np.abs(np.fft.rfft(values * window, axis=0)) ** 2 / np.sum(window**2)
    top = power[int(len(power) * (1.0 - share)) : -1]
    floor: Array = np.sqrt(np.median(top, axis=0) / np.log(2.0))
    return floor


def longest(values: Array) -> Array:
    """The longest part of values (n,) without NaN."""
    parts = np.split(values, np.flatnonzero(np.isnan(values)))
    most = max(parts, key=len)
    return most[np.isfinite(most)]
