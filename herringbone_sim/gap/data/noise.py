"""Noise of a channel, estimated from its spectrum, and the resolution of its converter."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array


def spectral_floor(values: Array, share: float = 0.2) -> Array:
    """Standard deviation (k,) of white noise on channels (n, k), from the top of their spectra.

    The median of the periodogram over the highest ``share`` of the band: the periodogram of white
    noise is exponentially distributed, so its median is log 2 times its mean. Motion at these
    frequencies adds to the estimate, which is therefore an upper bound. Of a channel with gaps,
    the longest part without gaps is used.
    """
    gaps = np.flatnonzero(np.isnan(values).any(axis=0) & ~np.isnan(values).all(axis=0))
    if len(gaps):
        sigma = np.full(values.shape[1], np.nan)
        whole = np.setdiff1d(np.arange(values.shape[1]), gaps)
        sigma[whole] = spectral_floor(values[:, whole], share)
        for j in gaps:
            sigma[j] = spectral_floor(_longest_finite(values[:, j])[:, None], share)[0]
        return sigma
    n = len(values)
    window = np.hanning(n)[:, None]
    power = np.abs(np.fft.rfft(values * window, axis=0)) ** 2 / np.sum(window**2)
    top = power[int(len(power) * (1.0 - share)) : -1]
    floor: Array = np.sqrt(np.median(top, axis=0) / np.log(2.0))
    return floor


def _longest_finite(values: Array) -> Array:
    """The longest part of values (n,) without NaN."""
    parts = np.split(values, np.flatnonzero(np.isnan(values)))
    longest = max(parts, key=len)
    return longest[np.isfinite(longest)]


def resolution(values: Array) -> Array:
    """Step (k,) of the converter or encoder of channels (n, k), sampled evenly; 0 without any.

    The smallest difference between two second differences: these lie on the grid of the steps even
    where a steady rotation was taken off an encoder's counts. Of continuous values it is close to
    zero.
    """
    least = 1e-9 * (np.fmax.reduce(values) - np.fmin.reduce(values))
    steps = np.diff(np.sort(np.diff(values, 2, axis=0), axis=0), axis=0)
    step: Array = np.where(steps > least, steps, np.inf).min(axis=0, initial=np.inf)
    return np.where(np.isfinite(step), step, 0.0)
