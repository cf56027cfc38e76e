"""Find the observations that the channels of a campaign allow, without a diagnosis."""

from __future__ import annotations

from herringbone_sim.gap.campaign_checks import check
from herringbone_sim.gap.data.folds import leave_out_folds
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.sensor_calibration import without_copies


def feasible_observations(
    campaign: PreparedCampaign,
) -> tuple[tuple[str, ...], tuple[Finding, ...]]:
    """Find the observations that a diagnosis of a campaign would use.

    Returns:
        Names of the observations, none without fit runs; problems of the data, and limits on the
        results of a diagnosis.
    """
    campaign, findings = check(campaign)
    if not campaign.of_role("fit"):
        return (), findings
    gear = GearObservations(leave_out_folds(without_copies(campaign).of_role("fit")))
    return gear.observation_names, findings
