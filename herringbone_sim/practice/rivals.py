"""Baselines that see what the diagnosis sees: recalibration, in-sample BIC, sparse regression.

Each gives a report of the same schema. None of them leaves a run out or says ``unknown`` by
itself, as they are mostly used; all three know the tolerances of the nominal parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Active, Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.attribution.features import Feature, features
from herringbone_sim.gap.attribution.fit import Fit
from herringbone_sim.gap.attribution.hypothesis import Case, case, expected
from herringbone_sim.gap.attribution.shortlist import ROUGH, Base, base, calibration_columns
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.verdict.evidence import Evidence, mended
from herringbone_sim.practice.baselines import SCHEMA

Array = NDArray[np.float64]
Report = dict[str, Any]

HEALTHY = 1.1  # chi2 below which the recalibrated law is enough
SPARSE = 0.1  # of the residual's norm: smaller contributions are taken out
ROUNDS = 10


def rivals(campaign: PreparedCampaign, evidence: Evidence) -> dict[str, Report]:
    """Reports by the name of the baseline."""
    held = [
        case(m, fuse(m))
        for m in (mended(run, evidence.check) for run in campaign.of_role("held_out"))
    ]
    return {
        "recalibration alone": recalibration_alone(campaign.rig, evidence, held),
        "in-sample BIC": in_sample_bic(campaign.rig, evidence, held),
        "sparse regression": sparse_regression(campaign.rig, evidence, held),
    }


def recalibration_alone(rig: str, evidence: Evidence, held: Sequence[Case]) -> Report:
    """``none`` where the law with its tolerances fits the noise, else ``unknown``."""
    nominal = evidence.nominal
    if nominal is None:
        return _report(rig, {"none": 1.0}, (), None)
    verdict = "none" if nominal.chi2 < HEALTHY else "unknown"
    return _report(rig, {verdict: 1.0}, (), _closure(held, nominal.factors, ()))


def in_sample_bic(rig: str, evidence: Evidence, held: Sequence[Case]) -> Report:
    """The candidates of the diagnosis by chi2 + p ln n of the runs that they were fitted to."""
    if evidence.nominal is None:
        return _report(rig, {"none": 1.0}, (), None)
    options: list[Fit] = [evidence.nominal, *evidence.fits, *evidence.pairs]
    n = sum(float(c.usable.sum()) * len(c.run) for c in evidence.cases)
    costs = np.array(
        [n * f.chi2 + np.log(n) * sum(len(a.theta) for a in f.actives) for f in options]
    )
    odds = np.exp(-0.5 * (costs - costs.min()))
    odds /= odds.sum()
    chances: dict[str, float] = {}
    for option, p in zip(options, odds, strict=True):
        for one in option.actives:
            name = one.effect.id
            chances[name] = chances.get(name, 0.0) + float(p) / len(option.actives)
        if not option.actives:
            chances["none"] = float(p)
    best = options[int(odds.argmax())]
    spans = [
        [best.interval(i, k) for k in range(len(a.theta))] for i, a in enumerate(best.actives)
    ]
    closed = _closure(held, best.factors, best.actives)
    return _report(rig, chances, best.actives, closed, spans)


def sparse_regression(rig: str, evidence: Evidence, held: Sequence[Case]) -> Report:
    """Sequentially thresholded least squares over effects x meshes, in sample.

    S. L. Brunton, J. L. Proctor, J. N. Kutz, PNAS 113 (2016) 3932. What takes the most off the
    residual is named, on the meshes where it stays.
    """
    if evidence.nominal is None:
        return _report(rig, {"none": 1.0}, (), None)
    effects = [one for one in known_effects().values() if one.level != "body"]
    start = base(evidence.cases, np.ones(6))
    library = features(start.cases[0].run.model, effects)
    solved = [_sparse_mesh(*system) for system in _systems(start, library)]
    columns = np.array([f for f, one in enumerate(library) for _ in one.probes])
    power = np.array(
        [
            [
                sum(e for e, f in zip(energy[3:], columns, strict=True) if f == k)
                for k in range(len(library))
            ]
            for _, energy in solved
        ]
    )
    best = int(power.sum(0).argmax())
    closed = _linear_closure(held, library, [beta for beta, _ in solved])
    if not power.sum(0)[best] > 0.0:
        return _report(rig, {"none": 1.0}, (), closed)
    on = power[:, best] > 0.05 * power[:, best].max()
    mean = np.mean([solved[j][0][3:][columns == best] for j in np.flatnonzero(on)], axis=0)
    one = _placed(library[best], mean, on, evidence.cases[0])
    return _report(rig, {one.effect.id: 1.0}, (one,), closed)


def _systems(start: Base, library: Sequence[Feature]) -> list[tuple[Array, Array, float]]:
    """Normal matrix, right side and energy of each mesh over all runs, columns as in the text."""
    n = start.residuals[0].shape[1]
    found: list[tuple[Array, Array, float]] = []
    per_run = [_columns(start, i, library) for i in range(len(start.cases))]
    for j in range(n):
        A = sum(white[j] @ white[j].T for white in per_run)
        pairs = zip(per_run, start.residuals, strict=True)
        b = sum(white[j] @ left[:, j] for white, left in pairs)
        energy = float(sum(np.sum(left[:, j] ** 2) for left in start.residuals))
        found.append((np.asarray(A), np.asarray(b), energy))
    return found


def _columns(start: Base, i: int, library: Sequence[Feature]) -> Array:
    """Whitened columns (n_mesh, c, n) of a run: three of the tolerances, then the library."""
    c, law = start.cases[i], start.laws[i]
    before = expected(c, start.factors, (), law)
    columns = calibration_columns(c, law, start.factors)
    for feature in library:
        for probe, step in feature.probes:
            columns.append((expected(c, start.factors, (probe,), law, ROUGH) - before) / step)
    white = np.stack(columns, axis=2) / law.sigma_n[:, :, None]
    known: Array = np.where(c.usable[None, :, None], np.nan_to_num(white), 0.0)
    by_mesh: Array = known.transpose(1, 2, 0)
    return by_mesh


def _sparse_mesh(A: Array, b: Array, energy: float) -> tuple[Array, Array]:
    """Coefficients and the energy of each contribution; the tolerances are always kept."""
    norm = np.sqrt(np.maximum(np.diag(A), 1e-300))
    unit, right = A / np.outer(norm, norm), b / norm
    kept = np.diag(A) > 0.0
    beta = np.zeros(len(b))
    for _ in range(ROUNDS):
        at = np.flatnonzero(kept)
        beta[:] = 0.0
        beta[at] = np.linalg.solve(unit[np.ix_(at, at)] + 1e-6 * np.eye(len(at)), right[at])
        small = np.abs(beta) < SPARSE * np.sqrt(energy)
        small[:3] = False
        if not (kept & small).any():
            break
        kept &= ~small
    return beta / norm, beta**2


def _placed(feature: Feature, coefficients: Array, on: NDArray[np.bool_], c: Case) -> Active:
    """The effect at the locus of its kind whose meshes are most like those found."""
    theta = feature.theta(coefficients if feature.kind != "whole" else coefficients * 0.0 + 1.0)
    layout = c.run.model.layout
    loci: Sequence[Locus] = feature.start.effect.candidates(layout)
    apart = [float(np.abs(locus.mask(layout) - on).sum()) for locus in loci]
    return Active(
        feature.start.effect,
        tuple(map(float, theta)),
        loci[int(np.argmin(apart))],
        feature.start.options,
    )


def _closure(held: Sequence[Case], factors: Array, actives: Sequence[Active]) -> float | None:
    """Part of the force-law gap above the noise that is closed on held-out runs; None unknown."""
    sums = np.zeros(3)
    acting = [one for one in actives if one.effect.level != "body"]
    for c in held:
        law = force_law(c.run, c.fused, np.ones(6))
        after = c.run.F.values - expected(c, factors, acting)
        sums += [
            float(np.nansum(q[:, c.usable] ** 2)) for q in (law.residual_n, after, law.sigma_n)
        ]
    return _closed(sums)


def _linear_closure(
    held: Sequence[Case], library: Sequence[Feature], betas: Sequence[Array]
) -> float | None:
    """The same for all coefficients that were kept."""
    if not held:
        return None
    start = base(held, np.ones(6))
    sums = np.zeros(3)
    for i, (left, law) in enumerate(zip(start.residuals, start.laws, strict=True)):
        columns = _columns(start, i, library)
        explained = np.stack([c.T @ b for c, b in zip(columns, betas, strict=True)], axis=1)
        on = held[i].usable
        for k, q in enumerate((left, left - explained, np.ones_like(left))):
            sums[k] += float(np.sum((q * law.sigma_n)[:, on] ** 2))
    return _closed(sums)


def _closed(sums: Array) -> float | None:
    """Closure by sums of squares: nominal, augmented, floor."""
    nominal, augmented, floor = np.sqrt(sums)
    return float((nominal - augmented) / (nominal - floor)) if nominal > floor > 0.0 else None


def _report(
    rig: str,
    chances: Mapping[str, float],
    actives: Sequence[Active],
    closure: float | None,
    spans: Sequence[Sequence[tuple[float, float]]] = (),
) -> Report:
    named = {one.effect.id: (one, i) for i, one in enumerate(actives)}
    causes = [
        _cause(name, p, *named[name], spans) if name in named else _bare(name, p)
        for name, p in sorted(chances.items(), key=lambda pair: -pair[1])
    ]
    verdict = causes[0]["effect"]
    return {
        "schema": SCHEMA,
        "campaign": rig,
        "verdict": verdict,
        "effects": [] if verdict in ("none", "unknown") else list(named),
        "causes": causes,
        "ambiguous_with": [],
        "gap": {"closure": closure},
    }


def _bare(name: str, p: float) -> dict[str, Any]:
    return {"effect": name, "locus": {}, "probability": p, "parameters": {}}


def _cause(
    name: str, p: float, one: Active, i: int, spans: Sequence[Sequence[tuple[float, float]]]
) -> dict[str, Any]:
    parameters: dict[str, Any] = {}
    for k, (meant, value) in enumerate(zip(one.effect.parameters, one.theta, strict=True)):
        span = list(spans[i][k]) if spans else None
        parameters[meant.name] = {"value": value, "unit": meant.unit, "ci90": span}
    parameters |= {key: {"value": value} for key, value in one.options}
    locus = {"mesh": one.locus.mesh, "planet": one.locus.planet, "side": one.locus.side}
    return {"effect": name, "locus": locus, "probability": p, "parameters": parameters}
