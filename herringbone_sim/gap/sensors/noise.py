"""Estimate channel noise when campaign.yaml gives none, from consistency and the force law.

The spectrum of a channel is an upper bound, as it contains motion up to its highest frequencies.
The residuals of x, u and v about the geometry contain no motion, and that of F about the force law
little.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.gap.data.noise import spectral_floor
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.sensors.consistency import geometric_residuals

COPY = 1e-3  # residual over noise below which channels were computed from one another
LEAST = 0.3  # least noise of a force over that from its spectrum


def with_estimated_noise(run: PreparedRun) -> PreparedRun:
    """Lower the noise of each quantity to that of its residual; it is never raised.

    That of a channel of which it is told stays.
    """
    motion, rate = (_noise_ratio(residual) for residual, _ in geometric_residuals(run))
    run = replace(run, x=_scaled(run.x, motion), u=_scaled(run.u, motion), v=_scaled(run.v, rate))
    fused = fuse(run)
    law = force_law(run, fused, np.ones(6))
    known = np.isfinite(law.residual_n).all(axis=0)
    if not known.any():
        return run
    sigma = run.F.sigma.copy()
    total = spectral_floor(law.residual_n[:, known]) ** 2
    of_motion = np.mean(law.sigma_n[:, known] ** 2, axis=0) - sigma[known] ** 2
    of_force = np.sqrt(np.maximum(total - of_motion, (LEAST * sigma[known]) ** 2))
    sigma[known] = np.minimum(sigma[known], of_force)
    return replace(run, F=run.F.with_noise(sigma))


def _noise_ratio(residual: Array) -> float:
    """Noise of whitened residuals (n, d) over the assumed one, at most 1; 1 where unknown."""
    if not residual.size or not np.isfinite(residual).all():
        return 1.0
    ratio = float(np.sqrt(np.mean(spectral_floor(residual) ** 2)))
    return 1.0 if ratio < COPY else min(1.0, ratio)


def _scaled(measured: Measured, scale: float) -> Measured:
    return measured.with_noise(scale * measured.sigma)
