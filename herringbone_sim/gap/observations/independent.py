"""Channels that are worked out of one another count once.

Where displacements follow from rotations to less than the noise that both carry, they are the same
measurement; where rates are slopes of displacements, likewise. The copy is left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from herringbone_sim.gap.data.geometry import coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.fusion import QUADRATURE, displacement, increments
from herringbone_sim.gap.sensors.consistency import geometric_residuals
from herringbone_sim.gap.sensors.correction import without_channels

HALF = 0.5  # of the disagreement that independent noise would give
# Of a spline through white noise, a sample apart: squares of its slope over those of the noise.
OF_SPLINE = float(
    np.sum(CubicSpline(np.arange(33.0), np.eye(33)[16]).derivative()(np.arange(33.0)) ** 2)
)


def independent(run: PreparedRun) -> PreparedRun:
    """The run without copies."""
    layout = run.model.layout
    by_mesh, by_body = (
        tuple(f"{q}_{name}" for name in names)
        for q, names in (("x", layout.meshes), ("u", layout.bodies))
    )
    left = geometric_residuals(run)[0][0]
    if run.u.complete and left.size and _rms(left) < HALF:
        run = without_channels(run, by_mesh)
    # Rates may be worked out of displacements, mesh by mesh or all, of rotations, or of both.
    D = coordinates_to_meshes(layout)
    every = [
        displacement(one)
        for one in (run, without_channels(run, by_mesh), without_channels(run, by_body))
    ]
    found = [_apart(run, run.x.values + run.waves.e, run.x.sigma**2)]
    found += [_apart(run, z @ D.T, np.diag(D @ P @ D.T)) for z, P in every]
    share = min(found, key=lambda one: float(np.median(one)))
    if np.median(share) < HALF:
        # One that is off all the same has an error of its own.
        own = zip(layout.meshes, share, strict=True)
        run = without_channels(run, tuple(f"v_{mesh}" for mesh, off in own if off < HALF))
    return run


def _apart(
    run: PreparedRun, x: NDArray[np.float64], of_x: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n_mesh,) disagreement of rates with those of displacements x (n, n_mesh) [m] of variance
    of_x, by their integral, central differences or a spline, over that of independent noise;
    infinite where there is nothing to compare."""
    h = run.step_s
    known = run.v.there & np.isfinite(x).all(axis=0)
    found = np.full(len(known), np.inf)
    if not known.any():
        return found
    x, rate = x[:, known], (run.v.values + run.waves.e_rate)[:, known]
    of_x, of_v = of_x[known], run.v.sigma[known] ** 2
    integral = (np.diff(x, axis=0) - increments(rate, h))[2:-2]
    slope = (np.gradient(x, h, axis=0) - rate)[1:-1]
    times = np.arange(len(x)) * h
    spline = (CubicSpline(times, x).derivative()(times) - rate)[8:-8]
    shares = [
        np.mean(off**2, axis=0) / expected
        for off, expected in (
            (integral, 2.0 * of_x + h**2 * float(np.sum(QUADRATURE**2)) * of_v),
            (slope, 0.5 * of_x / h**2 + of_v),
            (spline, OF_SPLINE * of_x / h**2 + of_v),
        )
    ]
    found[known] = np.sqrt(np.min(shares, axis=0))
    return found


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
