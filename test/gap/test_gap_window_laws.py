"""Channels, starts and proposals of windows of the motion, each on a rig of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_support import no_effect, of_shafts, practised, rig

from herringbone_sim.core.model import build
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.effects.effect import Active, Locus
from herringbone_sim.effects.registry import effects
from herringbone_sim.gap.observations.body_motion import rigid_swing
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.hypotheses.moving_parts import MovingPart
from herringbone_sim.gap.observations.searches import damaged_teeth_in_windows as window_events
from herringbone_sim.gap.observations.windows import columns as window_columns
from herringbone_sim.gap.observations.windows.channels import window_channels
from herringbone_sim.gap.observations.windows.trajectory import Trajectory
from herringbone_sim.gap.observations.windows.windows import MORE_WINDOWS
from herringbone_sim.gap.residuals.mesh_law import LawChange, MeshMotion, law
from herringbone_sim.gap.sensors.noise import DRIFT_SHARE
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.plan import draw_plan
from herringbone_sim.practice.trial import Setting, plan_of


@pytest.mark.parametrize("channels", ["accelerometers", "shafts_pins", "shafts_rings"])
def test_other_sensors_are_followed_to_their_noise(channels: str) -> None:
    """Each kind of channel keeps about its noise: leverage of the states takes a third of it."""
    made = as_prepared(make_campaign(draw_plan(600001, "none", channels=channels)))
    run = made.of_role("fit")[1]
    assert GearObservations([run]).uses_windows
    one = Trajectory(run)
    shot = one.nominal
    s = one.windows
    kinds = np.array([name[0] for name in s.channels.names])
    for kind in set(kinds):
        read = s.weight[:, :, kinds == kind] > 0.0
        assert 0.5 < np.mean(shot.residuals[:, :, kinds == kind][read] ** 2) < 2.0
    if channels == "shafts_rings":
        assert 0.05 < np.mean(s.weight[:, :, kinds == "F"] > 0.0) < 0.6


@pytest.mark.parametrize("hz", [150.0, 300.0])
def test_hum_within_the_data_sheet_is_no_motion(hz: float, monkeypatch) -> None:
    """Half of the noise in RMS, in the rotations of nine bodies.

    In 14 ms the states and gratings off centre take 50 Hz on. Without the slow waves chi2 rises by
    550 and 470. Hum of five times that size is no hum that the data sheet allows, and most of it
    stays.
    """
    made = as_prepared(make_campaign(draw_plan(600001, "none", channels="rotations")))
    run = made.of_role("fit")[2]
    sigma = window_channels(run).sigma
    phases = 2.0 * np.pi * hz * run.times[:, None] + np.arange(len(sigma))
    hum = DRIFT_SHARE * np.sqrt(2.0) * sigma * np.cos(phases)
    plain, hummed, loud = (
        Trajectory(
            replace(run, u=replace(run.u, values=run.u.values + size * hum)), windows=MORE_WINDOWS
        )
        for size in (0.0, 1.0, 5.0)
    )

    def chi2(windows: Trajectory) -> float:
        block = windows.block(windows.nominal, lambda _: LawChange(), (), ())
        return float(np.sum(block.residual**2))

    known = chi2(hummed) - chi2(plain)
    assert chi2(loud) - chi2(plain) > 1000.0
    monkeypatch.setattr(window_columns, "drift_spread", lambda count: 1e-9)
    unknown = chi2(hummed) - chi2(plain)
    assert unknown > 400.0
    assert known < 0.25 * unknown


def test_the_swing_that_a_recording_lacks_is_found() -> None:
    """A simulator of relative coordinates leaves it out, a rig's recording does not."""
    made = as_prepared(make_campaign(draw_plan(600001, "none", channels="few")))
    run = next(r for r in made.of_role("fit") if r.point["K"] > 0.1)
    without = replace(run, u=replace(run.u, values=run.u.values - rigid_swing(run)))
    whole, again = Trajectory(run).nominal, Trajectory(without).nominal
    assert whole.trends[-1] == pytest.approx(0.0, abs=0.05)
    assert again.trends[-1] == pytest.approx(1.0, abs=0.05)
    assert again.cost == pytest.approx(whole.cost, rel=0.1)
    constant = build(run.model.parameters.changed({"control_order": 0.0}))
    assert not rigid_swing(replace(run, model=constant)).any()


def test_the_swing_is_found_under_the_law_that_acts() -> None:
    """Damping by load, not in the nominal gear yet, leaves 60 squares a value and hides it."""
    share, depth = 0.347, 1.659e-5
    by_load = Active(effects()["damping_law"], (share, 1.0, depth), Locus())
    run = of_shafts(rig({}, actives=[by_load], share=3e-3).runs[2])
    windows = Trajectory(run)

    def changed(m: MeshMotion) -> LawChange:
        return LawChange(gamma=share * (np.abs(law(m).f) / depth - 1.0))

    for _ in range(3):
        found = windows.fitted_states(("gamma",), changed, {})
    values = np.count_nonzero(windows.recorded.weight)
    assert windows.nominal.cost > 30.0 * values
    assert abs(windows.nominal.trends[-1] - 1.0) > 0.5
    assert found.trends[-1] == pytest.approx(1.0, abs=0.02)
    assert found.cost < values


