"""The whole way: practice campaigns come back with their cause, its place and its size."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import pytest
from gap_support import check_report, shortened, with_few_runs

from herringbone_sim.gap.diagnose import diagnose
from herringbone_sim.gap.sensors.correction import without_channels
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.outcome import Outcome, outcome
from herringbone_sim.practice.plan import RequestedNoise, draw_plan

Json = dict[str, Any]
SURE = 0.5  # likelier than all else together


@cache
def diagnosed(
    truth: str, channels: str = "full", noise: str = "white", cycles: int = 120
) -> tuple[Json, Outcome]:
    """Report of the first mesh cycles of four runs, and how it compares to the truth.

    The effect has ten times the size that is detectable in five runs of 120 mesh cycles.
    """
    plan = draw_plan(
        1, truth, d=10.0, channels=channels, noise=RequestedNoise(noise), law="catalogue"
    )
    made = make_campaign(plan)
    campaign = with_few_runs(as_prepared(shortened(made, cycles)))
    report = diagnose(campaign, senses=False).report.to_dict()
    assert check_report(report) == []
    return report, outcome(made.label, report)


def test_nothing_is_named_where_nothing_is() -> None:
    report, _ = diagnosed("none", cycles=60)
    assert report["verdict"] == "none"
    assert report["causes"][0]["probability"] > 0.9
    gap = report["gap"]
    # What sensors may do is taken off, and takes some of the noise of so short runs with it.
    assert gap["recalibrated"] == pytest.approx(gap["noise_floor"], rel=0.03)


@pytest.mark.parametrize(
    ("truth", "cycles"), [("pin_position", 60), ("tooth_spall", 120), ("tooth_friction", 60)]
)
def test_an_effect_is_named_with_its_place_and_size(truth: str, cycles: int) -> None:
    report, found = diagnosed(truth, cycles=cycles)
    assert report["verdict"] == truth
    assert found.p_first > SURE
    assert found.locus
    assert found.error is not None
    assert found.error < 0.15  # a learned curve shares the size of friction with its departures
    assert report["gap"]["closure"] > 0.8
    assert report["gap"]["runner_up"] is not None


@pytest.mark.parametrize(
    ("truth", "channels", "noise", "cycles"),
    [
        ("none", "full", "encoders", 60),
        ("none", "full", "gains", 60),
        ("none", "full", "coloured_hard", 60),
        ("sensor_bias", "full", "white_untold", 60),
        ("none", "x_and_F", "filtered", 120),
        ("runout", "full", "encoders_two", 120),
        ("pin_position", "x_and_F", "filtered", 60),
        ("mean_stiffness", "half_forces", "coloured", 60),
        ("stagger", "no_force", "white", 60),
    ],
)
def test_campaigns_with_other_channels_and_noise_are_diagnosed(
    truth: str, channels: str, noise: str, cycles: int
) -> None:
    _, found = diagnosed(truth, channels, noise, cycles)
    assert found.right or found.in_class


def test_what_three_rotations_leave_open_is_said() -> None:
    report, _ = diagnosed("none", "few", cycles=60)
    assert report["verdict"] == "none"
    assert report["observations"] == ["trajectory"]
    assert any("can't be told" in one or "can be held" in one for one in report["undecidable"])


def test_forces_alone_say_nothing_and_end_nothing() -> None:
    campaign = with_few_runs(as_prepared(make_campaign(draw_plan(1, "none"))))
    layout = campaign.nominal.layout
    motion = (*(f"{q}_{m}" for q in "xv" for m in layout.meshes),)
    rotations = tuple(f"u_{body}" for body in layout.bodies)
    runs = tuple(without_channels(run, (*motion, *rotations)) for run in campaign.runs)
    report = diagnose(replace(campaign, runs=runs), senses=False).report.to_dict()
    assert report["observations"] == []
    assert any("nothing can be said of the machine" in one for one in report["undecidable"])
    assert not any("the catalogue explains the gap" in one for one in report["undecidable"])
    assert "no diagnosis" in report["next_experiment"]["why"]
