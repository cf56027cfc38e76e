"""Recalibration: fit nominal parameters inside the tolerances of the data sheet.

Six factors: on k, c and e of the sun meshes and of the ring meshes. The nominal e(t) is subtracted
in x, so a rig with the mesh error (1 + s) e has the displacement x - s e. Tolerances are hard
bounds with a narrow prior, so that the factors don't absorb effects that the model lacks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.mesh import backlash
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.fusion import Fused
from herringbone_sim.gap.residuals.mesh_law import LawChange, law, mesh_motion
from herringbone_sim.gap.residuals.torque_balance import ForceFunction

NAMES = ("k_sp", "k_rp", "c_sp", "c_rp", "e_sp", "e_rp")
# Largest deviation of each factor from 1. c follows xi, the root of k and the masses of Eq. (11),
# each within 2 %.
BOUNDS = np.array([0.02, 0.02, 0.04, 0.04, 0.02, 0.02])
LIGHTEST, HEAVIEST = 0.98, 1.02  # bounds of the factors on the inertias


@dataclass(frozen=True)
class ForceLaw:
    """Force law evaluated on the motion of a run, with residual and noise; arrays (n, n_mesh).

    Attributes:
        modelled_n: mesh forces k(t) f(x) + c v [N], with the fitted factors on k and c.
        residual_n: measured minus modelled [N]; NaN where the force was not recorded.
        sigma_n: standard deviation of the residual by the noise of F, x and v [N]; without that
            of F where it was not recorded.
        x_m, v_m_per_s: displacement and rate with the factors on e(t) applied; NaN where unknown.
        f_m: backlash function f(x), expectation over the noise of x [m].
        contact: probability of contact; NaN where x is unknown.
    """

    modelled_n: Array
    residual_n: Array
    sigma_n: Array
    x_m: Array
    v_m_per_s: Array
    f_m: Array
    contact: Array

    @property
    def reduced_chi2(self) -> Array:
        """Mean over the samples (n_mesh,) of (residual / sigma)^2: 1 if the law holds."""
        chi2: Array = np.mean((self.residual_n / self.sigma_n) ** 2, axis=0)
        return chi2

    @property
    def flank(self) -> Indices:
        """Contact state (n, n_mesh): 0 back flank, 1 apart (contact <= 0.5), 2 driving flank."""
        return np.asarray(np.where(self.contact > 0.5, np.where(self.x_m > 0.0, 2, 0), 1))


def force_law(run: PreparedRun, fused: Fused, factors: Array) -> ForceLaw:
    """Evaluate the force law on fused x and v of a run, and compare it with the measured forces.

    Args:
        run: gives the nominal model and its waves, and the measured forces.
        fused: displacements and rates of the meshes, with their noise.
        factors: (6,) on nominal k, c and e, see ``NAMES``; those on e change x and v, too.
    """
    k_f, c_f, e_f = by_mesh(factors, run.x.sigma.size)
    d, d_rate = (1.0 - e_f) * run.waves.e, (1.0 - e_f) * run.waves.e_rate
    change = LawChange(kappa=k_f - 1.0, gamma=c_f - 1.0, d=d, d_rate=d_rate)
    found = law(mesh_motion(run, fused), change)
    contact = np.where(np.isnan(found.f), np.nan, found.contact_drive + found.contact_back)
    residual = run.F.values - found.force
    return ForceLaw(
        found.force, residual, found.sigma, fused.x + d, fused.v + d_rate, found.f, contact
    )


def force_function(run: PreparedRun, factors: Array) -> ForceFunction:
    """Return the force law as a function of the motion, for ``quadrature_correction``.

    Args:
        run: whose model and nominal waves are used.
        factors: (6,) on k, c and e, see ``NAMES``.

    Returns:
        Function of mesh phase (n,) [rad], relative displacement of the bodies at each mesh
        (n, n_mesh) [m], error not subtracted, and its rate [m/s]; gives forces (n, n_mesh) [N].
    """
    k_f, c_f, e_f = by_mesh(factors, run.x.sigma.size)

    def force(phase: Array, deflection: Array, rate: Array) -> Array:
        w = run.waves_at(phase)
        spring: Array = w.k * k_f * backlash(deflection - e_f * w.e, run.model.half_backlash_m)
        damper: Array = run.model.damping_n_s_per_m * c_f * (rate - e_f * w.e_rate)
        return spring + damper

    return force


def recalibrate(runs: Sequence[PreparedRun], fused: Sequence[Fused], rounds: int = 5) -> Array:
    """Fit the factors (6,) on k, c and e, see ``NAMES``, to the measured forces of the fit runs.

    A mesh whose residual exceeds its noise in a run is down-weighted there, as if its noise were
    as large as the residual: an effect on one mesh does not bias the factors.

    Args:
        runs: those of the role ``fit`` are used.
        fused: fused motion of each run.
        rounds: Gauss-Newton steps.
    """
    factors = np.ones(6)
    chosen = [(r, f) for r, f in zip(runs, fused, strict=True) if r.role == "fit"]
    prior = np.diag(3.0 / BOUNDS**2)
    for _ in range(rounds):
        parts = [_normal_equations(run, f, factors) for run, f in chosen]
        normal = prior + sum((part[0] for part in parts), np.zeros((6, 6)))
        right = prior @ (1.0 - factors) + sum((part[1] for part in parts), np.zeros(6))
        low, high = 1.0 - BOUNDS - factors - 1e-12, 1.0 + BOUNDS - factors + 1e-12
        factors = factors + bounded_step(normal, right, low, high)
    return factors


def bounded_step(normal: Array, right: Array, low: Array, high: Array) -> Array:
    """Solve normal equations (p, p), (p,) for a step (p,) between bounds ``low`` and ``high``."""
    root = np.linalg.cholesky(normal).T
    return np.asarray(lsq_linear(root, np.linalg.solve(root.T, right), (low, high)).x)


def _normal_equations(run: PreparedRun, fused: Fused, factors: Array) -> tuple[Array, Array]:
    """Return the contribution of a run to normal matrix (6, 6) and right side (6,) of a step."""
    law = force_law(run, fused, factors)
    n = run.x.sigma.size
    columns = calibration_columns(run, law, factors)
    known = np.isfinite(law.residual_n).all(axis=0)
    spread = law.sigma_n * np.sqrt(np.maximum(law.reduced_chi2, 1.0))
    A, b = np.zeros((6, 6)), np.zeros(6)
    for kind in range(2):
        half = np.zeros(n, dtype=bool)
        half[kind * n // 2 : (kind + 1) * n // 2] = True
        at = known & half
        J = np.stack([(q / spread)[:, at].ravel() for q in columns], axis=1)
        own = np.arange(3) * 2 + kind
        A[np.ix_(own, own)] += J.T @ J
        b[own] += J.T @ (law.residual_n / spread)[:, at].ravel()
    return A, b


def calibration_columns(run: PreparedRun, law: ForceLaw, factors: Array) -> list[Array]:
    """Derivatives (n, n_mesh) of the forces by factors on k, on c and on e of each mesh.

    They are taken about ``factors`` (6,) on k, c and e, at which ``law`` is the force law.
    """
    k_f, c_f, _ = by_mesh(factors, law.f_m.shape[1])
    k, c = run.waves.k * k_f, run.model.damping_n_s_per_m * c_f
    return [
        run.waves.k * law.f_m,
        run.model.damping_n_s_per_m * law.v_m_per_s,
        -(k * law.contact * run.waves.e + c * run.waves.e_rate),
    ]


def by_mesh(factors: Array, n_mesh: int) -> Array:
    """Expand factors (6,), in the order of ``NAMES``, to rows k, c and e of (3, n_mesh)."""
    return np.asarray(np.repeat(factors, n_mesh // 2).reshape(3, n_mesh))
