"""Put back the mean of rotations that lack it, see ``data.rotations``.

The nominal gear tells what it would be; how far the rig is from that is estimated with the motion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.integrate import simulate
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.sensors.correction import without_channels

# Mesh cycles of the nominal gear whose mean is taken, and those before it; chosen for run time.
MEAN_CYCLES, TRANSIENT_CYCLES = 300, 200


def with_nominal_levels(run: PreparedRun) -> PreparedRun:
    """Run whose rotations without a mean have that of the nominal gear at its operating point.

    Beside displacements of all meshes, which have theirs, such rotations are left out.
    """
    if not run.no_level:
        return run
    bodies = run.model.layout.bodies
    if run.x.complete:
        return replace(without_channels(run, run.no_level), no_level=())
    mean = _nominal_rotations(run)
    lost = np.array([f"u_{body}" in run.no_level for body in bodies])
    return replace(run, u=replace(run.u, values=run.u.values + np.where(lost, mean, 0.0)))


def _nominal_rotations(run: PreparedRun) -> Array:
    """(n_bodies,) mean rotations of the nominal gear [m]."""
    _, settled = simulate(run.model, TRANSIENT_CYCLES)
    series, _ = simulate(run.model, MEAN_CYCLES, settled)
    return np.array([series[f"u_{body}"].mean() for body in run.model.layout.bodies])
