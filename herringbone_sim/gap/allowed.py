"""Which observations of a diagnosis the channels of a campaign allow, before any is run."""

from __future__ import annotations

from dataclasses import dataclass

from herringbone_sim.gap.checks import check
from herringbone_sim.gap.data.folds import leave_out_folds
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.independent import independent
from herringbone_sim.gap.observations.machine import GearMachine
from herringbone_sim.gap.sensors.filter_delay import compensate_filter
from herringbone_sim.gap.sensors.noise import with_estimated_noise


@dataclass(frozen=True)
class Allowed:
    """What can be formed of a campaign.

    Attributes:
        formed: names of the observations.
        used: names of the runs of role fit that they are formed of.
        findings: what is odd, and what is left open.
    """

    formed: tuple[str, ...]
    used: tuple[str, ...]
    findings: tuple[Finding, ...]


def allowed(campaign: PreparedCampaign) -> Allowed:
    """Observations that a diagnosis would form, of runs made ready as it does."""
    campaign, findings = check(campaign)
    fit = campaign.of_role("fit")
    if not fit:
        return Allowed((), (), findings)
    if not campaign.noise_known:
        fit = tuple(with_estimated_noise(run) for run in fit)
    fit = tuple(independent(run) for run in compensate_filter(fit))
    names = tuple(run.name for run in fit)
    gear = Gear(leave_out_folds(fit), gain_tolerance=campaign.gain_tolerance)
    return Allowed(GearMachine(gear).formed, names, findings)
