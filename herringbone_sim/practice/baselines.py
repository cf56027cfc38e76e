"""Simple baselines that report in the schema of the diagnosis.

``always_none`` and ``largest_residual`` use the recordings. The baselines of ``rivals``
(recalibration alone, in-sample BIC, sparse regression) use the evidence of the diagnosis, whose
fits include the tolerances.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from herringbone_sim.arrays import rms
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.diagnosis.evidence import Candidate, Evidence
from herringbone_sim.practice.record import law_force
from herringbone_sim.practice.rig_model import MESHES, NOMINAL
from herringbone_sim.recording.campaign import Campaign

SCHEMA = "herringbone_sim/gap-report/1"
NOTABLE = 1.3  # relative residual over the median of its kind from which one mesh is blamed
LOUD = 6.0  # relative residual over the noise share from which a mesh kind is blamed
HEALTHY = 1.1  # chi2 per value below which recalibration alone is accepted
SPARSE = 0.1  # smallest relative reduction of the loss for an effect to be selected
Report = dict[str, Any]


def always_none(campaign: Campaign) -> Report:
    """Return a report with the verdict ``none``."""
    return report_of(campaign.rig, ("none",))


def largest_residual(campaign: Campaign, series: Sequence[TimeSeries]) -> Report:
    """Baseline diagnosis: blame mean stiffness of the mesh whose force residual is largest.

    Compares RMS residual / RMS force of each mesh, median over the fit runs: one mesh is blamed
    from ``NOTABLE`` times the median of its kind (sun-planet or ring-planet), else all meshes of
    the larger kind from ``LOUD`` times the noise, else none; none also if x, v or F is missing.

    Args:
        series: recorded samples, one per run of the campaign; only runs with role ``fit`` count.

    Returns:
        A gap report (dict of schema ``SCHEMA``).
    """
    fit = [
        _relative_residuals(recording, run.point)
        for recording, run in zip(series, campaign.runs, strict=True)
        if run.role == "fit" and all(f"{a}_{m}" in recording for a in "xvF" for m in MESHES)
    ]
    if not fit:
        return always_none(campaign)
    blamed = ("mean_stiffness",)
    kinds = np.median(fit, axis=0).reshape(2, 6)
    ratio = kinds / np.median(kinds, axis=1, keepdims=True)
    worst = MESHES[int(ratio.argmax())]
    if ratio.max() >= NOTABLE:
        locus = {"mesh": worst[:2], "planet": worst[2], "side": worst[4]}
        return report_of(campaign.rig, blamed, locus)
    if kinds.max() >= LOUD * (campaign.noise_share or np.inf):
        loudest = MESHES[int(kinds.argmax())][:2]
        return report_of(campaign.rig, blamed, {"mesh": loudest, "planet": "all", "side": "all"})
    return always_none(campaign)


def _relative_residuals(series: TimeSeries, point: Mapping[str, float]) -> list[float]:
    """RMS force-law residual over RMS force (12 values) of each mesh, with nominal constants."""
    x, v, force = (series.columns(tuple(f"{a}_{m}" for m in MESHES)) for a in "xvF")
    residual = force - law_force(NOMINAL, point, series["phase"], x, v)
    return [rms(residual[:, j]) / rms(force[:, j]) for j in range(len(MESHES))]


def rivals(rig: str, evidence: Evidence | None) -> dict[str, Report]:
    """Return the reports of the baselines that use the evidence, by name.

    Without evidence (None) all of them report ``none``.
    """
    return {
        name: report_of(rig, ("none",) if evidence is None else rule(evidence))
        for name, rule in RULES.items()
    }


def recalibration_alone(evidence: Evidence) -> tuple[str, ...]:
    """Return ``none`` if the gear fits to the noise by its tolerances alone, else ``unknown``."""
    none = evidence.candidates[0]
    return ("none",) if none.in_sample / evidence.count < HEALTHY else ("unknown",)


def in_sample_bic(evidence: Evidence) -> tuple[str, ...]:
    """Return the effects with the smallest in-sample BIC, chi2 + p ln n, or ``none``."""

    def bic(c: Candidate) -> float:
        return float(c.in_sample + c.size * np.log(evidence.count))

    return min(evidence.candidates, key=bic).effects or ("none",)


def sparse_regression(evidence: Evidence) -> tuple[str, ...]:
    """Return the effect with the smallest loss in the linear screen of single effects.

    Returns ``none`` if that is not at least a tenth below the loss without effects. A loss is a
    prediction error of left-out runs, see ``Score.loss``.
    """
    none = evidence.candidates[0]
    if not evidence.screened:
        return ("none",)
    name = min(evidence.screened, key=lambda n: evidence.screened[n])
    is_clear = none.loss - evidence.screened[name] > SPARSE * none.loss
    return (name,) if is_clear else ("none",)


RULES: dict[str, Callable[[Evidence], tuple[str, ...]]] = {
    "recalibration alone": recalibration_alone,
    "in-sample BIC": in_sample_bic,
    "sparse regression": sparse_regression,
}


def report_of(rig: str, effects: Sequence[str], locus: Mapping[str, str] | None = None) -> Report:
    """Return a gap report with equal probabilities of effects; the first one is the verdict."""
    causes = [
        {"effect": name, "locus": locus or {}, "probability": 1.0 / len(effects), "parameters": {}}
        for name in effects
    ]
    return {
        "schema": SCHEMA,
        "campaign": rig,
        "verdict": effects[0],
        "effects": [] if effects[0] in ("none", "unknown") else list(effects),
        "causes": causes,
        "ambiguous_with": [],
        "gap": {"closure": None},
    }
