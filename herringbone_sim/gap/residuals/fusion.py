"""One displacement from many sensors: geometry first, then the integral of the rate.

Recorded x and u are the same eight coordinates z = (q, r) seen through x = D z - e and z = B u
(``Layout.state_names``), with the nominal e(t) as the recording contract has it. Generalised least
squares joins them sample by sample; a random-walk smoother then joins z with the integral of
dz/dt from v. Nothing here knows a mass, a stiffness or a damping: no effect can bend it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, solveh_banded

from herringbone_sim.gap.data.geometry import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun

Array = NDArray[np.float64]

# Integral over the middle step of six equidistant samples, exact for polynomials of degree five.
QUADRATURE = np.array([11.0, -93.0, 802.0, 802.0, -93.0, 11.0]) / 1440.0


@dataclass(frozen=True)
class Fused:
    """Best displacements and rates of a run and what noise is left on them.

    Attributes:
        z, z_rate: (n, n_coordinate) coordinates (q, r) [m] and their rates [m/s].
        z_cov, z_rate_cov: (n_coordinate, n_coordinate) covariance of their noise.
        x, v: (n, n_mesh) relative to the nominal e(t), NaN where the channels can't give it.
        sigma_x, sigma_v: (n_mesh,) standard deviation of the noise left.
        gain: (n_mesh,) noise of the raw x over that of the fused one; NaN without raw x.
    """

    z: Array
    z_rate: Array
    z_cov: Array
    z_rate_cov: Array
    x: Array
    v: Array
    sigma_x: Array
    sigma_v: Array
    gain: Array


def fuse(run: PreparedRun) -> Fused:
    """Fuse x, u and v of a run.

    A coordinate that no channel gives is NaN, and so are the meshes that need it and have no
    sensors of their own.
    """
    D = coordinates_to_meshes(run.model.layout)
    z, P = displacement(run)
    rate, V = velocity(run)
    if np.isfinite(P).all() and np.isfinite(V).all():
        z, P = smooth(z, P, rate, V, run.step_s)
    x, sigma_x = _through(D, z) - run.waves.e, _of_meshes(D, P)
    v, sigma_v = _through(D, rate) - run.waves.e_rate, _of_meshes(D, V)
    alone = np.isnan(sigma_x) & run.x.there
    x[:, alone], sigma_x[alone] = run.x.values[:, alone], run.x.sigma[alone]
    alone = np.isnan(sigma_v) & run.v.there
    v[:, alone], sigma_v[alone] = run.v.values[:, alone], run.v.sigma[alone]
    return Fused(
        z=z,
        z_rate=rate,
        z_cov=P,
        z_rate_cov=V,
        x=x,
        v=v,
        sigma_x=sigma_x,
        sigma_v=sigma_v,
        gain=run.x.sigma / sigma_x,
    )


def displacement(run: PreparedRun) -> tuple[Array, Array]:
    """Coordinates z (n, m) by geometry alone from x and u, and the covariance of their noise."""
    D = coordinates_to_meshes(run.model.layout)
    B = bodies_to_coordinates(run.model)
    rows = np.vstack([(D @ B)[run.x.there], np.eye(B.shape[1])[run.u.there]])
    sigma = np.concatenate([run.x.sigma[run.x.there], run.u.sigma[run.u.there]])
    seen = (run.x.values + run.waves.e)[:, run.x.there]
    return least_squares(rows, sigma, np.hstack([seen, run.u.values[:, run.u.there]]), B)


def velocity(run: PreparedRun) -> tuple[Array, Array]:
    """Rates dz/dt (n, m) of every sample by geometry alone from v, and their covariance."""
    D = coordinates_to_meshes(run.model.layout)
    there = run.v.there
    seen = (run.v.values + run.waves.e_rate)[:, there]
    return least_squares(D[there], run.v.sigma[there], seen, np.eye(D.shape[1]))


def least_squares(rows: Array, sigma: Array, seen: Array, wanted: Array) -> tuple[Array, Array]:
    """Generalised least squares of ``wanted @ s`` from ``seen = rows @ s + noise``.

    Args:
        rows: (k, s) what each channel sees of the unknowns.
        sigma: (k,) standard deviation of each channel.
        seen: (n, k).
        wanted: (m, s) combinations asked for.

    Returns:
        (n, m) estimates and (m, m) their covariance; NaN for combinations that are not seen.
    """
    n, m = len(seen), len(wanted)
    scale = np.maximum(sigma, 1e-9 * max(float(np.max(sigma, initial=0.0)), 1e-300))
    whitened = rows / scale[:, None]
    reference = float(np.min(scale, initial=np.inf))
    inverse = np.linalg.pinv(whitened * reference, rcond=1e-9) * reference
    blind = ~np.all(np.isclose(wanted @ inverse @ whitened, wanted, atol=1e-6), axis=1)
    gain = wanted @ inverse
    estimate = (seen / scale) @ gain.T if len(rows) else np.zeros((n, m))
    covariance = gain @ gain.T
    estimate[:, blind] = np.nan
    covariance[blind] = covariance[:, blind] = np.nan
    return estimate, covariance


def smooth(z: Array, P: Array, rate: Array, V: Array, step_s: float) -> tuple[Array, Array]:
    """Random-walk smoother: z (n, m) with noise P, driven by the integral of rates with noise V.

    The two covariances are diagonalised together, so that each component is a scalar problem:
    least sum of (zeta - y)^2 + (d zeta - w)^2 / q, a tridiagonal system. What the integral misses
    is taken from the data and added to q.

    Returns:
        (n, m) smoothed z, and (m, m) the covariance of its noise away from the ends.
    """
    variances, T = eigh(V, P)
    y = z @ T
    w = increments(rate @ T, step_s)
    back = np.linalg.inv(T)
    left = np.empty(len(variances))
    q = step_s**2 * variances
    expected = 2.0 + q * np.sum(QUADRATURE**2)
    excess = np.mean((np.diff(y, axis=0) - w) ** 2, axis=0) - expected
    missed = np.where(excess > 0.05 * expected, excess, 0.0)
    for j in range(len(variances)):
        y[:, j] = _tridiagonal(y[:, j], w[:, j], q[j] + missed[j])
        left[j] = _variance_left(q[j], missed[j])
    return y @ back, back.T @ np.diag(left) @ back


def increments(rate: Array, step_s: float) -> Array:
    """Integral (n - 1, m) of rates (n, m) over each step."""
    w = step_s * 0.5 * (rate[1:] + rate[:-1])
    n = len(rate)
    if n >= len(QUADRATURE):
        inner = sum(c * rate[j : n - 5 + j] for j, c in enumerate(QUADRATURE))
        w[2:-2] = step_s * inner
    return w


def _tridiagonal(y: Array, w: Array, q: float) -> Array:
    band = np.zeros((2, len(y)))
    band[1] = 1.0 + 2.0 / q
    band[1, [0, -1]] = 1.0 + 1.0 / q
    band[0, 1:] = -1.0 / q
    right = y.copy()
    right[1:] += w / q
    right[:-1] -= w / q
    solved: Array = solveh_banded(band, right)
    return solved


def _variance_left(q: float, missed: float) -> float:
    """Variance of a smoothed component of unit measurement noise, by its transfer functions."""
    theta = (np.arange(512) + 0.5) * np.pi / 512
    curve = 2.0 - 2.0 * np.cos(theta)
    rule = 2.0 * sum(c * np.cos((j + 0.5) * theta) for j, c in enumerate(QUADRATURE[3:]))
    weight = 1.0 / (q + missed)
    of_y = 1.0 / (1.0 + curve * weight)
    of_w = np.sqrt(curve) * weight / (1.0 + curve * weight)
    return float(np.mean(of_y**2 + of_w**2 * (q * rule**2 + missed)))


def _through(D: Array, z: Array) -> Array:
    """D z with NaN only where a coordinate that is needed is NaN."""
    bad = np.isnan(z).any(axis=0)
    through: Array = np.where(bad, 0.0, z) @ D.T
    through[:, np.abs(D) @ bad > 0.0] = np.nan
    return through


def _of_meshes(D: Array, covariance: Array) -> Array:
    bad = np.isnan(np.diag(covariance))
    variance = np.einsum("mi,ij,mj->m", D, np.nan_to_num(covariance), D)
    sigma: Array = np.where(np.abs(D) @ bad > 0.0, np.nan, np.sqrt(np.maximum(variance, 0.0)))
    return sigma
