"""Pass a practice campaign to the diagnosis in memory, without writing bags."""

from __future__ import annotations

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.gap.data.prepare import gain_tolerances, noise_is_known, prepare_run
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.practice.campaign import PracticeCampaign
from herringbone_sim.recording.channels import Channels
from herringbone_sim.recording.reader import Recording


def as_prepared(made: PracticeCampaign) -> PreparedCampaign:
    """Convert a practice campaign to the input of the diagnosis, without its label.

    The result equals what ``gap.data.prepare.prepare`` reads from the same campaign on disk.
    """
    nominal = Parameters(model="full", samples_per_cycle=made.label["samples_per_cycle"])
    campaign = made.campaign
    runs = tuple(
        prepare_run(
            run,
            Recording(run.path, run.path.name, series, Channels(), (), True, ()),
            nominal,
            campaign.noise_share,
        )
        for run, series in zip(campaign.runs, made.series, strict=True)
    )
    return PreparedCampaign(
        campaign.rig,
        nominal,
        runs,
        (),
        noise_is_known(runs, campaign.noise_share, {}),
        gain_tolerances(nominal.layout, made.sensors),
    )
