"""Measure the gap of an earlier diagnosis on further runs of the rig; no gear is fitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.campaign_checks import check
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.report_file import StoredReport
from herringbone_sim.gap.sensor_calibration import calibrated_sensors
from herringbone_sim.gap.sensors.correction import correct_motion_sensors
from herringbone_sim.gap.verdict.augmented import from_parameters
from herringbone_sim.gap.verification.residual_gap import check_residual, residual_gap
from herringbone_sim.gap.verification.senses import Senses, measure_senses
from herringbone_sim.gap.verification.serialise import (
    attractor_to_dict,
    gap_to_dict,
    senses_to_dict,
)
from herringbone_sim.recording.safe_json import plain_numbers

Say = Callable[[str], None]
SCHEMA = "herringbone_sim/gap-verify/1"
ROLE_FINDINGS = ("no_fit", "no_held_out", "one_run")  # irrelevant here, as roles are ignored
# Fields of ``GapNumbers`` of the earlier report that ``verify.json`` repeats.
REPEATED = ("metric", "unit", "nominal", "augmented", "noise_floor", "closure")


@dataclass(frozen=True)
class Repetition:
    """The gap of an earlier diagnosis on further runs.

    Attributes:
        campaign: name of the rig of the further runs.
        earlier: report of the earlier diagnosis.
        senses: the gap of all further runs, whatever their role.
        undecidable: sentences on problems of the data and on what could not be measured.
    """

    campaign: str
    earlier: StoredReport
    senses: Senses
    undecidable: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The content of ``verify.json``; NaN becomes null."""
        gap = gap_to_dict(self.senses.residual, None)
        reported = {name: asdict(numbers) for name, numbers in self.earlier.numbers.items()}
        data: dict[str, Any] = plain_numbers(
            {
                "schema": SCHEMA,
                "campaign": self.campaign,
                "diagnosed": self.earlier.campaign,
                "verdict": self.earlier.verdict,
                "effects": list(self.earlier.effects),
                "gap": gap | {"senses": senses_to_dict(self.senses, None)},
                "reported": {
                    name: {key: sense[key] for key in REPEATED} for name, sense in reported.items()
                },
                "attractor": attractor_to_dict(self.senses),
                "undecidable": list(self.undecidable),
            }
        )
        return data


def repeat(
    campaign: PreparedCampaign,
    own: Parameters,
    actives: Sequence[Active],
    report: StoredReport,
    say: Say = lambda text: None,
) -> Repetition:
    """Measure the gap in three senses over all runs of a campaign, whatever their role.

    Sensor effects of the augmented model on x, v, u and the clock are removed from the runs.

    Args:
        campaign: further runs of the rig.
        own, actives: parameters and effects of the augmented model, from its parameter file.
        report: of the earlier diagnosis.
        say: called with a line of progress.

    Raises:
        AnalysisError: no run can be used, or the gap was that of trajectories.
    """
    check_residual(report.metric)
    campaign, findings = check(campaign)
    if not campaign.runs:
        raise AnalysisError(f"no run of {campaign.rig} can be used: {findings[0].text}")
    findings = tuple(f for f in findings if f.what not in ROLE_FINDINGS)
    campaign = calibrated_sensors(campaign)
    forces = all(np.isfinite(run.F.values).all(axis=0).any() for run in campaign.runs)
    model = from_parameters(campaign.nominal, own, actives, motion=not forces)
    correct = partial(correct_motion_sensors, actives=actives)
    say("residual")
    gap = residual_gap(campaign.runs, correct, report.metric, model)
    senses = measure_senses(campaign.runs, correct, gap, model, None, say)
    undecidable = (*(f.text for f in findings), *senses.unknown)
    return Repetition(campaign.rig, report, senses, undecidable)
