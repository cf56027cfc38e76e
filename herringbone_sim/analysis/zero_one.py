"""0-1 test for chaos on one recorded channel, without phase-space reconstruction.

Gottwald and Melbourne, SIAM J. Appl. Dyn. Syst. 8 (2009) 129-145, Eqs. (3.1)-(3.9), correlation
method: the series phi drives a walk in the plane, p += phi cos(j c), q += phi sin(j c). The walk
diffuses if the motion is chaotic (K near 1) and stays bounded if it is regular (K near 0).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.errors import AnalysisError

FREQUENCIES = 100
LOW, HIGH = np.pi / 5.0, 4.0 * np.pi / 5.0
LEAST = 300


@dataclass(frozen=True)
class ZeroOne:
    """Result of the 0-1 test for chaos.

    Attributes:
        K: median of the correlations, near 0 for regular and near 1 for chaotic motion.
        frequencies: (m,) c of each walk [rad per step].
        correlations: (m,) correlation of the mean square displacement of each walk with time.
    """

    K: float
    frequencies: Array
    correlations: Array


def zero_one_test(series: Array, rng: np.random.Generator) -> ZeroOne:
    """Test a scalar series for chaos by the 0-1 test.

    Sample once a mesh cycle: a series sampled much faster than it changes looks regular (K near 0)
    in any case. A series that is constant (a P1 motion) has K = 0 by definition. Weak chaos needs
    a longer series, and noise raises K.

    Args:
        series: (n,) at equal intervals, n at least 300, better 1000.
        rng: draws the frequencies c from pi/5 .. 4 pi/5, away from resonances with the sampling.

    Raises:
        AnalysisError: the series is too short or not finite.
    """
    phi = np.asarray(series, dtype=float)
    if phi.ndim != 1 or len(phi) < LEAST or not np.isfinite(phi).all():
        raise AnalysisError(
            f"the 0-1 test needs one finite series of {LEAST} values or more, got shape "
            f"{phi.shape}: record longer"
        )
    c = rng.uniform(LOW, HIGH, FREQUENCIES)
    if np.ptp(phi) <= 1e-9 * max(1.0, float(np.abs(phi).max())):
        return ZeroOne(0.0, c, np.zeros(FREQUENCIES))
    correlations = _correlations(phi, c)
    return ZeroOne(float(np.median(correlations)), c, correlations)


def walks(series: Array, frequencies: Array) -> NDArray[np.complex128]:
    """Walks p + i q (n, m), complex, driven by a series (n,) at the frequencies (m,)."""
    angle = np.outer(np.arange(1, len(series) + 1), frequencies)
    walk: NDArray[np.complex128] = np.cumsum(series[:, None] * np.exp(1j * angle), axis=0)
    return walk


def _correlations(phi: Array, c: Array) -> Array:
    """Correlation (m,) of the mean square displacement with time, for each frequency c (m,)."""
    walk = walks(phi, c)
    longest = len(phi) // 10
    lags = np.arange(1, longest + 1)
    count = len(phi) - longest
    squares = np.array([np.mean(np.abs(walk[n : n + count] - walk[:count]) ** 2, 0) for n in lags])
    # Subtract the oscillation caused by the mean of the series, Eq. (3.5).
    swing = phi.mean() ** 2 * (1.0 - np.cos(np.outer(lags, c))) / (1.0 - np.cos(c))
    growth = squares - swing
    centred = growth - growth.mean(axis=0)
    time = (lags - lags.mean())[:, None]
    spread = np.sqrt((time**2).sum() * (centred**2).sum(axis=0))
    result: Array = (time * centred).sum(axis=0) / np.maximum(spread, 1e-300)
    return result
