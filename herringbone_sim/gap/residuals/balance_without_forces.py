"""Torque balance of runs without force sensors, with the forces of the calibrated force law.

Eight accelerations depend on twelve mesh forces, so that meshes on the same body can't be
separated, nor can a common factor on all forces be separated from the inertias. The noise of the
residual is estimated by passing a realisation of the sensor noise through fusion and force law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.gap.data.mesh_excitation import Waves
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.residuals.fusion import Fused, fuse
from herringbone_sim.gap.residuals.recalibrate import (
    BOUNDS,
    HEAVIEST,
    LIGHTEST,
    bounded_step,
    by_mesh,
    force_function,
    force_law,
)
from herringbone_sim.gap.residuals.torque_balance import (
    Balance,
    averaged_law_force,
    inertia_parts,
    quadrature_correction,
    torque_balance,
    window_of,
)

SEED = 20  # of the noise realisation
WIDTH = 0.08  # of the window, mesh cycles: averages the noise of dv/dt, but passes order 3


def motion_balance(
    run: PreparedRun, fused: Fused, noise: Fused, factors: Array, inverse: Array
) -> Balance:
    """Return the torque balance of a run with the mesh forces of the force law.

    That is the measured accelerations of the coordinates and those expected [m/s^2], averaged over
    a window of ``WIDTH``; recorded forces are not used.

    Args:
        run: with x (or u) and v.
        fused: its fused motion; x and v must not be NaN at any mesh.
        noise: ``fused_noise`` of the run.
        factors: (6,) on k, c and e, in the order of ``recalibrate.NAMES``.
        inverse: (3,) factors on 1/M_s, 1/M_p, 1/M_c.
    """
    law = force_law(run, fused, factors)
    k_f, _, _ = by_mesh(factors, run.x.recorded.size)
    k, c = run.waves.k * k_f, run.model.damping_n_s_per_m
    force_noise = k * law.contact * noise.x + c * noise.v
    force = averaged_law_force(window_of(run, WIDTH), law.modelled_n, force_noise)
    correction = quadrature_correction(run, fused, force_function(run, factors), WIDTH)
    force = replace(force, average_n=force.average_n + correction, correction_n=correction)
    return torque_balance(run, fused, inverse, force, WIDTH)


def fused_noise(run: PreparedRun, rng: np.random.Generator) -> Fused:
    """Fuse a realisation of the sensor noise alone: the noise of z, x, v and their rates."""
    none = np.zeros((len(run), run.x.recorded.size))

    def drawn(measured: Measured) -> Measured:
        values = measured.sigma * rng.normal(size=measured.values.shape)
        return replace(measured, values=values)

    silent = replace(run, waves=Waves(none, none, none))
    return fuse(replace(silent, x=drawn(run.x), v=drawn(run.v), u=drawn(run.u)))


def recalibrate_motion(
    runs: Sequence[PreparedRun],
    fused: Sequence[Fused],
    rng: np.random.Generator,
    rounds: int = 4,
) -> tuple[Array, Array]:
    """Fit the factors on force law and inertias together to the motion of the fit runs.

    Factors stay inside their tolerances. Coordinates whose residual exceeds its noise are
    down-weighted, as in ``recalibrate``.

    Args:
        runs: those of the role ``fit`` are used.
        fused: fused motion of each run.
        rng: for the realisations of the noise.
        rounds: Gauss-Newton steps.

    Returns:
        (6,) factors on k, c and e, and (3,) on 1/M_s, 1/M_p and 1/M_c.
    """
    chosen = [(r, f, fused_noise(r, rng)) for r, f in zip(runs, fused, strict=True)]
    chosen = [case for case in chosen if case[0].role == "fit"]
    bounds = np.concatenate([BOUNDS, np.full(3, HEAVIEST - 1.0)])
    low, high = 1.0 - bounds, 1.0 + bounds
    low[6:], high[6:] = 1.0 / HEAVIEST, 1.0 / LIGHTEST
    p = np.ones(9)
    prior = np.diag(3.0 / bounds**2)
    for _ in range(rounds):
        normal, right = prior.copy(), prior @ (1.0 - p)
        for run, fused_motion, noise in chosen:
            J, r = _linearised(run, fused_motion, noise, p)
            normal += J @ J.T
            right += J @ r
        p = p + bounded_step(normal, right, low - p, high - p + 1e-12)
    return p[:6], p[6:]


def _linearised(run: PreparedRun, fused: Fused, noise: Fused, p: Array) -> tuple[Array, Array]:
    """Return the whitened Jacobian (9, k m) of the expected accelerations and the residual (k m,).

    m counts the known coordinates; ``p``: (9,) factors on k, c, e (6) and 1/M (3).
    """
    balance = motion_balance(run, fused, noise, p[:6], p[6:])
    spread = balance.sigma * np.sqrt(np.maximum(balance.reduced_chi2, 1.0) * balance.overlap)
    window = window_of(run, WIDTH)
    A = np.tensordot(p[6:], inertia_parts(run.model), axes=1)
    here = force_law(run, fused, p[:6]).modelled_n
    step = 1e-4
    slopes = [
        window.average((force_law(run, fused, p[:6] + step * e).modelled_n - here) @ A.T) / step
        for e in np.eye(6)
    ]
    known = np.isfinite(balance.residual).all(axis=0)
    J = (np.stack([*slopes, *balance.parts]) / spread)[:, :, known]
    return J.reshape(9, -1), (balance.residual / spread)[:, known].ravel()
