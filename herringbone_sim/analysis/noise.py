"""How much white measurement noise a channel carries."""

from __future__ import annotations

import numpy as np
import scipy.fft

from herringbone_sim.core.timeseries import Array

TOP_SHARE = 0.2
WINDOW = 4096
WINDOWS = 12


def white_noise_rms(data: Array) -> Array:
    """RMS (k,) of the white noise in evenly sampled channels (n, k), an upper estimate.

    The median power of the highest fifth of the band stands for a noise that fills the band
    evenly; a median leaves the lines of a periodic motion out. A motion that still has power at
    the highest frequencies counts as noise, hence upper. NaN below 64 samples.
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
    """Lower quartile (k,) of the white noise RMS in 12 stretches of 4096 samples of a run (n, k).

    Noise of the measurement is there all the time; broad-band motion and steps are not.
    """
    starts = np.linspace(0, max(len(data) - WINDOW, 0), WINDOWS).astype(int)
    stretches = [white_noise_rms(data[start : start + WINDOW]) for start in np.unique(starts)]
    floor: Array = np.quantile(stretches, 0.25, axis=0)
    return floor
