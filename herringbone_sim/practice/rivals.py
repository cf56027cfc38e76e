"""Baselines with the diagnosis's own evidence: recalibration, in-sample BIC, sparse regression.

Each reports in the same schema. None leaves runs out or says ``unknown`` by itself, as they are
mostly used; all three know the tolerances.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from herringbone_sim.diagnosis.evidence import Candidate, Evidence
from herringbone_sim.practice.baselines import SCHEMA

Report = dict[str, Any]

HEALTHY = 1.1  # chi2 per value below which recalibration alone is accepted
SPARSE = 0.1  # smallest reduction of the squared residual for a term to be selected


def rivals(rig: str, evidence: Evidence | None) -> dict[str, Report]:
    """Reports by the name of the baseline."""
    if evidence is None:
        names = ("recalibration alone", "in-sample BIC", "sparse regression")
        return {name: _report(rig, ("none",)) for name in names}
    return {
        "recalibration alone": _report(rig, recalibration_alone(evidence)),
        "in-sample BIC": _report(rig, in_sample_bic(evidence)),
        "sparse regression": _report(rig, sparse_regression(evidence)),
    }


def recalibration_alone(evidence: Evidence) -> tuple[str, ...]:
    """``none`` if the gear with its tolerances fits to the noise, else ``unknown``."""
    none = evidence.candidates[0]
    return ("none",) if none.in_sample / evidence.count < HEALTHY else ("unknown",)


def in_sample_bic(evidence: Evidence) -> tuple[str, ...]:
    """Effects of the candidate with the smallest chi2 + p ln n on the runs it was fitted to."""

    def bic(c: Candidate) -> float:
        return float(c.in_sample + c.size * np.log(evidence.count))

    return min(evidence.candidates, key=bic).effects or ("none",)


def sparse_regression(evidence: Evidence) -> tuple[str, ...]:
    """The effect whose linear terms reduce the squared residual most, if by a tenth or more."""
    none = evidence.candidates[0]
    if not evidence.screened:
        return ("none",)
    name = min(evidence.screened, key=lambda n: evidence.screened[n])
    kept = none.energy - evidence.screened[name] > SPARSE * none.energy
    return (name,) if kept else ("none",)


def _report(rig: str, effects: Sequence[str]) -> Report:
    """Gap report with equal probabilities on the effects."""
    causes = [
        {"effect": name, "locus": {}, "probability": 1.0 / len(effects), "parameters": {}}
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
