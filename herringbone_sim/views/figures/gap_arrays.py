"""Data of the figures of a gap report, from the fit runs of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.gap.calibrated_fit import Calibrated
from herringbone_sim.gap.observations.reconstructed_forces import ReconstructedForces
from herringbone_sim.gap.residuals.recalibrate import ForceLaw, force_law
from herringbone_sim.views.figures.gap import GapArrays
from herringbone_sim.views.gear_geometry import MESHES
from herringbone_sim.views.numbers import figure

BINS = 24
FACTORS = {"T_1": "input torque [N m]", "delta_T": "temperature rise [K]", "Omega": "speed Ω"}


def gap_arrays(
    calibrated: Calibrated, forces: ReconstructedForces | None = None
) -> GapArrays | None:
    """Compute the data of the figures from the recalibrated force law of the fit runs.

    Args:
        calibrated: fit runs with the calibration of the nominal gear.
        forces: reconstructed forces to draw too.

    Returns:
        Data of all figures; the forces alone where the force law is not observed. None if there
        are no forces either, or if the model does not have the twelve meshes.
    """
    runs = [case.run for case in calibrated.cases]
    if any(run.model.layout.meshes != MESHES for run in runs):
        return None
    if calibrated.per_mesh is None:
        return None if forces is None else GapArrays(forces=forces)
    laws = [force_law(c.run, c.fused, calibrated.factors) for c in calibrated.cases]
    excess = [_excess(law) for law in laws]
    shares = {
        title: _by([float(run.point[name]) for run in runs], excess)
        for name, title in FACTORS.items()
        if sum(excess) > 0 and all(name in run.point for run in runs)
    }
    residual = np.concatenate([law.residual_n for law in laws])
    phase = np.concatenate([run.gear_phase for run in runs])
    centres = (np.arange(BINS) + 0.5) * 2.0 * np.pi / BINS
    return GapArrays(centres, mean_over_phase(phase, residual), _contact(laws), shares, forces)


def mean_over_phase(phase: Array, residual: Array) -> Array:
    """Average a residual (n, n_mesh) in BINS bins of the mesh phase (n,) [rad]: (BINS, n_mesh).

    NaN in bins without samples, and in bins of a mesh with a NaN among its samples.
    """
    place = np.floor(np.mod(phase / (2.0 * np.pi), 1.0) * BINS).astype(int) % BINS
    count = np.bincount(place, minlength=BINS)
    sums = [np.bincount(place, weights=column, minlength=BINS) for column in residual.T]
    mean: Array = np.stack(sums, axis=1) / np.where(count > 0, count, np.nan)[:, None]
    return mean


def _excess(law: ForceLaw) -> float:
    """Return the mean square residual above its noise variance, over recorded meshes [N^2]."""
    return max(float(np.nanmean(law.residual_n**2 - law.sigma_n**2)), 0.0)


def _by(values: Sequence[float], excess: Sequence[float]) -> dict[str, float]:
    """Return the fraction of the excess (n,) of n runs at each value of a factor, ascending."""
    total, shares = sum(excess), dict[str, float]()
    for value, part in sorted(zip(values, excess, strict=True)):
        shares[figure(value)] = shares.get(figure(value), 0.0) + part / total
    return shares


def _contact(laws: Sequence[ForceLaw]) -> Array:
    """Return the fraction of time (n_mesh, 3) on the driving flank, apart, on the back flank."""
    on = np.concatenate([law.contact for law in laws])
    drives = np.concatenate([law.x_m > 0.0 for law in laws])
    drive, back = (on * drives).mean(axis=0), (on * ~drives).mean(axis=0)
    shares: Array = np.stack([drive, 1.0 - drive - back, back], axis=1)
    return shares
