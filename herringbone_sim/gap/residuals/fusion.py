"""Sensor fusion: estimate coordinates z = (q, r) and rates dz/dt from the channels x, u and v.

Recorded x and u both measure z, by x = D z - e and z = B u (``data.geometry``), with the nominal
e(t). Generalised least squares joins them sample by sample; a random-walk smoother then joins z
with the integral of dz/dt from v. Only geometry is used, no mass, stiffness or damping, so that
effects of the catalogue don't bias the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, solveh_banded

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.gap.data.kinematics import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun

# Integral over the middle step of six equidistant samples, exact for polynomials of degree five.
QUADRATURE = np.array([11.0, -93.0, 802.0, 802.0, -93.0, 11.0]) / 1440.0


@dataclass(frozen=True)
class Fused:
    """Fused displacements and rates of a run with their noise.

    Attributes:
        z, z_rate: (n, n_coordinate) coordinates (q, r) [m] and their rates [m/s].
        z_cov, z_rate_cov: (n_coordinate, n_coordinate) covariance of their noise.
        x, v: (n, n_mesh) mesh displacement D z - e [m] with the nominal e(t), and its rate [m/s];
            NaN at meshes where the channels don't determine it.
        sigma_x, sigma_v: (n_mesh,) standard deviation of the noise of x and v.
    """

    z: Array
    z_rate: Array
    z_cov: Array
    z_rate_cov: Array
    x: Array
    v: Array
    sigma_x: Array
    sigma_v: Array

    @property
    def complete(self) -> bool:
        """Whether the channels determine every coordinate and its rate."""
        return bool(np.isfinite(self.z).all() and np.isfinite(self.z_rate).all())

    @property
    def known_meshes(self) -> Flags:
        """Whether displacement and rate of each mesh (n_mesh,) are known at all samples."""
        return np.asarray(np.isfinite(self.x).all(axis=0) & np.isfinite(self.v).all(axis=0))


def fuse(run: PreparedRun) -> Fused:
    """Estimate coordinates z, mesh displacements and their rates from the channels x, u and v.

    Displacements are estimated from x and u, rates from v alone. z is smoothed by the rates only
    if the channels determine all coordinates and all rates. A coordinate that they don't determine
    is NaN. So are the meshes that depend on it; but where x or v of such a mesh is recorded, these
    raw values are used.
    """
    D = coordinates_to_meshes(run.model.layout)
    z, P = displacement(run)
    rate, V = velocity(run)
    if np.isfinite(P).all() and np.isfinite(V).all():
        z, P = smooth(z, P, rate, V, run.step_s)
    x, sigma_x = to_meshes(D, z) - run.waves.e, mesh_sigma(D, P)
    v, sigma_v = to_meshes(D, rate) - run.waves.e_rate, mesh_sigma(D, V)
    alone = np.isnan(sigma_x) & run.x.recorded
    x[:, alone], sigma_x[alone] = run.x.values[:, alone], run.x.sigma[alone]
    alone = np.isnan(sigma_v) & run.v.recorded
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
    )


def displacement(run: PreparedRun, wanted: Array | None = None) -> tuple[Array, Array]:
    """Estimate z (n, m) [m] from x and u, sample by sample, and its noise covariance (m, m).

    Args:
        wanted: (m', m) combinations of z to estimate in place of z.
    """
    D = coordinates_to_meshes(run.model.layout)
    B = bodies_to_coordinates(run.model)
    rows = np.vstack([(D @ B)[run.x.recorded], np.eye(B.shape[1])[run.u.recorded]])
    sigma = np.concatenate([run.x.sigma[run.x.recorded], run.u.sigma[run.u.recorded]])
    seen = (run.x.values + run.waves.e)[:, run.x.recorded]
    values = np.hstack([seen, run.u.values[:, run.u.recorded]])
    return least_squares(rows, sigma, values, B if wanted is None else wanted @ B)


def velocity(run: PreparedRun, wanted: Array | None = None) -> tuple[Array, Array]:
    """Estimate dz/dt (n, m) [m/s] from v, sample by sample, and its noise covariance (m, m).

    Args:
        wanted: (m', m) combinations of dz/dt to estimate in its place.
    """
    D = coordinates_to_meshes(run.model.layout)
    there = run.v.recorded
    seen = (run.v.values + run.waves.e_rate)[:, there]
    combinations = np.eye(D.shape[1]) if wanted is None else wanted
    return least_squares(D[there], run.v.sigma[there], seen, combinations)


def least_squares(rows: Array, sigma: Array, values: Array, wanted: Array) -> tuple[Array, Array]:
    """Generalised least-squares estimate of ``wanted @ s`` from ``values = rows @ s + noise``.

    Args:
        rows: (k, s) matrix from the unknowns to the channels.
        sigma: (k,) standard deviation of the noise of each channel.
        values: (n, k) samples of the channels.
        wanted: (m, s) linear combinations of the unknowns to estimate.

    Returns:
        (n, m) estimates and their covariance (m, m); NaN for combinations that the channels don't
        determine.
    """
    n, m = len(values), len(wanted)
    scale = np.maximum(sigma, 1e-9 * max(float(np.max(sigma, initial=0.0)), 1e-300))
    whitened = rows / scale[:, None]
    reference = float(np.min(scale, initial=np.inf))
    inverse = np.linalg.pinv(whitened * reference, rcond=1e-9) * reference
    blind = ~np.all(np.isclose(wanted @ inverse @ whitened, wanted, atol=1e-6), axis=1)
    gain = wanted @ inverse
    estimate = (values / scale) @ gain.T if len(rows) else np.zeros((n, m))
    covariance = gain @ gain.T
    estimate[:, blind] = np.nan
    covariance[blind] = covariance[:, blind] = np.nan
    return estimate, covariance


def smooth(z: Array, P: Array, rate: Array, V: Array, step_s: float) -> tuple[Array, Array]:
    """Smooth z (n, m) with noise covariance P, given its rates (n, m) with noise covariance V.

    A random-walk smoother: P and V are diagonalised together, so that each component zeta
    minimises the sum of (zeta - y)^2 + (d zeta - w)^2 / q, with y from z and the increments w from
    the rates: a tridiagonal system. The error of the quadrature of w is estimated from the data
    and added to q.

    Returns:
        Smoothed z (n, m), and the covariance (m, m) of its noise away from the ends.
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
    """Integrate rates (n, m) over each step (n - 1, m): ``QUADRATURE``, trapezoids at the ends."""
    w = step_s * 0.5 * (rate[1:] + rate[:-1])
    n = len(rate)
    if n >= len(QUADRATURE):
        inner = sum(c * rate[j : n - 5 + j] for j, c in enumerate(QUADRATURE))
        w[2:-2] = step_s * inner
    return w


def quadrature_covariance(rate: Array, V: Array, step_s: float) -> tuple[Array, Array]:
    """Estimate the covariance of the quadrature error of ``increments``.

    It follows from the spectrum of the rates (n, m), less their noise covariance V, and from the
    transfer functions of quadrature and integral. Above half of the sampling rate the spectrum is
    extrapolated from its last eighth with the power -6 of the frequency, as the acceleration has
    a kink at a contact.

    Returns:
        Estimate (m, m), which scatters about zero to both sides where there is no such error, and
        its standard deviation (m, m) by the noise of the rates.
    """
    n = len(rate)
    bell = np.hanning(n + 2)[1:-1]
    X = np.fft.rfft((rate - rate.mean(axis=0)) * bell[:, None], axis=0)[1:]
    X *= np.sqrt(2.0 / (n * np.sum(bell**2)))
    theta = np.pi * np.arange(1, 2 * len(X) + 1) / len(X)
    rule = 2.0 * sum(c * np.cos((j + 0.5) * theta) for j, c in enumerate(QUADRATURE[3:]))
    missed = (rule - np.sinc(theta / (2.0 * np.pi))) ** 2
    weight, above = missed[: len(X)], missed[len(X) :]
    last = max(1, len(X) // 8)
    weight[-last:] += np.sum(above * (np.pi / theta[len(X) :]) ** 6) / last
    seen = np.einsum("k,ki,kj->ij", weight, X, X.conj()).real - np.mean(weight) * V
    # Lines beside one another are correlated by the window: 1 + 2 (4/9 + 1/36) times the variance.
    scatter = np.sqrt(35.0 / 18.0 * np.sum(weight**2)) / len(X) * V
    return step_s**2 * seen, step_s**2 * scatter


def _tridiagonal(y: Array, w: Array, q: float) -> Array:
    """Return the zeta (n,) that minimises the sum of (zeta - y)^2 + (d zeta - w)^2 / q."""
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
    """Return the noise variance after ``smooth`` of a component whose variance before is 1.

    Computed from the transfer functions of the smoother. ``q``: noise variance of the rate times
    step^2; ``missed``: variance of the quadrature error.
    """
    theta = (np.arange(512) + 0.5) * np.pi / 512
    curve = 2.0 - 2.0 * np.cos(theta)
    rule = 2.0 * sum(c * np.cos((j + 0.5) * theta) for j, c in enumerate(QUADRATURE[3:]))
    weight = 1.0 / (q + missed)
    of_y = 1.0 / (1.0 + curve * weight)
    of_w = np.sqrt(curve) * weight / (1.0 + curve * weight)
    return float(np.mean(of_y**2 + of_w**2 * (q * rule**2 + missed)))


def to_meshes(D: Array, z: Array) -> Array:
    """Return D z (n, n_mesh) of coordinates (n, m); a NaN coordinate affects its meshes alone."""
    bad = np.isnan(z).any(axis=0)
    through: Array = np.where(bad, 0.0, z) @ D.T
    through[:, np.abs(D) @ bad > 0.0] = np.nan
    return through


def mesh_sigma(D: Array, covariance: Array) -> Array:
    """Return the standard deviation (n_mesh,) of D z from the covariance of z; NaN if unknown."""
    bad = np.isnan(np.diag(covariance))
    variance = np.einsum("mi,ij,mj->m", D, np.nan_to_num(covariance), D)
    sigma: Array = np.where(np.abs(D) @ bad > 0.0, np.nan, np.sqrt(np.maximum(variance, 0.0)))
    return sigma
