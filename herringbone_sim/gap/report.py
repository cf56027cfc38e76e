"""``report.json``: the verdict of a campaign as the contract of the gap has it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from herringbone_sim.core.layout import PREFIX_UNITS
from herringbone_sim.effects.channels import names_of
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.verdict.decide import Explanation, Verdict
from herringbone_sim.gap.verification.senses import Senses
from herringbone_sim.gap.verification.serialise import (
    attractor_to_dict,
    gap_to_dict,
    senses_errors,
    senses_to_dict,
)
from herringbone_sim.gap.verification.verify import Gap

SCHEMA = "herringbone_sim/gap-report/1"
OWN_UNIT = "unit of the channel"
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


def report(
    campaign: str,
    verdict: Verdict,
    where: Sequence[tuple[Locus, float]],
    gap: Gap,
    undecidable: Sequence[str],
    next_experiment: Mapping[str, Any],
    findings: Sequence[Finding] = (),
    senses: Senses | None = None,
    channels: Sequence[str] = (),
    structure: Mapping[str, Any] | None = None,
    noise: Mapping[str, Any] | None = None,
    observations: Sequence[str] = (),
) -> dict[str, Any]:
    """The report as plain data; NaN becomes null.

    Args:
        channels: that a full recording has, for the names of those at a locus.
        structure: of the residual, see ``place.structure``.
        noise: of each channel, see ``noise.written``.
        observations: residuals that could be formed.
    """
    causes = [
        _cause(name, chance, verdict.best.get(name), channels)
        for name, chance in sorted(verdict.probabilities.items(), key=lambda item: -item[1])
    ]
    made = {
        "schema": SCHEMA,
        "campaign": campaign,
        "verdict": verdict.verdict,
        "effects": list(verdict.effects),
        "where": [{"locus": _locus(locus), "share": share} for locus, share in where],
        "causes": causes,
        "ambiguous_with": list(verdict.ambiguous_with),
        "gap": gap_to_dict(gap)
        | {"runner_up_effects": _effects(verdict.runner_up)}
        | ({"senses": senses_to_dict(senses)} if senses else {}),
        "attractor": attractor_to_dict(senses),
        "undecidable": list(undecidable),
        "next_experiment": dict(next_experiment),
        "findings": [_finding(one) for one in findings],
        "structure": dict(structure or {}),
        "hypotheses": _hypotheses(verdict),
        "law": [law.written() for law in (verdict.chosen.laws if verdict.chosen else ())],
        "noise": dict(noise or {}),
        "recorded": sorted(noise or ()),
        "observations": list(observations),
    }
    clean: dict[str, Any] = plain_numbers(made)
    return clean


def write_report(path: Path, made: Mapping[str, Any]) -> None:
    """Write a report after a check of it; AnalysisError when it breaks the contract."""
    wrong = check_report(made)
    if wrong:
        raise AnalysisError(f"the report breaks its contract: {'; '.join(wrong)}")
    path.write_text(json.dumps(made, indent=2) + "\n", encoding="utf-8")


def check_report(made: Mapping[str, Any]) -> list[str]:
    """What a report has wrong by the contract; empty when it is right."""
    wrong = [f"{key} is missing" for key in KEYS if key not in made]
    if wrong:
        return wrong
    ids = {*known_effects(), "none", "unknown"}
    causes = made["causes"]
    chances = [cause["probability"] for cause in causes]
    rules = {
        f"schema must be {SCHEMA}": made["schema"] == SCHEMA,
        "verdict must be an effect, none, unknown or ambiguous": made["verdict"]
        in {*ids, "ambiguous"},
        "effects are at most two of the catalogue": len(made["effects"]) <= 2
        and set(made["effects"]) <= ids - {"none", "unknown"},
        "none has no effects": made["verdict"] != "none" or not made["effects"],
        "causes must hold every effect, none and unknown once": sorted(ids)
        == sorted(cause["effect"] for cause in causes),
        "probabilities must fall and sum to 1": chances == sorted(chances, reverse=True)
        and math.isclose(sum(chances), 1.0, abs_tol=1e-6),
        "ambiguous names two to four": len(made["ambiguous_with"])
        in ((2, 3, 4) if made["verdict"] == "ambiguous" else (0,)),
        "the verdict follows the probabilities": made["verdict"]
        in (causes[0]["effect"], "ambiguous"),
        f"metric must be one of {METRICS}": made["gap"]["metric"] in METRICS,
        "a gap has nominal, augmented, noise_floor, closure, runs": {
            "nominal",
            "augmented",
            "noise_floor",
            "closure",
            "runs",
        }
        <= set(made["gap"]),
    }
    return [rule for rule, holds in rules.items() if not holds] + senses_errors(made["gap"])


def _cause(
    name: str, chance: float, best: tuple[Explanation, int] | None, channels: Sequence[str]
) -> dict[str, Any]:
    if best is None:
        return {"effect": name, "locus": _locus(Locus()), "probability": chance, "parameters": {}}
    option, i = best
    one = option.actives[i]
    unknown = ((float("nan"),) * 2,) * len(one.theta)
    spans = option.intervals[i] if i < len(option.intervals) else unknown
    spans = spans or unknown
    concerned = names_of(channels, one) or one.chosen.get("channels", ())
    values: dict[str, Any] = {
        p.name: {"value": value, "unit": _unit(p.unit, concerned), "ci90": list(span)}
        for p, value, span in zip(one.effect.parameters, one.theta, spans, strict=True)
    }
    for key, choice in one.options:
        kept = list(choice) if isinstance(choice, tuple) else choice
        kept = list(concerned) if key == "channels" else kept
        values[key] = {"value": kept, "unit": "-", "ci90": None}
    if one.effect.level == "sensor" and "channels" not in values:
        values["channels"] = {"value": ["t"], "unit": "-", "ci90": None}  # the clock of all
    return {
        "effect": name,
        "locus": _locus(one.locus),
        "probability": chance,
        "parameters": values,
    }


def _hypotheses(verdict: Verdict) -> list[dict[str, Any]]:
    """Every explanation with effects, places and probability, best first."""
    return [
        {
            "effects": list(c.effects or ("none",)),
            "loci": [] if c.candidate is None else list(c.candidate.places),
            "probability": c.probability,
        }
        for c in verdict.chances
    ]


def _effects(option: Explanation | None) -> list[str]:
    return [] if option is None else [one.effect.id for one in option.actives]


def _finding(one: Finding) -> dict[str, Any]:
    return {
        "what": one.what,
        "run": one.run,
        "channels": list(one.channels),
        "time_s": one.time_s,
        "text": one.text,
    }


def _unit(unit: str, channels: Sequence[str]) -> str:
    """The unit of a parameter; that of a channel where it is in the channel's own."""
    quantities = {name.partition("_")[0] for name in channels}
    known = {PREFIX_UNITS.get(quantity, unit) for quantity in quantities}
    return known.pop() if unit == OWN_UNIT and len(known) == 1 else unit


def _locus(locus: Locus) -> dict[str, str]:
    return {"mesh": locus.mesh, "planet": locus.planet, "side": locus.side}


def plain_numbers(value: Any) -> Any:
    """The same with null for what is not finite."""
    if isinstance(value, dict):
        return {key: plain_numbers(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_numbers(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
