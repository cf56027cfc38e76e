"""Noise of a channel, estimated from its spectrum, and the resolution of its converter."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array

# Criteria of ``_grid_step``, chosen: RMS distance of points from the grid in steps (0.29 if there
# is no grid); fraction of all points that occupies a grid value; least number of occupied values.
OFF_GRID, STEP_SHARE, LEAST_STEPS = 0.1, 0.01, 3
LEAST_SPECTRUM = 32  # values: three lines of the spectrum in the fifth of highest frequencies


def spectral_floor(values: Array, share: float = 0.2) -> Array:
    """Estimate the standard deviation (k,) of white noise on channels (n, k) from their spectra.

    It follows from the median of the periodogram over the fraction ``share`` of highest
    frequencies: the periodogram of white noise is exponentially distributed, so its median is
    log 2 times its mean. Motion at these frequencies adds to it: an upper bound for white noise.
    Quantisation errors that repeat with the motion lie in spectral lines and are missed. Of a
    channel with gaps, see ``_floor_with_gaps``.
    """
    gaps = np.flatnonzero(np.isnan(values).any(axis=0) & ~np.isnan(values).all(axis=0))
    if len(gaps):
        sigma = np.full(values.shape[1], np.nan)
        whole = np.setdiff1d(np.arange(values.shape[1]), gaps)
        sigma[whole] = spectral_floor(values[:, whole], share)
        for j in gaps:
            sigma[j] = _floor_with_gaps(values[:, j], share)
        return sigma
    n = len(values)
    window = np.hanning(n)[:, None]
    power = np.abs(np.fft.rfft(values * window, axis=0)) ** 2 / np.sum(window**2)
    top = power[int(len(power) * (1.0 - share)) : -1]
    floor: Array = np.sqrt(np.median(top, axis=0) / np.log(2.0))
    return floor


def _floor_with_gaps(values: Array, share: float) -> float:
    """Estimate the noise of a channel (n,) with gaps from its longest part.

    Below ``LEAST_SPECTRUM`` values from fourth differences in all parts: the median of squares of
    normal values is 0.4549 of their variance, here 1 + 16 + 36 + 16 + 1 = 70 times the noise's.
    Where no part has five values, they go across the gaps, and the motion there adds to them.
    """
    longest = _longest_finite(values)
    if len(longest) >= LEAST_SPECTRUM:
        return float(spectral_floor(longest[:, None], share)[0])
    bends = np.diff(values, 4)
    if np.isnan(bends).all():
        bends = np.diff(values[np.isfinite(values)], 4)
    bends = bends[np.isfinite(bends)]
    return float(np.sqrt(np.median(bends**2) / (0.4549 * 70.0)) if len(bends) else np.nan)


def _longest_finite(values: Array) -> Array:
    """Return the longest part of values (n,) without NaN."""
    parts = np.split(values, np.flatnonzero(np.isnan(values)))
    longest = max(parts, key=len)
    return longest[np.isfinite(longest)]


def resolution(values: Array) -> Array:
    """Return the quantisation step (k,) of channels (n, k); 0 where none is detected.

    It is the step of an equidistant grid on which the values lie, or their second differences:
    those of evenly sampled counts of an encoder from which a steady rotation was subtracted.
    """
    return np.array([max(_grid_step(y, y), _grid_step(np.diff(y, 2), y)) for y in values.T])


def quantisation_noise(values: Array) -> Array:
    """Return the standard deviation (k,) of the quantisation error of channels (n, k)."""
    return np.asarray(resolution(values) / np.sqrt(12.0))


def at_least_quantisation(sigma: Array, values: Array) -> Array:
    """Raise the noise ``sigma`` (k,) of channels (n, k) to their quantisation noise; NaN stays."""
    raised: Array = np.where(np.isnan(sigma), np.nan, np.fmax(sigma, quantisation_noise(values)))
    return raised


def _grid_step(points: Array, values: Array) -> float:
    """Return the step of an equidistant grid on which ``points`` lie; 0 if they lie on none.

    Candidates are the smallest distance between neighbouring points, as of exact values, and the
    distance above the largest ratio in the sorted distances, as of values with rounding errors.
    ``values``: the channel that the points were computed from, for the size of rounding errors.
    """
    ordered = np.sort(points[np.isfinite(points)])
    gaps = np.diff(ordered)
    if not len(gaps):
        return 0.0
    sizes = np.sort(gaps[gaps > 1e-9 * (np.nanmax(values) - np.nanmin(values))])
    if len(sizes) < LEAST_STEPS - 1:
        return 0.0
    parting = 1 + int(np.argmax(sizes[1:] / sizes[:-1]))
    for step in (float(sizes[parting]), float(sizes[0])):
        apart = gaps > 0.5 * step
        first = np.flatnonzero(np.append(True, apart))  # first point at each grid value
        last = np.append(first[1:], len(ordered)) - 1
        met = np.sum(last - first + 1 >= STEP_SHARE * len(ordered)) >= LEAST_STEPS
        exact = step == sizes[0]
        if (met or exact) and np.max(ordered[last] - ordered[first]) < OFF_GRID * step:
            step = _refined(step, gaps[apart])
            off = gaps[apart] / step - np.rint(gaps[apart] / step)
            if np.sqrt(np.mean(off**2)) < OFF_GRID:
                return step
    return 0.0


def _refined(step: float, gaps: Array) -> float:
    """Refine a step by least squares on gaps that are multiples of it, small gaps first."""
    for reach in 1.5 * 2.0 ** np.arange(20):
        near = gaps[gaps < reach * step]
        whole = np.rint(near / step)
        step = float(np.sum(whole * near) / np.sum(whole**2)) if np.any(whole) else step
    return step
