"""A filter of all channels: its delay, what it leaves of e(t), and the control, which has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from herringbone_sim.diagnosis.search import Search
from herringbone_sim.gap.observations.calibration.common_delay import (
    DELAY_TOLERANCE_S,
    MAX_TRIALS,
    _least,
    remove_common_delay,
)
from herringbone_sim.gap.observations.calibration.copied_channels import without_computed
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.sensors.filter_delay import longest_delay
from herringbone_sim.gap.sensors.noise import with_estimated_noise
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.plan import RequestedNoise, draw_plan


@pytest.mark.parametrize(
    ("truth", "noise", "channels"),
    [
        ("pin_position", "filtered", "x_and_F"),
        ("none", "filtered", "no_force"),
        ("stagger", "white", "x_and_F"),
        ("planet_phase", "white", "x_and_F"),
        ("none", "white", "x_and_F"),
        ("stagger", "white", "few"),
        ("planet_phase", "white", "few"),
    ],
)
def test_a_common_delay_is_taken_off_and_a_shift_of_some_meshes_is_not(
    truth: str, noise: str, channels: str
) -> None:
    """A filter delays all channels, beside a large effect too; a stagger only some."""
    plan = draw_plan(
        3, truth, d=10.0, channels=channels, noise=RequestedNoise(noise), law="catalogue"
    )
    runs = [r for r in as_prepared(make_campaign(plan)).runs if r.role == "fit"]
    found = remove_common_delay([without_computed(run) for run in runs], ())
    late = [
        (b.delay_rad - a.delay_rad) / a.omega_rad_per_s for a, b in zip(runs, found, strict=True)
    ]
    if noise == "white":
        assert late == [0.0] * len(runs)
    else:  # the same in all runs, no less than the filter's own delay
        assert late == pytest.approx([late[0]] * len(runs))
        assert plan.noise.parts["filter"]["delay_s"] < late[0] <= longest_delay(runs[0])


def test_the_control_is_not_behind_the_filter_of_the_channels() -> None:
    """A healthy rig by encoders behind a filter: x is worked out of u, so that only the law and
    the control tell the delay; in the fastest runs alone it is hardly seen."""
    plan = draw_plan(690011, "none", d=0.0, channels="full", noise=RequestedNoise("mixture"))
    of_filter = plan.noise.parts["filter"]
    campaign = as_prepared(make_campaign(plan))
    runs = [without_computed(with_estimated_noise(r)) for r in campaign.of_role("fit")]
    found = remove_common_delay(runs, (0.05,) * 12)
    late_s = found[0].delay_rad / found[0].omega_rad_per_s
    lag_s = 1.0 / (of_filter["corner"] * runs[0].model.scales.omega_n)
    assert late_s == pytest.approx(of_filter["delay_s"] + lag_s, rel=0.25)
    null = Search(GearMachine(GearObservations(found, gain_tolerance=(0.05,) * 12))).null
    by_name = dict(zip((c.name for c in null.coefficients), null.mean, strict=True))
    assert abs(by_name["delay of K"] + late_s - of_filter["delay_s"] - lag_s) < 5e-7
    assert null.in_sample < 1.2 * null.count


def test_few_sensors_show_the_delay_of_a_filter() -> None:
    """Shafts of a healthy rig behind a filter: 4 us and the lag of first order, 1 / corner; a rig
    without one has none."""
    plan = draw_plan(5, "none", d=0.0, channels="few", noise=RequestedNoise("filtered"))
    part = dict(plan.noise.parts["filter"], order=1, corner=11.0, delay_s=4e-6)
    late = replace(plan, noise=replace(plan.noise, parts={"filter": part}))
    without = draw_plan(5, "none", d=0.0, channels="few")
    for of_rig, behind in ((late, True), (without, False)):
        runs = [r for r in as_prepared(make_campaign(of_rig)).runs if r.role == "fit"]
        expected = 4e-6 + 1.0 / (11.0 * runs[0].model.scales.omega_n) if behind else 0.0
        for run in remove_common_delay(runs, ()):
            assert run.delay_rad / run.omega_rad_per_s == pytest.approx(expected, rel=0.2)


def test_what_a_common_filter_does_to_forces_and_to_e_is_no_finding() -> None:
    """Behind a filter the calibrated gear of a healthy rig leaves its noise, its column is what
    its corner says, and x holds as much of e(t) as a filter of that order passes."""
    plan = draw_plan(
        5, "none", d=0.0, channels="full", noise=RequestedNoise("filtered"), law="catalogue"
    )
    part = dict(plan.noise.parts["filter"], order=1, corner=10.5)
    plan = replace(plan, noise=replace(plan.noise, parts={"filter": part}))
    runs = [r for r in as_prepared(make_campaign(plan)).runs if r.role == "fit"]
    found = remove_common_delay(
        [without_computed(with_estimated_noise(run)) for run in runs[:3]], ()
    )
    for run in found:
        over = run.omega_rad_per_s / (10.5 * run.model.scales.omega_n)
        assert run.e_share == pytest.approx((1.0 + over**2) ** -0.5, abs=5e-4)
    null = Search(GearMachine(GearObservations(found))).null
    by_name = dict(zip((c.name for c in null.coefficients), null.mean, strict=True))
    assert by_name["filter 1"] == pytest.approx((10.0 / 10.5) ** 2, abs=0.15)
    without = Search(_without_filters(GearMachine(GearObservations(found)))).null
    o = "force_law"
    assert null.chi2_by_row[o].sum() < 0.7 * without.chi2_by_row[o].sum()
    assert null.in_sample < 1.2 * null.count


def _without_filters(machine: GearMachine) -> GearMachine:
    machine.base = tuple(c for c in machine.base if not c.name.startswith("filter"))
    return machine


@pytest.mark.parametrize("least", [0.0, 1.3e-6, 4.9e-6, 7e-6])
def test_a_few_parabolas_find_the_delay_of_least_chi2(least: float) -> None:
    """Of a chi2 with a cubic term; where it is least beyond 5e-6 s, that is returned."""
    tried = []

    def chi2(delay: float) -> float:
        tried.append(delay)
        off = (delay - least) / 1e-6
        return 1e4 + 300.0 * off**2 - 5.0 * off**3

    found, value = _least(chi2, chi2(0.0), 5e-6)
    assert found == pytest.approx(min(least, 5e-6), abs=DELAY_TOLERANCE_S)
    assert value == chi2(found)
    assert len(tried) <= MAX_TRIALS + 2


@pytest.mark.parametrize("beyond", [np.inf, np.nan, 0.0])
def test_the_best_delay_that_was_tried_is_kept_where_chi2_is_no_parabola(beyond: float) -> None:
    """It diverges from half of the longest delay on, or falls ever faster."""
    found, value = _least(lambda delay: beyond, 1.0, 5e-6)
    assert (found, value) == ((0.0, 1.0) if beyond else (5e-6, 0.0))
