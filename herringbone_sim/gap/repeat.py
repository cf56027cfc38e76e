"""Measure the gap of an earlier diagnosis on further runs of the rig; nothing is fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.checks import check
from herringbone_sim.gap.data.prepared import PreparedCampaign, PreparedRun
from herringbone_sim.gap.report import METRICS, plain_numbers
from herringbone_sim.gap.sensors.correction import correct_sensors, is_motion_sensor_effect
from herringbone_sim.gap.sensors.noise import with_estimated_noise
from herringbone_sim.gap.verdict.augmented import from_parameters
from herringbone_sim.gap.verification.senses import measure_senses
from herringbone_sim.gap.verification.serialise import (
    attractor_to_dict,
    gap_to_dict,
    senses_to_dict,
)
from herringbone_sim.gap.verification.verify import residual_gap
from herringbone_sim.recording.safe_json import JsonError, read_json

Say = Callable[[str], None]
SCHEMA = "herringbone_sim/gap-verify/1"
ROLE_FINDINGS = ("no_fit", "no_held_out", "one_run")  # irrelevant here: all runs are used
REPEATED = ("metric", "unit", "nominal", "augmented", "noise_floor", "closure")


def read_report(path: Path) -> dict[str, Any]:
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
    if not _is_report(data):
        raise AnalysisError(f"{path} is no report of a gap: give the folder that `gap` wrote")
    return data


def _is_report(data: Mapping[str, Any]) -> bool:
    """Whether the fields of a report that are used here have the right types."""
    gap, effects = data.get("gap"), data.get("effects")
    if not isinstance(gap, dict) or not isinstance(effects, list):
        return False
    senses = gap.get("senses") or {}
    return (
        gap.get("metric") in METRICS
        and isinstance(senses, dict)
        and all(isinstance(one, dict) for one in senses.values())
        and all(isinstance(one, str) for one in effects)
        and all(isinstance(data.get(name), str) for name in ("campaign", "verdict"))
    )


def repeat(
    campaign: PreparedCampaign,
    own: Parameters,
    actives: Sequence[Active],
    report: Mapping[str, Any],
    say: Say = lambda text: None,
) -> dict[str, Any]:
    """Measure the gap in three senses over all runs of a campaign, whatever their role.

    Sensor effects of the verdict on x, v, u and the clock are removed from the runs.

    Args:
        campaign: further runs of the rig.
        own, actives: parameters and effects of the augmented model, from its parameter file.
        report: of the diagnosis.
        say: called with a line of progress.

    Raises:
        AnalysisError: no run can be used.
    """
    campaign, findings = check(campaign)
    if not campaign.runs:
        raise AnalysisError(f"no run of {campaign.rig} can be used: {findings[0].text}")
    findings = tuple(f for f in findings if f.what not in ROLE_FINDINGS)
    if not campaign.noise_known:
        campaign = replace(
            campaign, runs=tuple(with_estimated_noise(run) for run in campaign.runs)
        )
    forces = all(np.isfinite(run.F.values).all(axis=0).any() for run in campaign.runs)
    model = from_parameters(campaign.nominal, own, actives, motion=not forces)
    sensor_effects = [one for one in actives if is_motion_sensor_effect(one)]

    def correct(run: PreparedRun) -> PreparedRun:
        return correct_sensors(run, sensor_effects) if sensor_effects else run

    say("residual")
    gap = residual_gap(campaign.runs, correct, report["gap"]["metric"], model)
    senses = measure_senses(campaign.runs, correct, gap, model, None, say)
    before = report["gap"].get("senses") or {"residual": report["gap"]}
    result: dict[str, Any] = plain_numbers(
        {
            "schema": SCHEMA,
            "campaign": campaign.rig,
            "diagnosed": report["campaign"],
            "verdict": report["verdict"],
            "effects": report["effects"],
            "gap": gap_to_dict(gap, None) | {"senses": senses_to_dict(senses, None)},
            "reported": {
                name: {key: sense.get(key) for key in REPEATED} for name, sense in before.items()
            },
            "attractor": attractor_to_dict(senses),
            "undecidable": [*(f.text for f in findings), *senses.unknown],
        }
    )
    return result
