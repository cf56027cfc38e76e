"""What sensors say against each other: x = G u - e and dx/dt = v, free of any law of the gear.

Twelve x, twelve v and nine u see eight coordinates and their rates. What is left of them after
the coordinates are estimated, and of the increments of the one against the integral of the other,
is noise unless a sensor errs. An error of kind a on channel j adds theta s_ja(t) to it, and so a
known pattern to what is left; every kind on every channel goes into one Gram matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.data.geometry import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.data.waves import Waves
from herringbone_sim.gap.residuals.fusion import (
    QUADRATURE,
    Fused,
    displacement,
    fuse,
    increments,
    velocity,
)

Array = NDArray[np.float64]

KINDS = ("sensor_gain", "sensor_bias", "sensor_delay", "clock_drift")


@dataclass(frozen=True)
class Consistency:
    """Normal equations of all channel errors, summed over runs.

    Attributes:
        normal: (4 J, 4 J) and right: (4 J,), kinds fastest, channels x, v, u in order.
        energy: sum of squares of what is left, whitened.
        count: its degrees of freedom.
        of_geometry: both of what geometry alone leaves, which holds to rounding; the integral of v
            between samples does not.
        scale: (4 J,) SI value of one unit of each column.
    """

    normal: Array
    right: Array
    energy: float
    count: float
    of_geometry: tuple[float, float]
    scale: Array

    @property
    def chi2(self) -> float:
        """Mean square of what is left over its noise: 1 where all sensors agree."""
        return self.energy / max(self.count, 1.0)


def consistency(runs: Sequence[PreparedRun]) -> Consistency:
    """What the sensors of some runs say against each other, as normal equations."""
    J = sum(m.there.size for m in (runs[0].x, runs[0].v, runs[0].u))
    normal, right = np.zeros((4 * J, 4 * J)), np.zeros(4 * J)
    energy = count = 0.0
    exact = np.zeros(2)
    sizes = _sizes(runs)
    scale = np.stack(
        [np.ones(J), sizes, np.full(J, runs[0].step_s), np.full(J, 1e-4)], axis=1
    ).ravel()
    for run in runs:
        signals = channel_signals(run, scale.reshape(J, 4), fuse(run))
        for one in relations(run, signals):
            S = one.signals.reshape(len(one.signals), -1)
            weight = np.kron(one.columns.T @ one.columns, np.ones((4, 4)))
            normal += weight * (S.T @ S)
            right += np.einsum("tj,tja->ja", one.left @ one.columns, one.signals).ravel()
            energy += float(np.sum(one.left**2))
            count += _freedom(one.left, one.columns)
        for left, columns in geometry(run):
            exact += float(np.sum(left**2)), _freedom(left, columns)
    return Consistency(normal, right, energy, count, (float(exact[0]), float(exact[1])), scale)


def _freedom(left: Array, columns: Array) -> float:
    """Degrees of freedom of what is left (k, d) of channels that enter it by (d, J)."""
    if not columns.size:
        return 0.0
    return float(len(left) * np.linalg.matrix_rank(columns, tol=1e-9 * np.abs(columns).max()))


def _sizes(runs: Sequence[PreparedRun]) -> Array:
    """RMS (J,) of the quantity that each channel belongs to, over all runs."""
    parts = []
    for q in "xvu":
        values = np.concatenate([getattr(run, q).values for run in runs])
        known = values[np.isfinite(values)]
        rms = float(np.sqrt(np.mean(known**2))) if known.size else 1.0
        parts.append(np.full(values.shape[1], rms))
    return np.concatenate(parts)


def channel_signals(run: PreparedRun, scale: Array, fused: Fused) -> Array:
    """What one unit of each kind of error adds to each channel (n, J, 4)."""
    B = bodies_to_coordinates(run.model)
    rigid = np.ones(B.shape[1])
    rigid[:2] = 2.0
    whole = np.where(run.u.there, run.u.values, 0.0)
    z = np.nan_to_num(fused.z)
    inverse = np.linalg.pinv(B)
    # Rigid rotation is not in z; take it from u itself, where its own noise is all but averaged.
    along = (whole - z @ inverse.T) @ (rigid / (rigid @ rigid))
    u = z @ inverse.T + np.outer(along, rigid)
    y = np.nan_to_num(np.hstack([fused.x, fused.v, u]))
    slope = np.gradient(y, run.step_s, axis=0)
    n = fused.x.shape[1]
    slope[:, :n] = y[:, n : 2 * n]
    kinds = [y, np.ones_like(y), -slope, -slope * run.times[:, None]]
    there = np.concatenate([run.x.there, run.v.there, run.u.there])
    signals: Array = np.stack(kinds, axis=2) * scale * there[:, None]
    return signals


def geometry(run: PreparedRun) -> list[tuple[Array, Array]]:
    """What geometry leaves of x and u, then of v: whitened (n, d) with patterns (d, J)."""
    D, B = coordinates_to_meshes(run.model.layout), bodies_to_coordinates(run.model)
    n, nu = D.shape[0], B.shape[1]
    place = np.eye(2 * n + nu)
    at, on = np.concatenate([run.x.there, run.u.there]), run.v.there
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
    """What must be zero but for the noise of the channels that enter it.

    Attributes:
        left: (k, d) whitened remainders.
        columns: (d, J) how each channel enters them.
        signals: (k, J, a) courses of the channels as they enter.
        noise: (J,) variance of a channel's noise in them, over that of a sample.
    """

    left: Array
    columns: Array
    signals: Array
    noise: Array


def relations(run: PreparedRun, signals: Array) -> list[Relation]:
    """What x and u say by geometry, then v, then the increments of both against each other.

    Args:
        signals: (n, J, a) courses of the channels.
    """
    found = [Relation(*part, signals, np.ones(signals.shape[1])) for part in geometry(run)]
    z, P = displacement(run)
    rate, V = velocity(run)
    known = np.isfinite(np.diag(P)) & np.isfinite(np.diag(V))
    if known.any():
        h, n = run.step_s, run.x.there.size
        of_rate = h**2 * float(np.sum(QUADRATURE**2))
        spread = 2.0 * P + of_rate * V
        white = np.linalg.inv(np.linalg.cholesky(spread[np.ix_(known, known)]))
        left = (np.diff(z, axis=0) - increments(rate, h))[:, known] @ white.T
        flat = signals.reshape(len(signals), -1)
        moved = np.diff(flat, axis=0).reshape(-1, *signals.shape[1:])
        moved[:, n : 2 * n] = increments(flat, h).reshape(moved.shape)[:, n : 2 * n]
        noise = np.full(signals.shape[1], 2.0)
        noise[n : 2 * n] = of_rate
        columns = white @ _sensitivity(run)[known]
        found.append(Relation(left[2:-2], columns, moved[2:-2], noise))
    return [one for one in found if one.columns.size]


def _sensitivity(run: PreparedRun) -> Array:
    """Change (m, J) of z by x and u, and of minus its rate by v."""
    still = replace(run, waves=Waves(*(np.zeros((1, run.x.there.size)),) * 4))
    n, nu = run.x.there.size, run.u.there.size
    place = np.eye(2 * n + nu)

    def unit(measured: Measured, values: Array) -> Measured:
        return replace(measured, values=np.where(measured.there, values, np.nan))

    still = replace(
        still,
        x=unit(run.x, place[:, :n]),
        v=unit(run.v, place[:, n : 2 * n]),
        u=unit(run.u, place[:, 2 * n :]),
    )
    change: Array = (displacement(still)[0] - velocity(still)[0]).T
    return change


def _remainder(rows: Array, sigma: Array, seen: Array, to: Array) -> tuple[Array, Array]:
    """What geometry leaves of channels, whitened (n, d), and how each channel enters it (d, J)."""
    if len(rows) == 0:
        return np.zeros((len(seen), 0)), np.zeros((0, to.shape[1]))
    scale = np.maximum(sigma, 1e-300)
    left, size, _ = np.linalg.svd(rows / scale[:, None])
    rank = int(np.sum(size > 1e-9 * size[0]))
    free = left[:, rank:].T / scale
    return seen @ free.T, free @ to


def channel_arrays(run: PreparedRun) -> tuple[Array, Array]:
    """Channels x, v, u of a run side by side (n, J), and their noise (J,)."""
    parts = (run.x, run.v, run.u)
    return np.hstack([m.values for m in parts]), np.concatenate([m.sigma for m in parts])
