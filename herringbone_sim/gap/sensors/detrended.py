"""Rotations that lack their mean, see ``data.rotations``: leave them out, or put a mean back.

Where other channels allow the force law or the torque balance, such rotations are left out of all
runs. Where windows of the motion are all that is possible, the nominal gear tells their mean; how
far the rig is from that is estimated with the motion.
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

# Mesh cycles of the nominal gear whose mean is taken, and those before it; chosen for run time.
MEAN_CYCLES, TRANSIENT_CYCLES = 300, 200


def settle_detrended(runs: Sequence[PreparedRun]) -> list[PreparedRun]:
    """Runs with the mean of the nominal gear in rotations without one, or without such rotations.

    The fit runs decide for all.
    """
    kept = only_windows_possible(runs)
    return [with_nominal_means(run) if kept else without_detrended(run) for run in runs]


def only_windows_possible(runs: Sequence[PreparedRun]) -> bool:
    """Whether the fit runs allow nothing but windows of the motion without such rotations."""
    fit = deciding(runs)
    if all(run.means_known for run in fit) or not all(run.shafts_known for run in fit):
        return False
    others = [without_detrended(run) for run in fit]
    return not all(map(_law_or_balance, others))


def without_detrended(run: PreparedRun) -> PreparedRun:
    """Run without the rotations that lack their mean."""
    return replace(without_channels(run, run.detrended), detrended=())


def with_nominal_means(run: PreparedRun) -> PreparedRun:
    """Run whose rotations without a mean have that of the nominal gear at its operating point."""
    if run.means_known:
        return run
    lost = np.array([f"u_{body}" in run.detrended for body in run.model.layout.bodies])
    mean = np.where(lost, _nominal_rotations(run), 0.0)
    return replace(run, u=replace(run.u, values=run.u.values + mean))


def _law_or_balance(run: PreparedRun) -> bool:
    """Whether force and displacement of a mesh are known, or the motion of all bodies."""
    fused = fuse(run)
    known = np.isfinite(fused.x).all(axis=0) & np.isfinite(run.F.values).all(axis=0)
    return bool(known.any() or np.isfinite(fused.z).all())


def _nominal_rotations(run: PreparedRun) -> Array:
    """(n_bodies,) mean rotations of the nominal gear [m]."""
    _, settled = simulate(run.model, TRANSIENT_CYCLES)
    series, _ = simulate(run.model, MEAN_CYCLES, settled)
    return np.array([series[f"u_{body}"].mean() for body in run.model.layout.bodies])
