"""Consistency of the motion sensors: x = D B u - e and dx/dt = v hold whatever the force law.

Twelve x, twelve v and nine u measure eight coordinates and their rates. The channels minus their
least-squares fit, and the increments of z minus the integral of dz/dt, are noise unless a sensor
is wrong. An error of a channel adds a known signal to its values, and so a known pattern to these
residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import null_space, polar, qr, solve_triangular

from herringbone_sim.arrays import Array
from herringbone_sim.gap.data.kinematics import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.mesh_excitation import Waves
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.residuals.fusion import (
    QUADRATURE,
    Fused,
    displacement,
    increments,
    quadrature_covariance,
    velocity,
)

CHANCE_SD = 3.0  # standard deviations; noise exceeds them once in 740 on one side


def consistency_chi2(
    runs: Sequence[PreparedRun], noise_of: Sequence[PreparedRun] | None = None
) -> float:
    """Return chi2 per degree of freedom of the relations between x, v and u: 1 if they agree.

    0 if there are no relations, as no quantity is measured twice.

    Args:
        runs: runs whose sensors are compared.
        noise_of: for each run, the run whose noise and quadrature error whiten the increments, see
            ``increment_whitening``; all else is whitened by the noise of ``runs``. For runs with
            corrected sensors, the runs as recorded, so that chi2 before and after the correction
            compares the same combinations. None: ``runs``.
    """
    chi2 = count = 0.0
    for run, other in zip(runs, noise_of or runs, strict=True):
        J = sum(m.recorded.size for m in (run.x, run.v, run.u))
        for relation in relations(run, np.zeros((len(run), J, 1)), other):
            chi2 += float(np.sum(relation.residual**2))
            count += _degrees_of_freedom(relation.residual, relation.columns)
    return chi2 / max(count, 1.0)


def _degrees_of_freedom(residual: Array, columns: Array) -> float:
    """Return the degrees of freedom of residuals (k, d) with the matrix ``columns`` (d, J)."""
    if not columns.size:
        return 0.0
    rank = np.linalg.matrix_rank(columns, tol=1e-9 * np.abs(columns).max())
    return float(len(residual) * rank)


def error_signals(run: PreparedRun, fused: Fused) -> Array:
    """Return the change (n, J, 4) of each channel x, v, u by a unit of each kind of error.

    Kinds are gain (relative), bias [SI], delay [s] and clock (relative). It is 0 for channels that
    are not recorded. ``fused``: fused motion of the run.
    """
    B = bodies_to_coordinates(run.model)
    rigid = np.ones(B.shape[1])
    rigid[:2] = 2.0
    z = np.nan_to_num(fused.z)
    inverse = np.linalg.pinv(B)
    # z lacks the rigid rotation; it is estimated from u by least squares over the bodies.
    there = run.u.recorded
    weights = rigid[there] / max(float(rigid[there] @ rigid[there]), 1.0)
    along = (run.u.values - z @ inverse.T)[:, there] @ weights
    u = z @ inverse.T + np.outer(along, rigid)
    y = np.nan_to_num(np.hstack([fused.x, fused.v, u]))
    slope = np.gradient(y, run.step_s, axis=0)
    n = fused.x.shape[1]
    slope[:, :n] = y[:, n : 2 * n]
    kinds = [y, np.ones_like(y), -slope, -slope * run.times[:, None]]
    recorded = np.concatenate([run.x.recorded, run.v.recorded, run.u.recorded])
    signals: Array = np.stack(kinds, axis=2) * recorded[:, None]
    return signals


def geometric_residuals(run: PreparedRun) -> list[tuple[Array, Array]]:
    """Return two whitened residuals (n, d) about the geometry: of x with u, and of v.

    Each comes with the matrix (d, J) by which the J channels x, v, u enter it.
    """
    D, B = coordinates_to_meshes(run.model.layout), bodies_to_coordinates(run.model)
    n, nu = D.shape[0], B.shape[1]
    place = np.eye(2 * n + nu)
    at, on = np.concatenate([run.x.recorded, run.u.recorded]), run.v.recorded
    sigma = np.concatenate([run.x.sigma, run.u.sigma])[at]
    seen = np.hstack([run.x.values + run.waves.e, run.u.values])[:, at]
    rows = np.vstack([D @ B, np.eye(nu)])[at]
    of_rate = (run.v.values + run.waves.e_rate)[:, on]
    return [
        _remainder(rows, sigma, seen, np.vstack([place[:n], place[2 * n :]])[at]),
        _remainder(D[on], run.v.sigma[on], of_rate, place[n : 2 * n][on]),
    ]


@dataclass(frozen=True)
class Relation:
    """d linear combinations of channels that are zero up to noise, at k instants.

    Attributes:
        residual: (k, d) whitened values of the combinations.
        columns: (d, J) matrix by which the J channels x, v, u enter the combinations.
        signals: (k, J, a) given signals of the channels in the form in which they enter: as they
            are, as increments (x, u) or as integrals over a step (v).
        noise: (J,) variance of the noise of ``signals``, over that of a sample of the channel.
    """

    residual: Array
    columns: Array
    signals: Array
    noise: Array


def relations(
    run: PreparedRun, signals: Array, noise_of: PreparedRun | None = None
) -> list[Relation]:
    """Return relations between x and u, among v, and of increments of z with integrals of dz/dt.

    Relations that the recorded channels don't allow are left out.

    Args:
        run: the run.
        signals: (n, J, a) signals of the channels, for ``Relation.signals``.
        noise_of: run whose noise whitens the increments; None: the run itself.
    """
    result = [
        Relation(*part, signals, np.ones(signals.shape[1])) for part in geometric_residuals(run)
    ]
    wanted = _combinations(run)
    z, P = displacement(run, wanted)
    rate, V = velocity(run, wanted)
    known = np.isfinite(np.diag(P)) & np.isfinite(np.diag(V))
    if known.any():
        h, n = run.step_s, run.x.recorded.size
        of_rate = h**2 * float(np.sum(QUADRATURE**2))
        white = increment_whitening(noise_of or run)
        residual = (np.diff(z, axis=0) - increments(rate, h))[:, known] @ white.T
        flat = signals.reshape(len(signals), -1)
        moved = np.diff(flat, axis=0).reshape(-1, *signals.shape[1:])
        moved[:, n : 2 * n] = increments(flat, h).reshape(moved.shape)[:, n : 2 * n]
        noise = np.full(signals.shape[1], 2.0)
        noise[n : 2 * n] = of_rate
        columns = white @ _channel_derivatives(run, wanted)[known]
        result.append(Relation(residual[2:-2], columns, moved[2:-2], noise))
    return [relation for relation in result if relation.columns.size]


def increment_whitening(run: PreparedRun) -> Array:
    """Return a matrix (m, m) that whitens the increments of z minus the integral of dz/dt.

    m counts the ``_combinations`` whose value and rate are known. The quadrature error counts as
    noise. As it repeats with the motion, combinations in which its mean square is larger, beyond
    chance, than the standard deviation of the mean square of noise are projected out: as many rows
    are zero, the other rows remain as close to the whitened coordinates as possible.
    """
    wanted = _combinations(run)
    (_, P), (rate, V) = displacement(run, wanted), velocity(run, wanted)
    known = np.isfinite(np.diag(P)) & np.isfinite(np.diag(V))
    both = np.ix_(known, known)
    missed, scatter = quadrature_covariance(rate[:, known], V[both], run.step_s)
    size, turn = np.linalg.eigh(missed)
    noise = (2.0 * P + run.step_s**2 * float(np.sum(QUADRATURE**2)) * V)[both]
    white: Array = np.linalg.inv(
        np.linalg.cholesky(noise + (turn * np.maximum(size, 0.0)) @ turn.T)
    )
    share, turn = np.linalg.eigh(white @ missed @ white.T)
    chance = CHANCE_SD * np.einsum("ji,jk,ki->i", turn, white @ scatter @ white.T, turn)
    good = turn[:, share <= np.sqrt(2.0 / len(rate)) + chance]
    if good.shape[1] == len(white):
        return white
    near = qr(good.T, mode="r", pivoting=True)[1][: good.shape[1]]
    projected = np.zeros_like(white)
    if len(near):
        projected[near] = polar(good[near])[0] @ good.T @ white
    return projected


def _combinations(run: PreparedRun) -> Array:
    """Combinations (m', m) of the coordinates z whose rates v determines: all of z if possible.

    Otherwise those of single meshes with recorded and independent rates.
    """
    D = coordinates_to_meshes(run.model.layout)
    single = D[run.v.recorded]
    known = np.isfinite(np.diag(velocity(run)[1]))
    rank = int(np.linalg.matrix_rank(single)) if len(single) else 0
    if known.sum() == rank:
        return np.eye(D.shape[1])
    return np.asarray(single[np.sort(qr(single.T, mode="r", pivoting=True)[1][:rank])])


def _channel_derivatives(run: PreparedRun, wanted: Array) -> Array:
    """Return derivatives of combinations of z, and of minus their rates, by the J channels.

    Args:
        wanted: (m, s) combinations.

    Returns:
        (m, J): dz/dx and dz/du in the columns of x and u, -d(dz/dt)/dv in those of v (channels in
        the order x, v, u); 0 for a channel that is not recorded, NaN in the row of a
        combination whose value or rate the channels don't determine.
    """
    without_e = replace(run, waves=Waves(*(np.zeros((1, run.x.recorded.size)),) * 3))
    n, nu = run.x.recorded.size, run.u.recorded.size
    place = np.eye(2 * n + nu)

    def unit(measured: Measured, values: Array) -> Measured:
        return replace(measured, values=np.where(measured.recorded, values, np.nan))

    unit_values = replace(
        without_e,
        x=unit(run.x, place[:, :n]),
        v=unit(run.v, place[:, n : 2 * n]),
        u=unit(run.u, place[:, 2 * n :]),
    )
    of_z, of_rate = displacement(unit_values, wanted)[0], velocity(unit_values, wanted)[0]
    derivative: Array = (of_z - of_rate).T
    return derivative


def _remainder(rows: Array, sigma: Array, values: Array, to: Array) -> tuple[Array, Array]:
    """Return the whitened residual (n, d) of k channels about their fit, and its matrix (d, J).

    Its d combinations are those of the same channels in every run, in the same order, but for the
    mixing that whitens them: an error that all runs share has the same pattern in all of them.

    Args:
        rows: (k, s) matrix from the unknowns to the channels.
        sigma: (k,) noise of the channels.
        values: (n, k) values of the channels.
        to: (k, J) 1 at the index of each channel among all J, else 0.
    """
    if len(rows) == 0:
        return np.zeros((len(values), 0)), np.zeros((0, to.shape[1]))
    scale = np.maximum(sigma, 1e-300)
    free = null_space(rows.T, rcond=1e-9)
    if free.shape[1]:
        upper = np.linalg.qr(scale[:, None] * free, mode="r")
        free = solve_triangular(upper, free.T, trans="T").T
    return values @ free, free.T @ to


def channel_arrays(run: PreparedRun) -> tuple[Array, Array]:
    """Return the channels x, v, u of a run side by side (n, J), and their noise (J,).

    x [m] and v [m/s] of all meshes, then u [m] of all bodies (rotation times base radius); the
    noise is a standard deviation. Both are NaN for channels that were not recorded.
    """
    parts = (run.x, run.v, run.u)
    return np.hstack([m.values for m in parts]), np.concatenate([m.sigma for m in parts])
