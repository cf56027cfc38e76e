"""A prepared run with the mesh motions from which observations are formed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from herringbone_sim.arrays import Array
from herringbone_sim.gap.data.kinematics import coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.common_filter import with_filter_responses
from herringbone_sim.gap.residuals.fusion import Fused, fuse
from herringbone_sim.gap.residuals.mesh_law import MeshMotion, mesh_motion
from herringbone_sim.gap.residuals.torque_balance import FINE, hermite_interpolation


@dataclass(frozen=True)
class GearRun:
    """A run with its mesh motion.

    Attributes:
        run, fused: measured channels, and displacements fused from all of them.
        motion: mesh motion at every sample.
        strided: at the samples at which the force law is compared.
        dense: interpolated at ``FINE`` points per sample; None unless displacements and rates of
            all bodies are known.
    """

    run: PreparedRun
    fused: Fused
    motion: MeshMotion
    strided: MeshMotion
    dense: MeshMotion | None


def gear_run(run: PreparedRun, stride: int) -> GearRun:
    """Fuse the channels of a run, fill in missing rates, and form its motions."""
    fused = fuse_with_rates(run)
    motion, some = mesh_motion(run, fused), mesh_motion(run, fused, stride)
    dense = _dense(run, fused, motion)
    if dense is not None and dense.filtered is not None:
        motion = replace(motion, filtered=dense.filtered[:, ::FINE])
        some = replace(some, filtered=dense.filtered[:, :: FINE * stride])
    return GearRun(run, fused, motion, some, dense)


def _dense(run: PreparedRun, fused: Fused, m: MeshMotion) -> MeshMotion | None:
    """Motion at ``FINE`` points per sample by cubic Hermite interpolation; None if unknown."""
    if not (np.isfinite(fused.z).all() and np.isfinite(fused.z_rate).all()):
        return None
    z, rate = hermite_interpolation(fused.z, fused.z_rate, run.step_s, FINE)
    D = coordinates_to_meshes(run.model.layout)
    index = np.arange(len(z)) / FINE
    phase = np.interp(index, np.arange(len(run)), m.phase)
    w = m.waves_at(phase)
    n = np.full((len(z), m.F.shape[1]), np.nan)
    dense = replace(
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
    return with_filter_responses(dense, run.model.scales.omega_n)


# Savitzky-Golay filters (samples, order) tried for rates, chosen; the last has least bias.
SLOPE_FILTERS = ((7, 4), (9, 6), (11, 8), (9, 8))


def polynomial_rates(values: Array, sigma: Array, step: float) -> tuple[Array, Array]:
    """Differentiate values (n, k) by local polynomials, noise ``sigma`` (k,), ``step`` in s.

    Each column takes the filter of least mean square error: noise variance plus squared bias,
    estimated from the difference to the least biased filter.

    Returns:
        Rates (n, k) and their noise over that of the values (k,) [1/s].
    """
    filters = [savgol_coeffs(n, order, deriv=1, delta=step) for n, order in SLOPE_FILTERS]
    middle = max(n for n, _ in SLOPE_FILTERS) // 2
    weights = np.array([np.pad(w, middle - len(w) // 2) for w in filters])
    best = savgol_filter(values, *SLOPE_FILTERS[-1], deriv=1, delta=step, axis=0)
    rates, least = best, np.sum(weights[-1] ** 2) * sigma**2
    noise = np.full(values.shape[1], np.sum(weights[-1] ** 2))
    for (n, order), w in zip(SLOPE_FILTERS[:-1], weights[:-1], strict=True):
        other = savgol_filter(values, n, order, deriv=1, delta=step, axis=0)
        apart = np.mean((other - best) ** 2, axis=0) - np.sum((w - weights[-1]) ** 2) * sigma**2
        error = np.maximum(apart, 0.0) + np.sum(w**2) * sigma**2
        better = error < least
        rates = np.where(better, other, rates)
        least, noise = np.where(better, error, least), np.where(better, np.sum(w**2), noise)
    return rates, np.sqrt(noise)


def fuse_with_rates(run: PreparedRun) -> Fused:
    """Fuse the channels of a run; missing rates are slopes of the displacements.

    Where the run is too short for slopes, they stay missing.
    """
    fused = fuse(run)
    if len(run) < max(n for n, _ in SLOPE_FILTERS) or np.isfinite(fused.v).all():
        return fused

    def slope(values: Array, sigma: Array) -> tuple[Array, Array]:
        known = np.isfinite(values).all(axis=0)
        rates, noise = np.full_like(values, np.nan), np.full(values.shape[1], np.nan)
        if known.any():
            rates[:, known], noise[known] = polynomial_rates(
                values[:, known], sigma[known], run.step_s
            )
        return rates, noise

    rate, noise = slope(fused.x, fused.sigma_x)
    v = np.where(np.isfinite(fused.v), fused.v, rate)
    sigma_v = np.where(np.isfinite(fused.sigma_v), fused.sigma_v, fused.sigma_x * noise)
    z_rate, cov = fused.z_rate, fused.z_rate_cov
    if np.isfinite(fused.z).all() and not np.isfinite(z_rate).all():
        z_rate, noise = slope(fused.z, np.sqrt(np.diag(fused.z_cov)))
        cov = fused.z_cov * np.outer(noise, noise)
    return replace(fused, v=v, sigma_v=sigma_v, z_rate=z_rate, z_rate_cov=cov)
