"""RMS of the white measurement noise of a channel."""

from __future__ import annotations

import numpy as np
import scipy.fft

from herringbone_sim.arrays import Array

TOP_SHARE = 0.2
WINDOW = 4096
WINDOWS = 12


def white_noise_rms(data: Array) -> Array:
    """Estimate the RMS (k,) of the white noise in evenly sampled channels (n, k), from above.

    From the median power in the highest fifth of the band; a median is not affected by the
    spectral lines of a periodic motion. Broad-band motion at these frequencies counts as noise, so
    the estimate is an upper bound. NaN for fewer than 64 samples.
    """
    n = len(data)
    if n < 64:
        return np.full(data.shape[1], np.nan)
    window = np.hanning(n)[:, None]
    power = np.abs(scipy.fft.rfft((data - data.mean(0)) * window, axis=0)) ** 2
    top = power[int((1 - TOP_SHARE) * len(power)) : -1]
    # Power of white noise in one bin is exponentially distributed: mean = median / ln 2.
    mean: Array = np.median(top, axis=0) / np.log(2) / np.sum(window**2)
    return np.sqrt(mean)


def noise_floor(data: Array) -> Array:
    """Estimate the RMS (k,) of the stationary white noise of channels (n, k).

    The lower quartile of ``white_noise_rms`` over 12 windows of 4096 samples: measurement noise is
    present in the quietest windows too; broad-band motion and steps are not.
    """
    starts = np.linspace(0, max(len(data) - WINDOW, 0), WINDOWS).astype(int)
    stretches = [white_noise_rms(data[start : start + WINDOW]) for start in np.unique(starts)]
    floor: Array = np.quantile(stretches, 0.25, axis=0)
    return floor
