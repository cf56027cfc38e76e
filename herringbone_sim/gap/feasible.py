"""Find the observations that the channels of a campaign allow, without a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass

from herringbone_sim.gap.checks import check
from herringbone_sim.gap.data.folds import leave_out_folds
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.observations.copied_channels import drop_common_copies
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.machine import GearMachine
from herringbone_sim.gap.sensors.filter_delay import compensate_filter
from herringbone_sim.gap.sensors.noise import with_estimated_noise


@dataclass(frozen=True)
class FeasibleObservations:
    """Observations that a campaign allows.

    Attributes:
        observations: their names.
        findings: problems of the data, and limits on the results of a diagnosis.
    """

    observations: tuple[str, ...]
    findings: tuple[Finding, ...]


def feasible_observations(campaign: PreparedCampaign) -> FeasibleObservations:
    """Find the observations that a diagnosis of a campaign would use; none without fit runs."""
    campaign, findings = check(campaign)
    fit = campaign.of_role("fit")
    if not fit:
        return FeasibleObservations((), findings)
    if not campaign.noise_known:
        fit = tuple(with_estimated_noise(run) for run in fit)
    fit = drop_common_copies(compensate_filter(fit))
    gear = Gear(leave_out_folds(fit), gain_tolerance=campaign.gain_tolerance)
    return FeasibleObservations(GearMachine(gear).observation_names, findings)
