"""Channels that are worked out of one another count once.

Where displacements follow from rotations to less than the noise that both carry, they are the same
measurement; where rates are slopes of displacements, likewise. The copy is left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.fusion import QUADRATURE, displacement, increments, velocity
from herringbone_sim.gap.sensors.consistency import geometry
from herringbone_sim.gap.sensors.corrected import drop

HALF = 0.5  # of the disagreement that independent noise would give


def independent(run: PreparedRun) -> PreparedRun:
    """The run without copies."""
    layout = run.model.layout
    by_mesh, by_body = (
        tuple(f"{q}_{name}" for name in names)
        for q, names in (("x", layout.meshes), ("u", layout.bodies))
    )
    left = geometry(run)[0][0]
    if run.u.complete and left.size and _rms(left) < HALF:
        run = drop(run, by_mesh)
    # Rates may be worked out of displacements, of rotations, or of both.
    if min(_apart(one) for one in (run, drop(run, by_mesh), drop(run, by_body))) < HALF:
        run = drop(run, tuple(f"v_{m}" for m in layout.meshes))
    return run


def _apart(run: PreparedRun) -> float:
    """Disagreement of rates with displacements, by their integral, central differences or a
    spline, over that of independent noise; infinite where there is nothing to compare."""
    z, P = displacement(run)
    rate, V = velocity(run)
    known = np.isfinite(np.diag(P)) & np.isfinite(np.diag(V))
    if not known.any():
        return np.inf
    h = run.step_s
    integral = (np.diff(z, axis=0) - increments(rate, h))[2:-2, known]
    slope = (np.gradient(z, h, axis=0) - rate)[1:-1, known]
    times = np.arange(len(z)) * h
    spline = (CubicSpline(times, z[:, known]).derivative()(times) - rate[:, known])[8:-8]
    impulse = CubicSpline(np.arange(33.0), np.eye(33)[16]).derivative()(np.arange(33.0))
    P, V = np.diag(P)[known], np.diag(V)[known]
    return min(
        _median_share(integral, 2.0 * P + h**2 * float(np.sum(QUADRATURE**2)) * V),
        _median_share(slope, 0.5 * P / h**2 + V),
        _median_share(spline, float(np.sum(impulse**2)) * P / h**2 + V),
    )


def _median_share(off: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    return float(np.median(np.sqrt(np.mean(off**2, axis=0) / expected)))


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
