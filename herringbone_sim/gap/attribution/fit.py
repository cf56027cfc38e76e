"""The nonlinear fit of one hypothesis: effects and calibration together, inside hard bounds.

Gauss-Newton with the exact laws. Every run keeps its own normal equations, so that each can be
left out and predicted by the others without another fit, and so can blocks of mesh cycles, whose
spread gives the intervals: noise is white, what a hypothesis misses is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from herringbone_sim.effects.effect import Active
from herringbone_sim.gap.attribution.features import step_of
from herringbone_sim.gap.attribution.hypothesis import Case, expected
from herringbone_sim.gap.attribution.shortlist import calibration_columns
from herringbone_sim.gap.residuals.recalibrate import BOUNDS, force_law

Array = NDArray[np.float64]

BLOCK_CYCLES = 10
UNSTABLE = 1e30  # slope of a force past which its law has no step that is stable
NORMAL_90 = 1.645


@dataclass(frozen=True)
class Fit:
    """A hypothesis with its best parameters.

    Attributes:
        actives: effects with fitted parameters; none for the calibrated nominal model.
        factors: (6,) calibration that goes with them.
        sigma: (p,) standard deviation of the effects' parameters, in their order.
        chi2: mean square of residual over floor, in sample.
        left_out: the same of runs predicted by the others.
        per_run: (runs,) the same, run by run.
        per_mesh: (n_mesh,) in sample.
        gain: (values,) whitened change of the forces by the effects, calibration taken off.
    """

    actives: tuple[Active, ...]
    factors: Array
    sigma: Array
    chi2: float
    left_out: float
    per_run: Array
    per_mesh: Array
    gain: Array

    def interval(self, effect: int, parameter: int) -> tuple[float, float]:
        """90 % interval of a parameter of an effect, inside its bounds."""
        one = self.actives[effect]
        first = sum(len(a.theta) for a in self.actives[:effect])
        half = NORMAL_90 * float(self.sigma[first + parameter])
        low, high = (float(b[parameter]) for b in one.effect.bounds)
        value = one.theta[parameter]
        return max(value - half, min(low, value)), min(value + half, max(high, value))


@dataclass(frozen=True)
class Linear:
    """Whitened residual and Jacobian of one run: (n, n_mesh), (n, n_mesh, 6 + p)."""

    residual: Array
    jacobian: Array


def fit(cases: Sequence[Case], factors: Array, actives: Sequence[Active], rounds: int = 6) -> Fit:
    """Fit effects and calibration to the forces of some runs.

    Args:
        cases: fit runs.
        factors: (6,) calibration to start from.
        actives: with parameters to start from; may be empty.
        rounds: Gauss-Newton steps at most.
    """
    actives = tuple(actives)
    now = np.concatenate([factors, *(np.array(a.theta) for a in actives)])
    low, high, scale = _limits(actives)
    now = np.clip(now, low, high)
    cost = _cost(cases, now, actives)
    for _ in range(rounds):
        parts = [linear(c, now, actives) for c in cases]
        A, b = _normal(parts, now, scale)
        step = scale * _bounded(A.sum(0), b.sum(0), (low - now) / scale, (high - now) / scale)
        before = cost
        now, cost = _descend(cases, actives, now, step, cost)
        if before - cost < 1e-4 * before:
            break
    return _result(cases, now, actives, scale)


def _limits(actives: Sequence[Active]) -> tuple[Array, Array, Array]:
    """Lowest and highest values (6 + p,), and a moderate step of each."""
    lows, highs, scales = [1.0 - BOUNDS], [1.0 + BOUNDS], [BOUNDS]
    for one in actives:
        low, high = one.effect.bounds
        lows.append(low)
        highs.append(high)
        steps = [
            0.1 * abs(v) if p.unit == "N/m" and v else 1e3 * step_of(p)
            for p, v in zip(one.effect.parameters, one.theta, strict=True)
        ]
        scales.append(np.array(steps, dtype=float))
    return np.concatenate(lows), np.concatenate(highs), np.concatenate(scales)


def _split(values: Array, actives: Sequence[Active]) -> tuple[Active, ...]:
    first, found = 6, []
    for one in actives:
        found.append(one.with_theta(values[first : first + len(one.theta)]))
        first += len(one.theta)
    return tuple(found)


def _whitened(c: Case, values: Array, actives: Sequence[Active]) -> Array:
    """Residual (n, n_mesh) over the floor of the nominal law, 0 on meshes without data."""
    force = expected(c, values[:6], _split(values, actives))
    left: Array = (c.run.F.values - force) / c.floor
    used: Array = np.where(c.usable, left, 0.0)
    return used


def _cost(cases: Sequence[Case], values: Array, actives: Sequence[Active]) -> float:
    """Sum of squares, infinite where a spring is too stiff for the steps of a sample."""
    prior = float(np.sum(3.0 * ((values[:6] - 1.0) / BOUNDS) ** 2))
    with np.errstate(over="ignore", invalid="ignore"):
        cost = prior + sum(float(np.sum(_whitened(c, values, actives) ** 2)) for c in cases)
    return cost if np.isfinite(cost) else np.inf


def linear(c: Case, values: Array, actives: Sequence[Active]) -> Linear:
    """Residual and slopes of a run at calibration and parameters ``values`` (6 + p,)."""
    chosen = _split(values, actives)
    law = force_law(c.run, c.fused, values[:6])
    here = expected(c, values[:6], chosen, law)
    n = here.shape[1]
    columns = np.zeros((*here.shape, len(values)))
    for j, column in enumerate(calibration_columns(c, law, values[:6])):
        columns[:, : n // 2, 2 * j] = column[:, : n // 2]
        columns[:, n // 2 :, 2 * j + 1] = column[:, n // 2 :]
    first = 6
    for i, one in enumerate(chosen):
        high = one.effect.bounds[1]
        for k, p in enumerate(one.effect.parameters):
            theta = np.array(one.theta)
            h = 1e-2 * abs(theta[k]) if p.unit == "N/m" and theta[k] else step_of(p)
            h = -h if theta[k] + h > high[k] else h
            theta[k] += h
            changed = (*chosen[:i], one.with_theta(theta), *chosen[i + 1 :])
            columns[:, :, first] = (expected(c, values[:6], changed, law) - here) / h
            first += 1
    columns = np.where(np.abs(columns) < UNSTABLE, columns, 0.0)
    white = np.where(c.usable[None, :, None], columns / c.floor[:, :, None], 0.0)
    left = np.where(c.usable, (c.run.F.values - here) / c.floor, 0.0)
    return Linear(left, white)


def _normal(parts: Sequence[Linear], values: Array, scale: Array) -> tuple[Array, Array]:
    """Normal equations (runs + 1, q, q), (runs + 1, q); the last are those of the prior."""
    A, b = [], []
    for part in parts:
        J = (part.jacobian * scale).reshape(-1, len(scale))
        A.append(J.T @ J)
        b.append(J.T @ part.residual.ravel())
    weight = np.zeros(len(scale))
    weight[:6] = 3.0
    right = np.zeros(len(scale))
    right[:6] = 3.0 * (1.0 - values[:6]) / scale[:6]
    return np.stack([*A, np.diag(weight)]), np.stack([*b, right])


def _bounded(A: Array, b: Array, low: Array, high: Array) -> Array:
    ridge = A + 1e-9 * np.diag(np.diag(A) + 1.0)
    root = np.linalg.cholesky(ridge).T
    found = lsq_linear(root, np.linalg.solve(root.T, b), bounds=(low - 1e-9, high + 1e-9))
    step: Array = np.clip(found.x, low, high)
    return step


def _descend(
    cases: Sequence[Case], actives: Sequence[Active], now: Array, step: Array, cost: float
) -> tuple[Array, float]:
    """Half the step until the sum of squares falls."""
    for _ in range(4):
        trial = now + step
        found = _cost(cases, trial, actives)
        if found < cost:
            return trial, found
        step = 0.4 * step
    return now, cost


def _result(cases: Sequence[Case], now: Array, actives: Sequence[Active], scale: Array) -> Fit:
    chosen = _split(now, actives)
    parts = [linear(c, now, actives) for c in cases]
    low, high, _ = _limits(actives)
    inside = (now > low + 1e-6 * scale) & (now < high - 1e-6 * scale)
    free = np.flatnonzero(inside | (np.arange(len(now)) >= 6))
    A, b = _normal(parts, now, scale)
    A, b = A[:, free][:, :, free], b[:, free]
    squares = np.array([float(np.sum(part.residual**2)) for part in parts])
    counts = np.array([float(c.usable.sum() * len(c.run)) for c in cases])
    room = ((low - now) / scale)[free], ((high - now) / scale)[free]
    out = _left_out(A, b, squares, room)
    sigma = np.zeros(len(now))
    sigma[free] = _spread(cases, parts, A.sum(0), free, scale) * scale[free]
    energy = np.sum([np.sum(part.residual**2, axis=0) for part in parts], axis=0)
    samples = sum(len(c.run) for c in cases)
    return Fit(
        actives=chosen,
        factors=now[:6],
        sigma=sigma[6:],
        chi2=_known(squares.sum() / counts.sum()),
        left_out=_known(out.sum() / counts.sum()),
        per_run=out / counts,
        per_mesh=energy / samples,
        gain=_gain(cases, now, chosen, parts),
    )


def _known(chi2: float) -> float:
    """As it is; infinite where a spring was too stiff for the steps."""
    return float(chi2) if np.isfinite(chi2) else np.inf


def _left_out(A: Array, b: Array, squares: Array, room: tuple[Array, Array]) -> Array:
    """Sum of squares of each run as the others predict it, by its own normal equations."""
    found: Array = squares.copy()
    whole, right = A.sum(0), b.sum(0)
    for run in range(len(squares) if len(squares) > 1 else 0):
        rest = whole - A[run] + 1e-9 * np.diag(np.diag(whole))
        d = _bounded(rest, right - b[run], *room)
        found[run] += max(float(d @ A[run] @ d - 2.0 * b[run] @ d), -0.5 * squares[run])
    return found


def _spread(
    cases: Sequence[Case],
    parts: Sequence[Linear],
    A: Array,
    free: NDArray[np.int64],
    scale: Array,
) -> Array:
    """Standard deviations of scaled parameters by the sandwich over blocks of mesh cycles."""
    middle = np.zeros_like(A)
    for c, part in zip(cases, parts, strict=True):
        scores = np.einsum("tm,tmq->tq", part.residual, part.jacobian[:, :, free] * scale[free])
        cycles = (c.run.phase - c.run.phase[0]) / (2.0 * np.pi)
        starts = np.unique((cycles // BLOCK_CYCLES).astype(int), return_index=True)[1]
        sums = np.add.reduceat(scores, starts, axis=0)
        middle += sums.T @ sums
    inverse = np.linalg.inv(A + 1e-9 * np.diag(np.diag(A) + 1.0))
    spread: Array = np.sqrt(np.maximum(np.diag(inverse @ middle @ inverse), np.diag(inverse)))
    return spread


def _gain(
    cases: Sequence[Case], now: Array, chosen: Sequence[Active], parts: Sequence[Linear]
) -> Array:
    """What the effects change, whitened, without what the calibration could have done."""
    bare = [
        _whitened(c, now[:6], ()) - part.residual for c, part in zip(cases, parts, strict=True)
    ]
    change = np.concatenate([one.ravel() for one in bare])
    own = np.concatenate([part.jacobian[:, :, :6].reshape(-1, 6) for part in parts])
    normal = own.T @ own
    normal += 1e-9 * np.diag(np.diag(normal) + 1e-300)
    along: Array = change - own @ np.linalg.solve(normal, own.T @ change)
    return along
