"""Write ``report.json`` after a check against its schema, and read it back."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.report import SCHEMA, Report
from herringbone_sim.gap.verification.serialise import senses_errors
from herringbone_sim.gap.verification.verify import GapNumbers
from herringbone_sim.recording.safe_json import JsonError, read_json

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
class StoredReport:
    """The part of a ``report.json`` that further runs are compared with.

    Attributes:
        campaign: name of the rig.
        verdict: ``none``, ``unknown``, ``ambiguous`` or the id of an effect.
        effects: ids of the effects found.
        metric: observation in which the gap is measured.
        numbers: the gap over the held-out runs by sense; only ``residual`` where the report has
            no other.
    """

    campaign: str
    verdict: str
    effects: tuple[str, ...]
    metric: str
    numbers: Mapping[str, GapNumbers]


def read_report(path: Path) -> StoredReport:
    """Read the report of an earlier diagnosis.

    Raises:
        AnalysisError: the file can't be read, or is no report.
    """
    try:
        data = read_json(path)
    except (OSError, JsonError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise AnalysisError(
            f"{path} can't be read ({reason}): give the folder that `gap CAMPAIGN --out` wrote"
        ) from None
    try:
        return _stored(data)
    except (LookupError, TypeError, ValueError, AttributeError):
        raise AnalysisError(
            f"{path} is no report of a gap: give the folder that `gap` wrote"
        ) from None


def _stored(data: Mapping[str, Any]) -> StoredReport:
    """Convert plain data to a report; if invalid, a LookupError, TypeError, ValueError, ..."""
    gap, named = data["gap"], (data["campaign"], data["verdict"], *data["effects"])
    if gap["metric"] not in METRICS or not all(isinstance(text, str) for text in named):
        raise ValueError
    senses = gap.get("senses") or {"residual": gap}
    numbers = {name: _numbers(sense) for name, sense in senses.items()}
    return StoredReport(named[0], named[1], named[2:], gap["metric"], numbers)


def _numbers(sense: Mapping[str, Any]) -> GapNumbers:
    """Convert the plain data of a gap; null becomes NaN."""
    keys = ("nominal", "augmented", "noise_floor", "closure")
    values = {key: math.nan if sense[key] is None else float(sense[key]) for key in keys}
    return GapNumbers(str(sense["metric"]), str(sense["unit"]), **values)


def write_report(path: Path, report: Report) -> None:
    """Write a report after a check against the schema.

    Raises:
        AnalysisError: the report violates its schema.
        OSError: the file can't be written.
    """
    data = report.to_dict()
    errors = check_report(data)
    if errors:
        raise AnalysisError(f"the report breaks its contract: {'; '.join(errors)}")
    path.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")


def check_report(data: Mapping[str, Any]) -> list[str]:
    """Texts of the rules of the schema that a report violates; empty if it is valid."""
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
