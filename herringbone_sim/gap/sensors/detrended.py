"""Rotations that lack their mean, see ``data.rotations``: remove them, or add a nominal mean.

Where other channels allow the force law or the torque balance, such rotations are removed from all
runs. Where only trajectories in windows can be fitted, they get the mean of the nominal gear; the
deviation of the rig from it is estimated with the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.integrate import simulate
from herringbone_sim.gap.data.prepared import PreparedRun, deciding
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.sensors.correction import without_channels

# Mesh cycles of the nominal gear that are averaged, and those before them; chosen for run time.
MEAN_CYCLES, TRANSIENT_CYCLES = 300, 200


def settle_detrended(runs: Sequence[PreparedRun]) -> list[PreparedRun]:
    """Give rotations that lack their mean that of the nominal gear, or remove such rotations.

    All runs are treated alike, by ``only_windows_possible`` of the fit runs.
    """
    windows_only = only_windows_possible(runs)
    return [with_nominal_means(run) if windows_only else without_detrended(run) for run in runs]


def only_windows_possible(runs: Sequence[PreparedRun]) -> bool:
    """Whether fit runs allow only trajectory windows without the rotations that lack their mean.

    False if no rotation lacks its mean, or if not all fit runs have the shafts that windows need.
    """
    fit = deciding(runs)
    if all(run.means_known for run in fit) or not all(run.shafts_known for run in fit):
        return False
    others = [without_detrended(run) for run in fit]
    return not all(map(_law_or_balance, others))


def without_detrended(run: PreparedRun) -> PreparedRun:
    """Mark the rotations of a run that lack their mean as not recorded."""
    return replace(without_channels(run, run.detrended), detrended=())


def with_nominal_means(run: PreparedRun) -> PreparedRun:
    """Add the mean of the nominal gear at the operating point to rotations that lack one."""
    if run.means_known:
        return run
    lost = np.array([f"u_{body}" in run.detrended for body in run.model.layout.bodies])
    mean = np.where(lost, _nominal_rotations(run), 0.0)
    return replace(run, u=replace(run.u, values=run.u.values + mean))


def _law_or_balance(run: PreparedRun) -> bool:
    """Whether force and displacement of a mesh are known, or all coordinates."""
    fused = fuse(run)
    known = np.isfinite(fused.x).all(axis=0) & np.isfinite(run.F.values).all(axis=0)
    return bool(known.any() or np.isfinite(fused.z).all())


def _nominal_rotations(run: PreparedRun) -> Array:
    """Simulate the nominal gear; return its mean rotations (n_bodies,) [m]."""
    _, settled = simulate(run.model, TRANSIENT_CYCLES)
    series, _ = simulate(run.model, MEAN_CYCLES, settled)
    return np.array([series[f"u_{body}"].mean() for body in run.model.layout.bodies])