@pytest.mark.parametrize(
    ("seed", "effect", "member", "mesh", "side"),
    [(372011, "tooth_crack", "sun", "sp", "R"), (372014, "tooth_spall", "planet", "all", "L")],
)
def test_the_tooth_is_found_in_rotations_of_shafts(
    seed: int, effect: str, member: str, mesh: str, side: str
) -> None:
    found = window_events.proposals(practised(seed, effect).gear, {})
    first = next(event for event in found if event.effect == effect)
    # Which of three planets that work in step can't be told.
    assert (first.member, first.locus.mesh, first.locus.side) == (member, mesh, side)


def test_what_is_too_large_to_be_linear_is_tried_at_its_size() -> None:
    """A pin 22 um off: no effect at any size is nearer where the motion still is like the nominal.

    Linear about the nominal motion it takes off less than many that are not there.
    """
    pin = Active(effects()["pin_position"], (2.2e-5,), Locus(planet="2"))
    whole = rig({}, actives=[pin])
    gear = GearObservations([of_shafts(run) for run in whole.runs])
    machine = GearMachine(gear)
    null = no_effect(machine)
    kinds = ("stagger", "planet_phase", "mean_stiffness", "thermal_backlash", "pin_position")
    ranked = [
        (h, np.append(null.mean, [c.sd * (i == 0) for i, c in enumerate(h.coefficients)]))
        for h in machine.hypotheses()
        if h.effect in kinds and h.locus.side == "all"
    ]
    (_, best, start), *_ = machine.nonlinear_trials(ranked, null)
    assert best.effect == "pin_position"
    assert start[len(null.mean)] > 1e-5


def test_a_soft_ring_is_tried_at_a_third_of_its_proposed_stiffness() -> None:
    """A spring of 1e10 N/m, proposed at 3e10: it leaves least there, and less than soft meshes."""
    ring = Active(effects()["ring_flexibility"], (1e10, 0.05), Locus(mesh="rp"))
    whole = rig({}, actives=[ring])
    proposed = MovingPart("ring_flexibility", Locus(mesh="rp"), (3e10, 0.05, 0.01, 0.01))
    plain = GearMachine(GearObservations([of_shafts(run) for run in whole.runs]))
    machine, parts = plain.with_parts([proposed])
    stiffness = [h for h in machine.hypotheses() if h.effect == "mean_stiffness"]
    null = no_effect(machine)
    ranked = [(h, np.append(null.mean, [c.sd for c in h.coefficients])) for h in stiffness]
    ranked.append((parts[0], np.append(null.mean, np.zeros(len(parts[0].coefficients)))))
    (_, best, start), *_ = machine.nonlinear_trials(ranked, null)
    assert best is parts[0]
    assert start[len(null.mean) + 1] == pytest.approx(-np.log(3.0))


def test_a_run_in_a_wrong_minimum_is_begun_anew_once_the_gear_is_calibrated() -> None:
    """A healthy rig: every run must leave its noise, which is less than 1 a value by the states.

    One run left 5.4 with the nominal start, and the fit with one planet's phase moved left 1.
    """
    setting = Setting(channels=("accelerometers",), d=(3.0,), truth="none")
    machine = GearMachine(
        GearObservations(as_prepared(make_campaign(plan_of(setting, 381104))).of_role("fit"))
    )
    calibrated = Search(machine).null
    values = [np.count_nonzero(t.recorded.weight) for t in machine.gear.trajectories]
    assert np.all(calibrated.chi2 / values < 1.1)


def test_a_loose_pin_is_proposed_at_its_planet_from_gauges_in_the_pins() -> None:
    """The label says which planet; half of what is above the noise must go with it."""
    plan = draw_plan(381202, "bearing_clearance", d=3.0, channels="shafts_pins", law="catalogue")
    campaign = make_campaign(plan)
    machine = GearMachine(GearObservations(as_prepared(campaign).of_role("fit")[:3]))
    calibrated = Search(machine).null
    _, proposed = machine.proposals({}, calibrated)
    pins = [h for h in proposed if h.effect == "bearing_clearance"]
    best = max(pins, key=lambda h: h.measured_gain or 0.0)
    assert isinstance(best.locus, Locus)
    assert best.locus.planet == campaign.label["effects"][0]["locus"]["planet"]
    excess = float(calibrated.chi2.sum()) - calibrated.count
    assert best.measured_gain is not None
    assert best.measured_gain > 0.5 * excess > 0.0
