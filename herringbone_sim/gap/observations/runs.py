"""A run of a gear with its motion, as the observations need it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from herringbone_sim.gap.data.geometry import coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.law import Motion, motion_of
from herringbone_sim.gap.residuals.balance import FINE, between
from herringbone_sim.gap.residuals.fusion import Fused, fuse

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GearRun:
    """A run with its motion.

    Attributes:
        run, fused: measured, its best displacements.
        motion, some: as the law needs it, at every sample; at those that the force law is
            compared at.
    """

    run: PreparedRun
    fused: Fused
    motion: Motion
    some: Motion


def gear_run(run: PreparedRun, stride: int) -> GearRun:
    """A run with its best displacements, rates from them where none are recorded."""
    fused = with_rates(fuse(run), run)
    return GearRun(run, fused, motion_of(run, fused), motion_of(run, fused, stride))


def dense_motion(g: GearRun) -> Motion | None:
    """A motion at ``FINE`` points a sample, by cubics through values and rates; None without."""
    m, run = g.motion, g.run
    if not (np.isfinite(g.fused.z).all() and np.isfinite(g.fused.z_rate).all()):
        return None
    z, rate = between(g.fused.z, g.fused.z_rate, run.step_s, FINE)
    D = coordinates_to_meshes(run.model.layout)
    index = np.arange(len(z)) / FINE
    phase = np.interp(index, np.arange(len(run)), m.phase)
    w = m.waves_at(phase)
    n = np.full((len(z), m.F.shape[1]), np.nan)
    return replace(
        m,
        phase=phase,
        times=np.interp(index, np.arange(len(run)), m.times),
        x=z @ D.T - w.e,
        v=rate @ D.T - w.e_rate,
        F=np.stack([np.interp(index, np.arange(len(run)), f) for f in m.F.T], axis=1)
        if np.isfinite(m.F).all()
        else n,
        k=w.k,
        e=w.e,
        e_rate=w.e_rate,
    )


RATE_SAMPLES, RATE_ORDER = 7, 4  # of the polynomial that a missing rate is the slope of


def with_rates(fused: Fused, run: PreparedRun) -> Fused:
    """Rates as slopes of local polynomials through the displacements where they are missing."""
    if len(run) < RATE_SAMPLES or np.isfinite(fused.v).all():
        return fused
    h = run.step_s
    weights = savgol_coeffs(RATE_SAMPLES, RATE_ORDER, deriv=1, delta=h)
    noise = float(np.sum(weights**2))

    def slope(values: Array) -> Array:
        known = np.isfinite(values).all(axis=0)
        found = np.full_like(values, np.nan)
        if not known.any():
            return found
        found[:, known] = savgol_filter(
            values[:, known], RATE_SAMPLES, RATE_ORDER, deriv=1, delta=h, axis=0
        )
        return found

    v = np.where(np.isfinite(fused.v), fused.v, slope(fused.x))
    sigma_v = np.where(np.isfinite(fused.sigma_v), fused.sigma_v, fused.sigma_x * np.sqrt(noise))
    z_rate, cov = fused.z_rate, fused.z_rate_cov
    if np.isfinite(fused.z).all() and not np.isfinite(z_rate).all():
        z_rate, cov = slope(fused.z), fused.z_cov * noise
    return replace(fused, v=v, sigma_v=sigma_v, z_rate=z_rate, z_rate_cov=cov)
