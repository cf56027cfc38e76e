"""Attribution from few channels: what effects would do to the innovations of a filter.

The filter of the calibrated nominal gear sees the motion through what channels there are; with its
gains kept, every effect at every place changes the innovations in its own way. Linear regression
over all, then Gauss-Newton with the exact gear for the best few; runs left out score. Identical
planets move in step, so a place is a kind of mesh and a side, and planet 1 stands for any one of
them. Events at single teeth are not tried: nothing as local is left in the motion of the suns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Active, Effect
from herringbone_sim.gap.attribution.bodies import BodyFit
from herringbone_sim.gap.attribution.features import Feature, features, of_level
from herringbone_sim.gap.attribution.hypothesis import Case
from herringbone_sim.gap.attribution.unforced import Unforced, best_of_each, once
from herringbone_sim.gap.filtering.linear import Linear, answer, linear, responses, through
from herringbone_sim.gap.filtering.runs import ALL_BOUNDS, PRIOR, Watched, left, settled, watch

Array = NDArray[np.float64]

FINALISTS = 6
ROUNDS = 3
BATCH = 64  # columns at a time
SEEN = 3.0  # sigma that a moderate effect must change the innovations by, to be tried


@dataclass(frozen=True)
class Tried:
    """An effect at a place: its feature, and columns per run (p, n k) of the innovations."""

    feature: Feature
    columns: tuple[Array, ...]


def few(cases: Sequence[Case], effects: Sequence[Effect]) -> Unforced:
    """Try every effect of the machine by the innovations of a filter."""
    runs, p = watch([c.run for c in cases])
    tried = _tried(runs, p, effects)
    seen = [one for one in tried if _size(one) > SEEN]
    names = {one.feature.start.effect.id for one in seen}
    unseen = {one.feature.start.effect.id for one in tried} - names
    nominal = _fitted(runs, p, None)
    found = sorted((_fitted(runs, p, one) for one in seen), key=lambda fit: fit.left_out)
    better = [_refined(runs, p, one) for one in best_of_each(found)[:FINALISTS]]
    ranked = sorted((*better, *found), key=lambda one: one.left_out)
    fits = (nominal, *once(ranked))
    return Unforced(p[:6], p[6:], fits, filtered=True, unseen=tuple(sorted(unseen)))


def _tried(runs: Sequence[Watched], p: Array, effects: Sequence[Effect]) -> list[Tried]:
    model = runs[0].run.model
    machine = [e for e in effects if e.level == "mesh"]
    placed = []
    for feature in (*features(model, machine), *of_level(effects, "body")):
        for locus in feature.start.effect.candidates(model.layout):
            mask = locus.mask(model.layout)
            inside = feature.start.locus.mask(model.layout)
            if locus.planet in ("all", "1") and not np.any(mask * (1.0 - inside)):
                placed.append(
                    (feature, replace(feature, start=replace(feature.start, locus=locus)))
                )
    columns = [_columns(r, linear(r.run, r.by, p[:6], p[6:]), placed) for r in runs]
    found, at = [], 0
    for _, own in placed:
        count = len(own.probes)
        found.append(Tried(own, tuple(c[at : at + count] for c in columns)))
        at += count
    return found


def _columns(r: Watched, line: Linear, placed: Sequence[tuple[Feature, Feature]]) -> Array:
    """Change (c, n k) of the innovations by a unit of every probe at every place."""
    layout = r.run.model.layout
    shared: dict[int, list[tuple[Array, Array]]] = {}
    waiting: list[Array] = []
    found: list[Array] = []
    start = settled(r.run)

    def flush() -> None:
        change = responses(line, np.stack(waiting, axis=2))[start:]
        found.extend(change.reshape(-1, len(waiting)).T)
        waiting.clear()

    for feature, own in placed:
        body = feature.start.effect.level == "body"
        if id(feature) not in shared:
            shared = {} if body else {id(feature): [answer(line, (q,)) for q, _ in feature.probes]}
        for i, (probe, step) in enumerate(feature.probes):
            if body:
                at = replace(probe, locus=own.start.locus)
                force, torque = answer(line, (at,))
                mask = np.ones(layout.n_mesh)
            else:
                force, torque = shared[id(feature)][i]
                mask = own.start.locus.mask(layout)
            waiting.append(through(line, (force - line.force) / step, torque / step, mask))
            if len(waiting) == BATCH:
                flush()
    if waiting:
        flush()
    return np.stack(found)


def _size(one: Tried) -> float:
    """Norm of what a moderate effect does to the innovations."""
    effect = one.feature.start.effect
    moderate = np.abs(effect.start - effect.neutral)
    sized = moderate[np.isfinite(moderate) & (moderate > 0.0)]
    scale = float(sized.max()) if sized.size and one.feature.kind != "whole" else 1.0
    return scale * float(np.sqrt(sum(np.sum(c[0] ** 2) for c in one.columns)))


def _system(
    runs: Sequence[Watched], columns: Sequence[Array] | None
) -> tuple[Array, Array, Array]:
    """Normal matrices (runs, c, c), right sides (runs, c) and squares (runs,)."""
    grams, rights, squares = [], [], []
    for i, r in enumerate(runs):
        J = r.tolerance if columns is None else np.vstack([r.tolerance, columns[i]])
        grams.append(J @ J.T)
        rights.append(-J @ r.left)
        squares.append(float(r.left @ r.left))
    return np.stack(grams), np.stack(rights), np.array(squares)


def _solve(A: Array, b: Array, p: Array, excess: float) -> tuple[Array, Array]:
    """Coefficients with tolerances inside their bounds around 1, and their sigma."""
    n = len(b)
    weight, right = np.zeros(n), b / excess
    weight[:9] = PRIOR
    right[:9] += PRIOR * (1.0 - p)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A) / excess + weight, 1e-300))
    whole = (A / excess + np.diag(weight)) * np.outer(scale, scale) + 1e-10 * np.eye(n)
    beta = scale * np.linalg.solve(whole, scale * right)
    held = np.clip(p + beta[:9], 1.0 - ALL_BOUNDS, 1.0 + ALL_BOUNDS) - p
    if n > 9 and not np.allclose(held, beta[:9]):
        rest = A[9:, 9:] + 1e-10 * np.diag(np.diag(A)[9:] + 1e-300)
        beta[9:] = np.linalg.solve(rest, b[9:] - A[9:, :9] @ held)
    beta[:9] = held
    sigma: Array = scale * np.sqrt(np.diag(np.linalg.inv(whole)))
    return beta, sigma


def _fitted(runs: Sequence[Watched], p: Array, one: Tried | None) -> BodyFit:
    whole = one is not None and one.feature.kind == "whole"
    A, b, squares = _system(runs, None if one is None else one.columns)
    count = sum(r.left.size for r in runs)
    excess = max(float(squares.sum()) / count, 1.0)
    beta, sigma = _solve(A.sum(0), b.sum(0), p, excess)
    if whole:
        beta[9:] = 1.0
    out = _left_out(A, b, squares, p, excess, whole)
    rest = float(squares.sum() + beta @ A.sum(0) @ beta - 2.0 * b.sum(0) @ beta)
    actives: tuple[Active, ...] = ()
    spread = np.zeros(0)
    if one is not None:
        theta = one.feature.theta(beta[9:])
        actives = (one.feature.start.with_theta(theta),)
        spread = np.resize(sigma[9:], len(theta))
    wide = float(np.mean([r.looser**2 for r in runs])) / count
    return BodyFit(actives, spread, 1.0 + beta[6:9], wide * rest, wide * out)


def _left_out(A: Array, b: Array, squares: Array, p: Array, excess: float, whole: bool) -> float:
    out = float(squares.sum())
    for i in range(len(A)):
        rest = np.arange(len(A)) != i
        if not rest.any():
            rest[:] = True
        beta = _solve(A[rest].sum(0), b[rest].sum(0), p, excess)[0]
        if whole:
            beta[9:] = 1.0
        out += float(beta @ A[i] @ beta - 2.0 * b[i] @ beta)
    return out


def _refined(runs: Sequence[Watched], start: Array, one: BodyFit) -> BodyFit:
    """Gauss-Newton with the exact gear; tolerances keep their slopes.

    From the nominal constants on: those calibrated without the effect stand in for it.
    """
    best, now, p = one, one.actives[0], np.ones(9)
    least = np.inf
    for _ in range(ROUNDS):
        steps = _steps(now)
        moved, columns = [], []
        for r in runs:
            here = left(r.run, r.by, p, (now,))
            own = []
            for k, h in enumerate(steps):
                theta = np.array(now.theta)
                theta[k] += h
                own.append((left(r.run, r.by, p, (now.with_theta(theta),)) - here) / h)
            moved.append(replace(r, left=here))
            columns.append(np.stack(own))
        if not all(np.isfinite(r.left).all() for r in moved):
            break
        found = _fitted(moved, p, Tried(Feature(now, (), "step"), tuple(columns)))
        A, b, squares = _system(moved, columns)
        excess = max(float(squares.sum()) / sum(r.left.size for r in moved), 1.0)
        beta, sigma = _solve(A.sum(0), b.sum(0), p, excess)
        now = now.with_theta(np.clip(np.array(now.theta) + beta[9:], *now.effect.bounds))
        p = p + beta[:9]
        if found.left_out < least:
            least = found.left_out
            inverse = 1.0 + p[6:] - start[6:]
            best = replace(found, actives=(now,), sigma=sigma[9:], inverse=inverse)
    return best


def _steps(now: Active) -> Array:
    """A small step of each parameter that stays inside its bounds."""
    effect = now.effect
    rest = np.where(np.isfinite(effect.neutral), effect.neutral, 0.0)
    theta, high = np.array(now.theta), effect.bounds[1]
    sizes = np.maximum(np.abs(theta - rest), np.abs(effect.start - rest))
    steps = np.where(sizes > 0.0, 1e-3 * sizes, 1e-4)
    inside: Array = np.where(theta + steps > high, -steps, steps)
    return inside
