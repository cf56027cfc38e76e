"""A shortlist by linear regression: every effect at every locus, scored on runs left out.

Products of all regressors are taken once, mesh by mesh and run by run; a hypothesis is then a sum
of some of their entries. The tolerances of the nominal parameters are fitted along with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Active, Effect, Locus, active
from herringbone_sim.errors import ParameterError
from herringbone_sim.gap.attribution import events
from herringbone_sim.gap.attribution.features import Feature, features, is_event
from herringbone_sim.gap.attribution.hypothesis import SUBSTEPS, Case, expected
from herringbone_sim.gap.residuals.recalibrate import BOUNDS, Law, force_law

Array = NDArray[np.float64]

ROUGH = 6  # steps a sample, in which states of effects follow the forces where that is enough
UNSTABLE = 1e12  # [N]: a spring too stiff for those steps
FAR = 0.02  # of the fall of the best candidate,
CHANCE = 12.0  # and squares that chance takes off: candidates below are not fitted
FEWEST = 3  # but so many are


@dataclass(frozen=True)
class Candidate:
    """An effect at a place with a start value.

    Attributes:
        active: with the parameters of the linear fit.
        fall: how much it lowers the sum of squares of runs that were left out.
    """

    active: Active
    fall: float


@dataclass(frozen=True)
class Base:
    """What the regression starts from: a law, maybe with effects that were found before.

    Attributes:
        cases: fit runs.
        factors: (6,) calibration.
        actives: effects already in the law.
        residuals: per run (n, n_mesh), whitened; 0 on meshes that can't be used.
        laws: per run.
        responses: (n, n_mesh) per run and feature of effects with states of their own, once they
            are known: measured forces drive them, whatever else is in the law.
    """

    cases: tuple[Case, ...]
    factors: Array
    actives: tuple[Active, ...]
    residuals: tuple[Array, ...]
    laws: tuple[Law, ...]
    responses: dict[tuple[int, Feature], Array]


def base(
    cases: Sequence[Case],
    factors: Array,
    actives: Sequence[Active] = (),
    before: Base | None = None,
) -> Base:
    """Residuals of some runs under a law with effects, maybe after one with fewer."""
    laws = tuple(force_law(c.run, c.fused, factors) for c in cases)
    left = []
    for c, law in zip(cases, laws, strict=True):
        r = (c.run.F.values - expected(c, factors, actives, law)) / law.sigma_n
        left.append(np.where(c.usable, np.nan_to_num(r), 0.0))
    known = {} if before is None else before.responses
    return Base(tuple(cases), factors, tuple(actives), tuple(left), laws, known)


def shortlist(start: Base, effects: Sequence[Effect]) -> list[Candidate]:
    """All candidates by how much they predict of runs left out, the best first."""
    model = start.cases[0].run.model
    regressors = features(model, effects)
    found = _regress(start, regressors)
    for effect in effects:
        if is_event(effect):
            found += _events(start, effect)
        elif not effect.parameters and effect.level == "sensor":
            found += _swaps(start, effect)
    return sorted(found, key=lambda candidate: -candidate.fall)


def choose(candidates: Sequence[Candidate], most: int, per_effect: int = 2) -> list[Candidate]:
    """The best few: not more than so many of one effect, and hardly any far behind the best."""
    taken: dict[str, int] = {}
    chosen: list[Candidate] = []
    least = max(FAR * candidates[0].fall, CHANCE) if candidates else 0.0
    for one in candidates:
        name = one.active.effect.id
        wanted = one.fall > least or len(chosen) < FEWEST
        if taken.get(name, 0) < per_effect and one.fall > 0.0 and wanted:
            taken[name] = taken.get(name, 0) + 1
            chosen.append(one)
    return chosen[:most]


def _regress(start: Base, regressors: Sequence[Feature]) -> list[Candidate]:
    grams, rights, at = _products(start, regressors)
    layout = start.cases[0].run.model.layout
    alone = _calibration_alone(grams, rights, start.factors)
    found = []
    for feature, columns in zip(regressors, at, strict=True):
        for locus in feature.start.effect.candidates(layout):
            inside = locus.mask(layout) * everywhere_mask(feature, start)
            if not np.array_equal(inside, locus.mask(layout)):
                continue
            A, b = _system(grams, rights, columns, inside)
            fall, coefficients = _left_out(A, b, start.factors)
            fall -= alone
            theta = feature.theta(coefficients)
            one = replace(feature.start.with_theta(theta), locus=locus)
            found.append(Candidate(one, fall))
    return found


def everywhere_mask(feature: Feature, start: Base) -> Array:
    """Meshes (n_mesh,) on which a feature has a response at all."""
    return feature.start.locus.mask(start.cases[0].run.model.layout)


def _products(start: Base, regressors: Sequence[Feature]) -> tuple[Array, Array, list[list[int]]]:
    """Gram matrices (runs, n_mesh, c, c), right sides (runs, n_mesh, c), columns of each."""
    at, count = [], 3
    for feature in regressors:
        at.append(list(range(count, count + len(feature.probes))))
        count += len(feature.probes)
    grams, rights = [], []
    for run, (c, law, left) in enumerate(
        zip(start.cases, start.laws, start.residuals, strict=True)
    ):
        substeps = ROUGH
        before = expected(c, start.factors, start.actives, law, substeps)
        if not _stable(c, before):
            substeps = SUBSTEPS
            before = expected(c, start.factors, start.actives, law, substeps)
        columns = calibration_columns(c, law, start.factors)
        for feature in regressors:
            columns += _columns(start, run, feature, before, substeps)
        white = np.stack(columns, axis=2) / law.sigma_n[:, :, None]
        white = np.where(c.usable[None, :, None], np.nan_to_num(white), 0.0).transpose(1, 2, 0)
        grams.append(white @ white.transpose(0, 2, 1))
        rights.append((white @ left.T[:, :, None])[:, :, 0])
    return np.stack(grams), np.stack(rights), at


def _stable(c: Case, force: Array) -> bool:
    """Whether no spring was too stiff for the steps."""
    return bool(np.all(np.abs(force[:, c.usable]) < UNSTABLE))


def _columns(start: Base, run: int, feature: Feature, before: Array, substeps: int) -> list[Array]:
    """Change of the force (n, n_mesh) of a run by each probe of a feature."""
    if (run, feature) in start.responses:
        return [start.responses[run, feature]]
    c, law = start.cases[run], start.laws[run]
    found = []
    for probe, step in feature.probes:
        after = expected(c, start.factors, (*start.actives, probe), law, substeps)
        found.append((after - before) / step if _stable(c, after) else np.zeros_like(before))
    if feature.kind == "whole":
        start.responses[run, feature] = found[0]
    return found


def calibration_columns(c: Case, law: Law, factors: Array) -> list[Array]:
    """Change of the force (n, n_mesh) by the factors on k, c and e of each mesh."""
    n = law.f_m.shape[1]
    k = c.run.waves.k * np.repeat(factors[:2], n // 2)
    damping = c.run.model.damping_n_s_per_m * np.repeat(factors[2:4], n // 2)
    return [
        c.run.waves.k * law.f_m,
        c.run.model.damping_n_s_per_m * law.v_m_per_s,
        -(k * law.contact * c.run.waves.e + damping * c.run.waves.e_rate),
    ]


def _left_out(A: Array, b: Array, factors: Array) -> tuple[float, Array]:
    """Fall of the squares of runs left out, and the coefficients from all runs."""
    every, right = A.sum(0), b.sum(0)
    fall = 0.0
    for run in range(len(A)):
        beta = np.zeros(len(right))
        if len(A) > 1:
            beta = _solve(every - A[run], right - b[run], factors)
        fall += _fall(A[run], b[run], beta)
    return fall, _solve(every, right, factors)[6:]


def _calibration_alone(grams: Array, rights: Array, factors: Array) -> float:
    """Fall of the squares of runs left out by the calibration without any effect."""
    A, b = _system(grams, rights, [], np.ones(grams.shape[1]))
    return _left_out(A, b, factors)[0]


def _system(grams: Array, rights: Array, columns: list[int], mask: Array) -> tuple[Array, Array]:
    """Normal equations (runs, 6 + p, 6 + p) of calibration and columns on the meshes of a mask."""
    n, p = grams.shape[1], len(columns)
    A, b = np.zeros((len(grams), 6 + p, 6 + p)), np.zeros((len(grams), 6 + p))
    for kind in range(2):
        half = slice(kind * n // 2, (kind + 1) * n // 2)
        own, inside = np.arange(3) * 2 + kind, mask[half]
        A[:, own[:, None], own] = grams[:, half, :3, :3].sum(1)
        b[:, own] = rights[:, half, :3].sum(1)
        cross = np.einsum("m,rmij->rij", inside, grams[:, half, :3][..., columns])
        A[:, own[:, None], 6 + np.arange(p)] = cross
        A[:, (6 + np.arange(p))[:, None], own] = cross.transpose(0, 2, 1)
    ours = grams[:, :, columns][..., columns]
    A[:, 6:, 6:] = np.einsum("m,rmij->rij", mask, ours)
    b[:, 6:] = np.einsum("m,rmi->ri", mask, rights[:, :, columns])
    return A, b


def _solve(A: Array, b: Array, factors: Array) -> Array:
    """Least squares with the prior of the calibration, which is held inside its bounds."""
    prior = np.zeros(len(b))
    prior[:6] = 3.0 / BOUNDS**2
    right = b.copy()
    right[:6] += prior[:6] * (1.0 - factors)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A) + prior, 1e-300))
    whole = (A + np.diag(prior)) * np.outer(scale, scale)
    ridge = 1e-9 * np.eye(len(b))
    beta: Array = scale * np.linalg.solve(whole + ridge, scale * right)
    held = np.clip(factors + beta[:6], 1.0 - BOUNDS, 1.0 + BOUNDS) - factors
    if len(b) == 6 or np.abs(held - beta[:6]).max() < 1e-9:
        return np.concatenate([held, beta[6:]])
    rest = A[6:, 6:] + 1e-9 * np.diag(np.diag(A)[6:] + 1e-300)
    return np.concatenate([held, np.linalg.solve(rest, b[6:] - A[6:, :6] @ held)])


def _fall(A: Array, b: Array, beta: Array) -> float:
    return float(2.0 * b @ beta - beta @ A @ beta)


def _events(start: Base, effect: Effect) -> list[Candidate]:
    model = start.cases[0].run.model
    best: dict[tuple[str, Locus], Candidate] = {}
    for width in events.WIDTHS:
        probe, step = events.probe(effect, width)
        folds = [
            events.fold(c, start.factors, law, left, probe, step)
            for c, law, left in zip(start.cases, start.laws, start.residuals, strict=True)
        ]
        for member in ("sun", "planet", "ring"):
            sums = [events.modulo(model, effect, member, f) for f in folds]
            right, normal = (np.stack([s[i] for s in sums]) for i in range(2))
            for locus in effect.candidates(model.layout):
                if not _has_part(member, locus):
                    continue
                mask = locus.mask(model.layout)
                b, A = (np.einsum("m,rmp->rp", mask, q) for q in (right, normal))
                rest_b, rest_A = b.sum(0) - b, np.maximum(A.sum(0) - A, 1e-300)
                size = rest_b / rest_A
                fall = (2.0 * size * b - size**2 * A).sum(0)
                at = int(fall.argmax())
                whole = float(b.sum(0)[at] / max(A.sum(0)[at], 1e-300))
                one = events.placed(probe, whole, at / events.PARTS, member, locus)
                found = Candidate(one, float(fall[at]))
                if (member, locus) not in best or found.fall > best[member, locus].fall:
                    best[member, locus] = found
    return list(best.values())


def _has_part(member: str, locus: Locus) -> bool:
    """Whether one tooth of a member can meet all meshes of a locus and no others do."""
    if member == "planet":
        return locus.planet != "all"
    return locus.mesh == {"sun": "sp", "ring": "rp"}[member]


def _swaps(start: Base, effect: Effect) -> list[Candidate]:
    """Exchanged force channels."""
    meshes = start.cases[0].run.model.layout.meshes
    fall = np.zeros((len(meshes), len(meshes)))
    for c, law, left in zip(start.cases, start.laws, start.residuals, strict=True):
        force = np.nan_to_num(expected(c, start.factors, start.actives, law))
        shown = np.nan_to_num(c.run.F.values)
        for i, j in combinations(range(len(meshes)), 2):
            if c.usable[i] and c.usable[j]:
                after = (shown[:, [i, j]] - force[:, [j, i]]) / law.sigma_n[:, [i, j]]
                fall[i, j] += float(np.sum(left[:, [i, j]] ** 2) - np.sum(after**2))
    i, j = (int(v) for v in np.unravel_index(fall.argmax(), fall.shape))
    if i == j:
        return []
    channels = (f"F_{meshes[i]}", f"F_{meshes[j]}")
    try:
        one = active(effect, values={"channels": channels})
    except ParameterError:
        return []
    return [Candidate(one, float(fall[i, j]))]
