"""Make a practice campaign: solve for the effect size, simulate, measure, label."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.practice.channels import series_of
from herringbone_sim.practice.label import label_of
from herringbone_sim.practice.observe import largest, observe_run, pooled, simulate_run
from herringbone_sim.practice.plan import FIT_RUNS, Plan
from herringbone_sim.practice.rig_model import NOMINAL
from herringbone_sim.practice.solve import Solved, solve_plan
from herringbone_sim.recording.campaign import Campaign, CampaignRun


@dataclass(frozen=True)
class PracticeCampaign:
    """A practice campaign in memory.

    Attributes:
        campaign: as ``recording.campaign.read_campaign`` returns it; paths are bare names.
        series: recording of each run, in the order of ``campaign.runs``.
        label: the truth; only the scoring reads it.
        sensors: sensor data that ``campaign.yaml`` gives, by channel.
    """

    campaign: Campaign
    series: tuple[TimeSeries, ...]
    label: dict[str, Any]
    sensors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def make_campaign(plan: Plan) -> PracticeCampaign:
    """Solve for the effect sizes of a plan, then simulate, measure and label it.

    Takes up to some ten seconds.

    Raises:
        DivergenceError: the motion diverges at every size tried, or at the size chosen.
    """
    return run_plan(plan, solve_plan(plan))


def solved_as(plan: Plan, label: Mapping[str, Any]) -> Solved:
    """Return the causes of a plan with size and detectability read from its label."""
    return tuple(
        (cause.sized(float(entry["size"])), float(entry["d"]))
        for cause, entry in zip(plan.causes, label["effects"], strict=True)
    )


def run_plan(plan: Plan, solved: Solved) -> PracticeCampaign:
    """Simulate, measure and label a plan with solved sizes; bitwise reproducible on one machine.

    The label of a single cause gives the detectability in these runs, that of a pair the
    detectabilities of ``solved``.

    Raises:
        DivergenceError: the motion of a run diverges.
    """
    rig = NOMINAL.scaled(plan.factors)
    causes = tuple(cause for cause, _ in solved)
    moved = [simulate_run(plan, rig, causes, i) for i in range(len(plan.points))]
    peaks = largest([run.now for run in moved])
    takes = [observe_run(plan, rig, causes, i, run, peaks) for i, run in enumerate(moved)]
    series = tuple(
        series_of(take.motion, take.measured, point, plan.names, plan.channels)
        for take, point in zip(takes, plan.points, strict=True)
    )
    runs = tuple(
        CampaignRun(Path(f"run_{i:02d}"), dict(point), "fit" if i < FIT_RUNS else "held_out")
        for i, point in enumerate(plan.points)
    )
    if len(solved) == 1:
        solved = ((causes[0], pooled([take.measure for take in takes[:FIT_RUNS]])),)
    label = label_of(
        plan, solved, runs, rig, [t.motion for t in takes], [t.measure for t in takes]
    )
    share = plan.noise.share if plan.noise.share_given else None
    campaign = Campaign(f"practice_{plan.seed}", share, runs)
    there = {name: sensor for name, sensor in plan.noise.sensors.items() if name in plan.names}
    return PracticeCampaign(campaign, series, label, there)
