"""Nominal parameters moved inside the data sheet's tolerance, by the force law of the fit runs.

Six factors: k, c and e of the sun and of the ring meshes. The recording holds the nominal e(t), so
a rig whose amplitude is (1 + s) e has the displacement x - s e. Tolerances are hard bounds and the
prior is narrow, or missing physics would be taken for drift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from herringbone_sim.core.mesh import backlash
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.waves import waves
from herringbone_sim.gap.residuals.balance import Balance, FineLaw
from herringbone_sim.gap.residuals.contact import noisy_backlash
from herringbone_sim.gap.residuals.fusion import Fused

Array = NDArray[np.float64]

NAMES = ("k_sp", "k_rp", "c_sp", "c_rp", "e_sp", "e_rp")
# c follows xi, the root of k and the masses of Eq. (11), each within 2 %.
BOUNDS = np.array([0.02, 0.02, 0.04, 0.04, 0.02, 0.02])


LIGHTEST, HEAVIEST = 0.98, 1.02


@dataclass(frozen=True)
class Law:
    """The force law of a run with its residual and floor; arrays (n, n_mesh).

    Attributes:
        modelled_n: k(t) f(x) + c v [N].
        residual_n: measured minus modelled [N].
        sigma_n: noise floor of the residual, from F, x and v [N].
        x_m, v_m_per_s: displacement and rate relative to the rig's own e(t).
        f_m: expected backlash function.
        contact: probability of contact.
    """

    modelled_n: Array
    residual_n: Array
    sigma_n: Array
    x_m: Array
    v_m_per_s: Array
    f_m: Array
    contact: Array

    @property
    def chi2(self) -> Array:
        """Mean square (n_mesh,) of residual over floor: 1 where the law holds."""
        chi2: Array = np.mean((self.residual_n / self.sigma_n) ** 2, axis=0)
        return chi2


@dataclass(frozen=True)
class Calibration:
    """Nominal parameters inside their tolerance.

    Attributes:
        factors: (6,) on k_sp, k_rp, c_sp, c_rp, e_sp, e_rp.
        covariance: (6, 6) of the factors, noise and prior, as if nothing were on a bound.
        at_bound: names of those that lie on their bound.
    """

    factors: Array
    covariance: Array
    at_bound: tuple[str, ...]

    @property
    def sigma(self) -> Array:
        sigma: Array = np.sqrt(np.diag(self.covariance))
        return sigma


@dataclass(frozen=True)
class Inertias:
    """Factors (3,) of M_s, M_p and M_c (I_ce) inside their tolerance, with their sigma (3,)."""

    factors: Array
    sigma: Array

    @property
    def inverse(self) -> Array:
        """Factors on 1 / M, as ``balance.torque_balance`` takes them."""
        inverse: Array = 1.0 / self.factors
        return inverse


def nominal_calibration() -> Calibration:
    """All factors 1."""
    return Calibration(np.ones(6), np.diag((BOUNDS**2) / 3.0), ())


def force_law(run: PreparedRun, fused: Fused, factors: Array) -> Law:
    """Force law of a run with calibrated parameters, on fused x and v."""
    k_f, c_f, e_f = (_of_meshes(factors[i : i + 2], run.x.sigma.size) for i in (0, 2, 4))
    k, c = run.waves.k * k_f, run.model.damping_n_s_per_m * c_f
    x = fused.x - (e_f - 1.0) * run.waves.e
    v = fused.v - (e_f - 1.0) * run.waves.e_rate
    soft = noisy_backlash(x, run.model.half_backlash_m, fused.sigma_x)
    modelled = k * soft.f + c * v
    sigma = np.sqrt(run.F.sigma**2 + k**2 * soft.variance + (c * fused.sigma_v) ** 2)
    return Law(modelled, run.F.values - modelled, sigma, x, v, soft.f, soft.contact)


def fine_law(run: PreparedRun, factors: Array) -> FineLaw:
    """The calibrated force law as a function of phase (n,), D z and its rate (n, n_mesh)."""
    k_f, c_f, e_f = (_of_meshes(factors[i : i + 2], run.x.sigma.size) for i in (0, 2, 4))

    def law(phase: Array, deflection: Array, rate: Array) -> Array:
        w = waves(run.model, phase, run.omega_rad_per_s)
        spring = w.k * k_f * backlash(deflection - e_f * w.e, run.model.half_backlash_m)
        damper: Array = run.model.damping_n_s_per_m * c_f * (rate - e_f * w.e_rate)
        return spring + damper

    return law


def recalibrate(
    runs: Sequence[PreparedRun], fused: Sequence[Fused], rounds: int = 5
) -> Calibration:
    """Factors of the nominal parameters from runs with forces.

    A mesh whose residual stays above its floor in a run counts less there, as if its noise were
    as large as the residual: what is wrong with one mesh does not bend the others.

    Args:
        runs: fit runs; those of another role are left out, whatever is handed in.
        fused: one for each run.
        rounds: Gauss-Newton steps.
    """
    factors = np.ones(6)
    chosen = [(r, f) for r, f in zip(runs, fused, strict=True) if r.role == "fit"]
    prior = np.diag(3.0 / BOUNDS**2)
    normal: Array = prior
    for _ in range(rounds):
        parts = [_normal_equations(run, fuse, factors) for run, fuse in chosen]
        normal = prior + sum((part[0] for part in parts), np.zeros((6, 6)))
        right = prior @ (1.0 - factors) + sum((part[1] for part in parts), np.zeros(6))
        root = np.linalg.cholesky(normal).T
        step = lsq_linear(
            root,
            np.linalg.solve(root.T, right),
            bounds=(1.0 - BOUNDS - factors - 1e-12, 1.0 + BOUNDS - factors + 1e-12),
        )
        factors = factors + step.x
    on = tuple(
        n for n, f, b in zip(NAMES, factors, BOUNDS, strict=True) if abs(f - 1.0) > 0.999 * b
    )
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    return Calibration(factors, covariance, on)


def recalibrate_inertias(runs: Sequence[PreparedRun], balances: Sequence[Balance]) -> Inertias:
    """Factors of M_s, M_p and M_c from the torque balance of the fit runs, within 2 %.

    The balance is linear in 1 / M; coordinates whose residual stays above the floor count less.
    """
    chosen = [b for r, b in zip(runs, balances, strict=True) if r.role == "fit"]
    inverse = np.ones(3)
    prior = normal = np.eye(3) * 3.0 / (HEAVIEST - 1.0) ** 2
    for _ in range(4):
        normal, right = prior.copy(), prior @ np.ones(3)
        for balance in chosen:
            now = replace(balance, factors=inverse)
            spread = now.sigma * np.sqrt(np.maximum(now.chi2, 1.0) * now.overlap)
            J = (now.parts / spread).reshape(3, -1)
            normal += J @ J.T
            right += J @ (now.measured / spread).ravel()
        inverse = np.clip(np.linalg.solve(normal, right), 1.0 / HEAVIEST, 1.0 / LIGHTEST)
    factors = 1.0 / inverse
    return Inertias(factors, np.sqrt(np.diag(np.linalg.inv(normal))) * factors**2)


def _normal_equations(run: PreparedRun, fused: Fused, factors: Array) -> tuple[Array, Array]:
    law = force_law(run, fused, factors)
    n = run.x.sigma.size
    k = run.waves.k * _of_meshes(factors[:2], n)
    c = run.model.damping_n_s_per_m * _of_meshes(factors[2:4], n)
    columns = (
        run.waves.k * law.f_m,
        run.model.damping_n_s_per_m * law.v_m_per_s,
        -(k * law.contact * run.waves.e + c * run.waves.e_rate),
    )
    known = np.isfinite(law.residual_n).all(axis=0)
    spread = law.sigma_n * np.sqrt(np.maximum(law.chi2, 1.0))
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


def _of_meshes(pair: Array, n_mesh: int) -> Array:
    spread: Array = np.repeat(pair, n_mesh // 2)
    return spread
