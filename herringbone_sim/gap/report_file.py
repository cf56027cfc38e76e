"""Write ``report.json``, and read it back."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.report import Report
from herringbone_sim.gap.verification.residual_gap import GapNumbers
from herringbone_sim.recording.safe_json import JsonError, read_json

METRICS = ("force_law", "torque_balance", "consistency", "trajectory")


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
    """Write ``report.json``.

    Raises:
        OSError: the file can't be written.
    """
    path.write_text(json.dumps(report.to_dict(), indent=2) + "\n", encoding="utf-8")
