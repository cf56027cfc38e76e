"""How much noise a run carries where nobody says, by what channels say of each other and the law.

The spectrum of a violent channel has motion up to its end, and is an upper bound only. What
geometry leaves of x, u and v has none, and what the force law leaves of F has little.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.data.noise import spectral_floor
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.sensors.consistency import geometry

Array = NDArray[np.float64]

COPY = 1e-3  # of the noise: less is left of channels that were worked out of one another
LEAST = 0.3  # of the noise by the spectrum of a force, where x and v explain all of the residual


def quieter(run: PreparedRun) -> PreparedRun:
    """The run with the lesser noise of the two."""
    place, rate = (_scale(left) for left, _ in geometry(run))
    run = replace(run, x=_scaled(run.x, place), u=_scaled(run.u, place), v=_scaled(run.v, rate))
    fused = fuse(run)
    law = force_law(run, fused, np.ones(6))
    known = np.isfinite(law.residual_n).all(axis=0)
    if not known.any():
        return run
    sigma = run.F.sigma.copy()
    left = spectral_floor(law.residual_n[:, known]) ** 2
    of_motion = np.mean(law.sigma_n[:, known] ** 2, axis=0) - sigma[known] ** 2
    own = np.sqrt(np.maximum(left - of_motion, (LEAST * sigma[known]) ** 2))
    sigma[known] = np.minimum(sigma[known], own)
    return replace(run, F=replace(run.F, sigma=sigma))


def _scale(left: Array) -> float:
    """Noise over what it was taken for, of whitened remainders (n, d); 1 where it is not less."""
    if not left.size or not np.isfinite(left).all():
        return 1.0
    share = float(np.sqrt(np.mean(spectral_floor(left) ** 2)))
    return 1.0 if share < COPY else min(1.0, share)


def _scaled(measured: Measured, scale: float) -> Measured:
    return replace(measured, sigma=scale * measured.sigma)
