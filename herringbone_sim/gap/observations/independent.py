"""Channels that are worked out of one another count once.

Where displacements follow from rotations to less than the noise that both carry, they are the same
measurement; where rates are slopes of displacements, likewise. The copy is left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.fusion import QUADRATURE, displacement, increments, velocity
from herringbone_sim.gap.sensors.consistency import geometry
from herringbone_sim.gap.sensors.corrected import drop

HALF = 0.5  # of the disagreement that independent noise would give


def independent(run: PreparedRun) -> PreparedRun:
    """The run without copies."""
    layout = run.model.layout
    left = geometry(run)[0][0]
    if run.u.complete and left.size and _rms(left) < HALF:
        run = drop(run, tuple(f"x_{m}" for m in layout.meshes))
    z, P = displacement(run)
    rate, V = velocity(run)
    known = np.isfinite(np.diag(P)) & np.isfinite(np.diag(V))
    if known.any():
        h = run.step_s
        off = (np.diff(z, axis=0) - increments(rate, h))[2:-2, known]
        expected = (2.0 * P + h**2 * float(np.sum(QUADRATURE**2)) * V)[np.ix_(known, known)]
        share = np.sqrt(np.mean(off**2, axis=0) / np.diag(expected))
        if float(np.median(share)) < HALF:
            run = drop(run, tuple(f"v_{m}" for m in layout.meshes))
    return run


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
