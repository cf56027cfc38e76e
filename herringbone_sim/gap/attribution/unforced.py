"""Attribution without force sensors: what effects would do to the accelerations of the bodies.

The forces of the law take the place of the measured ones in the torque balance, so meshes and
bodies are tried together: the force that an effect adds on its meshes goes through the inertias.
Linear in the tolerances, Gauss-Newton in the effect. Eight accelerations answer for twelve
forces, so less can be told apart; events at single teeth are not tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Active, Effect, Locus
from herringbone_sim.gap.attribution.bodies import BodyFit, response
from herringbone_sim.gap.attribution.features import Feature, features, of_level
from herringbone_sim.gap.attribution.hypothesis import Case, added
from herringbone_sim.gap.attribution.shortlist import calibration_columns
from herringbone_sim.gap.residuals.balance import Balance, inertia_parts
from herringbone_sim.gap.residuals.balance import window_of as look_of
from herringbone_sim.gap.residuals.motion import (
    WIDTH,
    fused_noise,
    motion_balance,
    recalibrate_motion,
)
from herringbone_sim.gap.residuals.recalibrate import BOUNDS, HEAVIEST, Law, force_law

Array = NDArray[np.float64]

FINALISTS = 8
ROUNDS = 3
STRIDE = 3
OF_ONE_EFFECT = 3
TIE = 0.05  # of what is left, within which the wider place is tried first


@dataclass(frozen=True)
class Unforced:
    """Fits of the accelerations.

    Attributes:
        factors, inverse: (6,) and (3,) calibration of law and inertias.
        fits: the nominal balance first, then effects by what they leave of runs left out.
        filtered: whether they are fits of the innovations of a filter, for want of channels.
        unseen: ids of effects that these channels don't see.
    """

    factors: Array
    inverse: Array
    fits: tuple[BodyFit, ...]
    filtered: bool = False
    unseen: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Run:
    """A run: case, law, whitened residual (k m,), tolerance columns (9, k m), matrix (m, n)."""

    case: Case
    law: Law
    balance: Balance
    residual: Array
    tolerance: Array
    through: Array


def moving(cases: Sequence[Case]) -> bool:
    """Whether all displacements and rates are known."""
    return all(np.isfinite(c.fused.x).all() and np.isfinite(c.fused.v).all() for c in cases)


def unforced(
    cases: Sequence[Case], effects: Sequence[Effect], rng: np.random.Generator
) -> Unforced:
    """Try every effect that moves the bodies at every place."""
    calibration, inertias = recalibrate_motion(
        [c.run for c in cases], [c.fused for c in cases], rng
    )
    runs = [_run(c, calibration.factors, inertias.inverse, rng) for c in cases]
    factors = calibration.factors
    nominal = _fitted(runs, (), None)
    found = []
    for feature in _regressors(cases, effects):
        responses = [[_averaged(r, factors, p) / step for p, step in feature.probes] for r in runs]
        layout = cases[0].run.model.layout
        for locus in feature.start.effect.candidates(layout):
            mask = locus.mask(layout)
            if np.any(mask * (1.0 - feature.start.locus.mask(layout))):
                continue
            columns = [
                [_whitened(r, q * mask) for q in own]
                for r, own in zip(runs, responses, strict=True)
            ]
            at = replace(feature, start=replace(feature.start, locus=locus))
            found.append(_fitted(runs, columns, at))
    found.sort(key=lambda one: one.left_out)
    better = [_refined(runs, factors, one) for one in best_of_each(found)[:FINALISTS]]
    bodies = [_body(runs, factors, f) for f in of_level(effects, "body")]
    ranked = sorted((*better, *bodies), key=lambda one: one.left_out)
    return Unforced(factors, inertias.inverse, (nominal, *once(ranked)))


def _regressors(cases: Sequence[Case], effects: Sequence[Effect]) -> list[Feature]:
    meshes = [e for e in effects if e.level == "mesh"]
    return features(cases[0].run.model, meshes)


def best_of_each(found: Sequence[BodyFit]) -> list[BodyFit]:
    """The best fits, not more than so many of an effect; wide places first where they tie."""
    taken: dict[str, int] = {}
    best = []

    def rank(one: BodyFit) -> float:
        locus = one.actives[0].locus
        return one.left_out * (1.0 + TIE * ((locus.planet != "all") + (locus.side != "all")))

    for one in sorted(found, key=rank):
        name = one.actives[0].effect.id
        taken[name] = taken.get(name, 0) + 1
        if taken[name] <= OF_ONE_EFFECT:
            best.append(one)
    return best


def once(ranked: Sequence[BodyFit]) -> list[BodyFit]:
    """Each effect at each place once, by its best fit: not one for every order of a ripple."""
    found: dict[tuple[str, Locus], BodyFit] = {}
    for one in ranked:
        found.setdefault((one.actives[0].effect.id, one.actives[0].locus), one)
    return list(found.values())


def with_law_forces(c: Case, law: Law) -> Case:
    """A case whose forces are the law's where none is measured: they drive rings and pins."""
    values = np.where(np.isfinite(c.run.F.values), c.run.F.values, law.modelled_n)
    return replace(c, run=replace(c.run, F=replace(c.run.F, values=values)))


def _run(c: Case, factors: Array, inverse: Array, rng: np.random.Generator) -> _Run:
    balance = motion_balance(c.run, c.fused, fused_noise(c.run, rng), factors, inverse)
    law = force_law(c.run, c.fused, factors)
    c = with_law_forces(c, law)
    A = np.tensordot(inverse, inertia_parts(c.run.model), axes=1)
    look = look_of(c.run, WIDTH)
    half = law.f_m.shape[1] // 2
    columns = []
    for column in calibration_columns(c, law, factors):
        for kind in range(2):
            part = np.zeros_like(column)
            part[:, kind * half : (kind + 1) * half] = column[:, kind * half : (kind + 1) * half]
            columns.append(_thinned(look.average(part) @ A.T, balance))
    columns += [_thinned(part, balance) for part in balance.parts]
    left = _thinned(balance.residual, balance)
    return _Run(c, law, balance, left, np.stack(columns), A)


