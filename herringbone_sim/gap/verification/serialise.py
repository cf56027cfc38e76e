"""Gaps and senses as the plain data of a report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from herringbone_sim.gap.verification.attractor import UNITS as DISTANCE_UNITS
from herringbone_sim.gap.verification.senses import Senses
from herringbone_sim.gap.verification.verify import Gap

SENSES = ("residual", "prediction", "attractor")
ROLE = "held_out"
NUMBERS = ("nominal", "augmented", "noise_floor", "closure")


def gap_to_dict(gap: Gap, role: str | None = ROLE) -> dict[str, Any]:
    """Before, after, floor, control and closure over the runs of a role, and of every run."""
    return {
        "metric": gap.metric,
        "unit": gap.unit,
        "nominal": gap.over("nominal", role),
        "augmented": gap.over("augmented", role),
        "noise_floor": gap.over("floor", role),
        "recalibrated": gap.over("recalibrated", role),
        "closure": gap.closed("augmented", role),
        "closure_with_calibration": gap.closed_from("nominal", "augmented", role),
        "runner_up": gap.over("runner_up", role),
        "closure_runner_up": gap.closed("runner_up", role),
        "runs": [
            {
                "path": run.name,
                "role": run.role,
                "nominal": run.nominal,
                "augmented": run.augmented,
                "noise_floor": run.floor,
                "runner_up": run.runner_up,
                "recalibrated": run.recalibrated,
            }
            for run in gap.runs
        ],
    }


def senses_to_dict(found: Senses, role: str | None = ROLE) -> dict[str, Any]:
    """The gap in every sense, and over which horizon a prediction reaches."""
    told = {name: gap_to_dict(getattr(found, name), role) for name in SENSES}
    for run in told["prediction"]["runs"]:
        value, sigma = found.exponents.get(run["path"], (float("nan"),) * 2)
        run["horizon_cycles"] = found.horizon_cycles.get(run["path"], float("nan"))
        run["exponent"] = {"value": value, "sigma": sigma, "unit": "1/mesh cycle"}
    return told


def attractor_to_dict(found: Senses | None) -> dict[str, Any]:
    """Statistics of the motion by model and run, with their distances to the rig's."""
    if found is None:
        return {"nominal": {}, "augmented": {}}
    return {
        **{"nominal": {}, "augmented": {}},
        **{name: dict(runs) for name, runs in found.numbers.items()},
        "units": {**DISTANCE_UNITS, "exponent": "1/mesh cycle"},
    }


def senses_errors(made: Mapping[str, Any]) -> list[str]:
    """What the senses of a gap have wrong; empty when they are right, or absent."""
    told = made.get("senses")
    if told is None:
        return []
    wrong = [f"senses lacks {name}" for name in SENSES if name not in told]
    runs = [run["path"] for run in made["runs"]]
    for name, sense in told.items():
        lacking = {*NUMBERS, "metric", "unit", "runner_up", "runs"} - set(sense)
        if lacking:
            wrong.append(f"{name} lacks {', '.join(sorted(lacking))}")
        elif [run["path"] for run in sense["runs"]] != runs:
            wrong.append(f"{name} must tell of the same runs as the gap")
    if "residual" in told and any(told["residual"].get(k) != made[k] for k in NUMBERS):
        wrong.append("the residual among the senses must be the gap itself")
    return wrong
