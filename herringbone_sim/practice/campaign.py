"""Make a practice campaign: solve for the size that was asked for, run, record, label."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.practice.label import label_of
from herringbone_sim.practice.machine import NOMINAL
from herringbone_sim.practice.plan import FIT_RUNS, Plan
from herringbone_sim.practice.record import series_of
from herringbone_sim.practice.solve import Solved, solve_plan
from herringbone_sim.practice.take import largest, move, pooled, take
from herringbone_sim.recording.campaign import Campaign, CampaignRun


@dataclass(frozen=True)
class PracticeCampaign:
    """A campaign in memory.

    Attributes:
        campaign: as ``recording.campaign.read_campaign`` gives it; paths are bare names.
        series: recording of each run, in its order.
        label: the truth; only a scorer reads it.
        sensors: what the campaign tells of single channels.
    """

    campaign: Campaign
    series: tuple[TimeSeries, ...]
    label: dict[str, Any]
    sensors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def make_campaign(plan: Plan) -> PracticeCampaign:
    """Solve for the sizes and run a plan: three seconds without effect, up to ten with two.

    Raises:
        DivergenceError: a rig whose motion leaves the range of any gear even so.
    """
    return run_plan(plan, solve_plan(plan))


def solved_as(plan: Plan, label: Mapping[str, Any]) -> Solved:
    """What ``solve_plan`` gave when a label of this plan was made, without solving again."""
    return tuple(
        (cause.sized(float(told["size"])), float(told["d"]))
        for cause, told in zip(plan.causes, label["effects"], strict=True)
    )


def run_plan(plan: Plan, solved: Solved) -> PracticeCampaign:
    """Run a plan whose sizes are known; the same to the bit each time on one machine.

    Raises:
        DivergenceError: a rig whose motion leaves the range of any gear.
    """
    rig = NOMINAL.scaled(plan.factors)
    causes = tuple(cause for cause, _ in solved)
    moved = [move(plan, rig, causes, i) for i in range(len(plan.points))]
    most = largest([one.now for one in moved])
    takes = [take(plan, rig, causes, i, one, most) for i, one in enumerate(moved)]
    series = tuple(
        series_of(one.motion, one.measured, point, plan.names, plan.channels == "shafts_rings")
        for one, point in zip(takes, plan.points, strict=True)
    )
    runs = tuple(
        CampaignRun(Path(f"run_{i:02d}"), dict(point), "fit" if i < FIT_RUNS else "held_out")
        for i, point in enumerate(plan.points)
    )
    if len(solved) == 1:
        solved = ((causes[0], pooled([one.found for one in takes[:FIT_RUNS]])),)
    label = label_of(plan, solved, runs, rig, [t.motion for t in takes], [t.found for t in takes])
    told = plan.noise.share if plan.noise.told else None
    campaign = Campaign(f"practice_{plan.seed}", told, runs)
    there = {name: one for name, one in plan.noise.sensors.items() if name in plan.names}
    return PracticeCampaign(campaign, series, label, there)