def _averaged(r: _Run, factors: Array, probe: Active) -> Array:
    average: Array = look_of(r.case.run, WIDTH).average(added(r.case, factors, r.law, (probe,))[0])
    return average


def _whitened(r: _Run, average: Array) -> Array:
    return _thinned(average @ r.through.T, r.balance)


def _thinned(values: Array, balance: Balance) -> Array:
    """Values (k, m) over their floor, every third: the window has made neighbours alike."""
    thinned: Array = (values / balance.sigma)[::STRIDE].ravel()
    return thinned


def _fitted(
    runs: Sequence[_Run], columns: Sequence[Sequence[Array]], feature: Feature | None
) -> BodyFit:
    grams, rights, squares = [], [], []
    for i, r in enumerate(runs):
        J = np.vstack([r.tolerance, *(columns[i] if columns else ())])
        grams.append(J @ J.T)
        rights.append(J @ r.residual)
        squares.append(float(r.residual @ r.residual))
    A, b = np.stack(grams), np.stack(rights)
    count = sum(r.residual.size for r in runs)
    overlap = runs[0].balance.overlap / STRIDE
    beta, sigma = _solve(A.sum(0), b.sum(0), overlap)
    out = sum(squares)
    for i in range(len(runs)):
        rest = np.arange(len(runs)) != i
        other = _solve(A[rest].sum(0), b[rest].sum(0), overlap)[0] if rest.any() else beta
        out += float(other @ A[i] @ other - 2.0 * b[i] @ other)
    left = sum(squares) + float(beta @ A.sum(0) @ beta - 2.0 * b.sum(0) @ beta)
    actives: tuple[Active, ...] = ()
    spread = np.zeros(0)
    if feature is not None:
        theta = feature.theta(beta[9:])
        actives = (feature.start.with_theta(theta),)
        spread = np.resize(sigma[9:], len(theta)) * np.sqrt(max(left / count, 1.0))
    return BodyFit(actives, spread, 1.0 + beta[6:9], left / count, out / count)


def _solve(A: Array, b: Array, overlap: float) -> tuple[Array, Array]:
    """Coefficients with tolerances inside their bounds, and their sigma."""
    bounds = np.concatenate([BOUNDS, np.full(3, HEAVIEST - 1.0)])
    weight = np.zeros(len(b))
    weight[:9] = overlap * 3.0 / bounds**2
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A) + weight, 1e-300))
    whole = (A + np.diag(weight)) * np.outer(scale, scale) + 1e-10 * np.eye(len(b))
    beta = scale * np.linalg.solve(whole, scale * b)
    held = np.clip(beta[:9], -bounds, bounds)
    if len(b) > 9 and not np.array_equal(held, beta[:9]):
        rest = A[9:, 9:] + 1e-10 * np.diag(np.diag(A)[9:] + 1e-300)
        beta[9:] = np.linalg.solve(rest, b[9:] - A[9:, :9] @ held)
    beta[:9] = held
    sigma: Array = scale * np.sqrt(np.diag(np.linalg.inv(whole)) * overlap)
    return beta, sigma


def _refined(runs: Sequence[_Run], factors: Array, one: BodyFit) -> BodyFit:
    """Gauss-Newton from a linear fit: what the law adds at theta, and its slopes there."""
    best = one
    now = one.actives[0]
    effect = now.effect
    best_left = np.inf
    for _ in range(ROUNDS):
        steps = np.maximum(1e-3 * np.abs(np.array(now.theta) - _finite(effect)), 1e-12)
        whole = [_averaged(r, factors, now) for r in runs]
        moved, columns = [], []
        for r, here in zip(runs, whole, strict=True):
            own = []
            for k, h in enumerate(steps):
                theta = np.array(now.theta)
                theta[k] += h
                there = _averaged(r, factors, now.with_theta(theta))
                own.append(_whitened(r, (there - here) / h))
            columns.append(own)
            moved.append(replace(r, residual=r.residual - _whitened(r, here)))
        feature = Feature(now, (), "step")
        found = _fitted(moved, columns, feature)
        change = _change(moved, columns)
        theta = np.clip(np.array(now.theta) + change, *effect.bounds)
        if found.left_out < best_left:
            best_left = found.left_out
            best = replace(found, actives=(now.with_theta(theta),))
        now = now.with_theta(theta)
    return best


def _change(runs: Sequence[_Run], columns: Sequence[Sequence[Array]]) -> Array:
    J = [np.vstack([r.tolerance, *own]) for r, own in zip(runs, columns, strict=True)]
    A = np.sum([j @ j.T for j in J], axis=0)
    b = np.sum([j @ r.residual for j, r in zip(J, runs, strict=True)], axis=0)
    return _solve(A, b, runs[0].balance.overlap / STRIDE)[0][9:]


def _finite(effect: Effect) -> Array:
    rest: Array = np.where(np.isfinite(effect.neutral), effect.neutral, 0.0)
    return rest


def _body(runs: Sequence[_Run], factors: Array, feature: Feature) -> BodyFit:
    """An effect on the bodies, by its torques averaged over the narrow window."""
    columns = [
        [
            _thinned(response(r.case, factors, r.law, p, WIDTH) / step, r.balance)
            for p, step in feature.probes
        ]
        for r in runs
    ]
    return _fitted(runs, columns, feature)
