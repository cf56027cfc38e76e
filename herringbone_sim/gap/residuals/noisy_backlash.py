"""Mean and variance of the backlash function of a noisy displacement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from herringbone_sim.arrays import Array


@dataclass(frozen=True)
class NoisyBacklash:
    """Backlash function f of a displacement with Gaussian noise; arrays (n, n_mesh).

    Attributes:
        f: expectation of the backlash function, Eqs. (1), (4) [m].
        variance: variance of the backlash function [m^2].
        contact: probability of contact, which equals the derivative of ``f`` by x.
    """

    f: Array
    variance: Array
    contact: Array


def noisy_backlash(x: Array, half_backlash: Array, sigma: Array) -> NoisyBacklash:
    """Return mean and variance of the backlash function f over the Gaussian noise of x.

    The value of f at the noisy x itself would be biased near the edges of the backlash.

    Args:
        x: (n, n_mesh) displacement [m].
        half_backlash: (n_mesh,) b' [m].
        sigma: (n_mesh,) standard deviation of the noise of x [m]; NaN counts as zero.
    """
    s = np.maximum(np.nan_to_num(sigma), 1e-15)
    drive, drive_square, on = _ramp(x - half_backlash, s)
    back, back_square, off = _ramp(-x - half_backlash, s)
    f = drive - back
    variance = np.maximum(drive_square + back_square - f**2, 0.0)
    return NoisyBacklash(f, variance, on + off)


def _ramp(over: Array, sigma: Array) -> tuple[Array, Array, Array]:
    """Return E[max(y, 0)], E[max(y, 0)^2] and P(y > 0) for y ~ N(over, sigma^2)."""
    z = over / sigma
    odds = ndtr(z)
    bell = sigma * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    mean = over * odds + bell
    return mean, (over**2 + sigma**2) * odds + over * bell, odds
