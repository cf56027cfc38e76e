"""``report.json``: the result of a diagnosis as plain data, checked against its schema."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from herringbone_sim.core.layout import PREFIX_UNITS
from herringbone_sim.effects.channels import names_of
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.observations.reconstructed_forces import ReconstructedForces
from herringbone_sim.gap.verdict.decide import NamedExplanation, Verdict
from herringbone_sim.gap.verification.senses import Senses
from herringbone_sim.gap.verification.serialise import (
    attractor_to_dict,
    forces_to_dict,
    gap_to_dict,
    senses_errors,
    senses_to_dict,
)
from herringbone_sim.gap.verification.verify import Gap

SCHEMA = "herringbone_sim/gap-report/1"
OWN_UNIT = "unit of the channel"  # unit of parameters of sensor effects in the catalogue
METRICS = ("force_law", "torque_balance", "consistency", "trajectory")
KEYS = (
    "schema",
    "campaign",
    "verdict",
    "effects",
    "where",
    "causes",
    "ambiguous_with",
    "gap",
    "attractor",
    "undecidable",
    "next_experiment",
)


@dataclass(frozen=True)
class ReportContent:
    """Content of a report.

    Attributes:
        campaign: name of the rig.
        verdict: of the diagnosis.
        where: locus and share of the residual, largest first.
        gap: of all runs in the metric of the verdict.
        undecidable: sentences on what the data can't decide.
        next_experiment: operating point to run next, and why.
        findings: problems of the data.
        senses: the gap in three senses; None where not measured.
        channels: names of all channels of a full recording, for those at a locus.
        structure: distribution of the residual, see ``location.residual_structure``.
        noise: of each recorded channel, see ``observations.recorded_noise``.
        observations: names of the observations used.
        forces: of all meshes in a run, from few channels; None where not reconstructed.
    """

    campaign: str
    verdict: Verdict
    where: Sequence[tuple[Locus, float]]
    gap: Gap
    undecidable: Sequence[str]
    next_experiment: Mapping[str, Any]
    findings: Sequence[Finding] = ()
    senses: Senses | None = None
    channels: Sequence[str] = ()
    structure: Mapping[str, Any] = field(default_factory=dict)
    noise: Mapping[str, Any] = field(default_factory=dict)
    observations: Sequence[str] = ()
    forces: ReconstructedForces | None = None


def report(content: ReportContent) -> dict[str, Any]:
    """The report as plain data by its schema; NaN becomes null."""
    c, verdict = content, content.verdict
    causes = [
        _cause(name, chance, verdict.best.get(name), c.channels)
        for name, chance in sorted(verdict.probabilities.items(), key=lambda item: -item[1])
    ]
    data = {
        "schema": SCHEMA,
        "campaign": c.campaign,
        "verdict": verdict.verdict,
        "effects": list(verdict.effects),
        "where": [{"locus": _locus(locus), "share": share} for locus, share in c.where],
        "causes": causes,
        "ambiguous_with": list(verdict.ambiguous_with),
        "gap": gap_to_dict(c.gap)
        | {"runner_up_effects": _effects(verdict.runner_up)}
        | ({"senses": senses_to_dict(c.senses)} if c.senses else {}),
        "attractor": attractor_to_dict(c.senses),
        "undecidable": list(c.undecidable),
        "next_experiment": dict(c.next_experiment),
        "findings": [_finding(one) for one in c.findings],
        "structure": dict(c.structure),
        "hypotheses": _hypotheses(verdict),
        "law": [law.to_dict() for law in (verdict.chosen.laws if verdict.chosen else ())],
        "noise": dict(c.noise),
        "recorded": sorted(c.noise),
        "observations": list(c.observations),
        "reconstructed_forces": forces_to_dict(c.forces),
    }
    finite: dict[str, Any] = plain_numbers(data)
    return finite


def write_report(path: Path, data: Mapping[str, Any]) -> None:
    """Check a report and write it.

    Raises:
        AnalysisError: the report violates its schema.
        OSError: the file can't be written.
    """
    errors = check_report(data)
    if errors:
        raise AnalysisError(f"the report breaks its contract: {'; '.join(errors)}")
    path.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")


def check_report(data: Mapping[str, Any]) -> list[str]:
    """Rules of the schema that a report violates; empty if it is valid."""
    missing = [f"{key} is missing" for key in KEYS if key not in data]
    if missing:
        return missing
    ids = {*known_effects(), "none", "unknown"}
    causes = data["causes"]
    chances = [cause["probability"] for cause in causes]
    rules = {
        f"schema must be {SCHEMA}": data["schema"] == SCHEMA,
        "verdict must be an effect, none, unknown or ambiguous": data["verdict"]
        in {*ids, "ambiguous"},
        "effects are at most two of the catalogue": len(data["effects"]) <= 2
        and set(data["effects"]) <= ids - {"none", "unknown"},
        "none has no effects": data["verdict"] != "none" or not data["effects"],
        "causes must hold every effect, none and unknown once": sorted(ids)
        == sorted(cause["effect"] for cause in causes),
        "probabilities must fall and sum to 1": chances == sorted(chances, reverse=True)
        and math.isclose(sum(chances), 1.0, abs_tol=1e-6),
        "ambiguous names two to four": len(data["ambiguous_with"])
        in ((2, 3, 4) if data["verdict"] == "ambiguous" else (0,)),
        "the verdict follows the probabilities": data["verdict"]
        in (causes[0]["effect"], "ambiguous"),
        f"metric must be one of {METRICS}": data["gap"]["metric"] in METRICS,
        "a gap has nominal, augmented, noise_floor, closure, runs": {
            "nominal",
            "augmented",
            "noise_floor",
            "closure",
            "runs",
        }
        <= set(data["gap"]),
    }
    return [rule for rule, holds in rules.items() if not holds] + senses_errors(data["gap"])


def _cause(
    name: str, chance: float, best: tuple[NamedExplanation, int] | None, channels: Sequence[str]
) -> dict[str, Any]:
    """An effect with probability, locus and parameters.

    Args:
        name: id of the effect.
        chance: its probability.
        best: its most probable explanation and its index there; None without one.
        channels: names of all channels.
    """
    if best is None:
        return {"effect": name, "locus": _locus(Locus()), "probability": chance, "parameters": {}}
    explanation, i = best
    one = explanation.actives[i]
    unknown = ((float("nan"),) * 2,) * len(one.theta)
    spans = explanation.intervals[i] if i < len(explanation.intervals) else unknown
    spans = spans or unknown
    concerned = names_of(channels, one) or one.chosen.get("channels", ())
    values: dict[str, Any] = {
        p.name: {"value": value, "unit": _unit(p.unit, concerned), "ci90": list(span)}
        for p, value, span in zip(one.effect.parameters, one.theta, spans, strict=True)
    }
    for key, choice in one.options:
        value = list(choice) if isinstance(choice, tuple) else choice
        value = list(concerned) if key == "channels" else value
        values[key] = {"value": value, "unit": "-", "ci90": None}
    if one.effect.level == "sensor" and "channels" not in values:
        values["channels"] = {"value": ["t"], "unit": "-", "ci90": None}  # the clock of all
    return {
        "effect": name,
        "locus": _locus(one.locus),
        "probability": chance,
        "parameters": values,
    }


def _hypotheses(verdict: Verdict) -> list[dict[str, Any]]:
    """All explanations with effects, loci and probability, best first."""
    return [
        {
            "effects": list(c.effects or ("none",)),
            "loci": [] if c.candidate is None else list(c.candidate.places),
            "probability": c.probability,
        }
        for c in verdict.chances
    ]


def _effects(explanation: NamedExplanation | None) -> list[str]:
    """Ids of the effects of an explanation."""
    return [] if explanation is None else [one.effect.id for one in explanation.actives]


def _finding(one: Finding) -> dict[str, Any]:
    """A finding as plain data."""
    return {
        "what": one.what,
        "run": one.run,
        "channels": list(one.channels),
        "time_s": one.time_s,
        "text": one.text,
    }


def _unit(unit: str, channels: Sequence[str]) -> str:
    """Unit of a parameter in the report.

    Where the catalogue has ``OWN_UNIT`` in its place, the unit of the channels, if they share one.
    """
    quantities = {name.partition("_")[0] for name in channels}
    known = {PREFIX_UNITS.get(quantity, unit) for quantity in quantities}
    return known.pop() if unit == OWN_UNIT and len(known) == 1 else unit


def _locus(locus: Locus) -> dict[str, str]:
    """A locus as plain data."""
    return {"mesh": locus.mesh, "planet": locus.planet, "side": locus.side}


def plain_numbers(value: Any) -> Any:
    """Copy of nested plain data with None for numbers that are not finite."""
    if isinstance(value, dict):
        return {key: plain_numbers(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_numbers(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
