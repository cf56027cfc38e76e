"""Calibrate the sensors of a campaign: unknown noise, copies, common delay, encoder errors."""

from __future__ import annotations

from dataclasses import replace

from herringbone_sim.gap.data.prepared import PreparedCampaign, deciding
from herringbone_sim.gap.observations.calibration.common_delay import remove_common_delay
from herringbone_sim.gap.observations.calibration.copied_channels import drop_common_copies
from herringbone_sim.gap.observations.calibration.encoder_error import without_encoder_errors
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.hypotheses.tolerances import GAUGE_GAIN_TOLERANCE
from herringbone_sim.gap.observations.windows.noise import with_noise_of_windows
from herringbone_sim.gap.sensors.noise import with_estimated_noise

STRIDE = 2  # samples from one value of the force law to the next in the search


def calibrated_sensors(campaign: PreparedCampaign) -> PreparedCampaign:
    """Campaign with unknown noise estimated; without copies, common delay and encoder errors."""
    campaign = without_copies(campaign)
    tolerances = assumed_gain_tolerances(campaign)
    runs = remove_common_delay(campaign.runs, tolerances)
    return replace(campaign, runs=without_encoder_errors(runs, tolerances, STRIDE))


def without_copies(campaign: PreparedCampaign) -> PreparedCampaign:
    """Campaign with unknown noise estimated, and copied channels as not recorded.

    What remains decides which observations can be formed; a common delay does not matter.
    """
    if not campaign.noise_known:
        campaign = replace(
            campaign, runs=tuple(with_estimated_noise(run) for run in campaign.runs)
        )
    return replace(campaign, runs=drop_common_copies(campaign.runs))


def with_learned_noise(campaign: PreparedCampaign) -> PreparedCampaign:
    """Campaign with unknown noise estimated from windows of the motion, if those are fitted.

    Returned unchanged where the noise is known, or force law or torque balance can be formed.
    """
    runs = campaign.runs
    all_known = campaign.noise_known and all(run.means_known for run in runs)
    if all_known or not GearObservations(deciding(runs), stride=STRIDE).uses_windows:
        return campaign
    return replace(campaign, runs=with_noise_of_windows(runs, campaign.noise_known))


def assumed_gain_tolerances(campaign: PreparedCampaign) -> tuple[float, ...]:
    """Gain tolerance (n_mesh,) of the force sensors, as the campaign gives it; may be empty.

    If the campaign gives neither tolerances nor noise, that of strain gauges.
    """
    tolerances = campaign.gain_tolerance
    if campaign.noise_known or any(tolerances):
        return tolerances
    return (GAUGE_GAIN_TOLERANCE,) * len(tolerances)
