"""Errors of the sensors to which windows are fitted: gain, bias, delay, clock, exchange."""

from __future__ import annotations

import copy
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from gap_support import column_of, no_effect, of_shafts, practised, rig

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.diagnosis.examine import _exchange_of_channels, examine
from herringbone_sim.diagnosis.fits import FittedExplanation
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.effects.effect import active
from herringbone_sim.effects.registry import effect
from herringbone_sim.gap.data.prepared import Measured
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.hypotheses.coefficients import CoefficientBuilder
from herringbone_sim.gap.observations.hypotheses.sensors import window_sensor_errors
from herringbone_sim.gap.observations.windows.channels import window_channels
from herringbone_sim.gap.observations.windows.sensor_errors import with_sensor_errors
from herringbone_sim.gap.observations.windows.shooting import evaluated, stacked_residual
from herringbone_sim.gap.observations.windows.trajectory import Trajectory
from herringbone_sim.gap.residuals.mesh_law import LawChange
from herringbone_sim.gap.sensors.correction import correct_sensors, without_sensor_error
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.plan import draw_plan


@pytest.fixture(scope="module")
def gear() -> GearObservations:
    """A healthy practice rig: rotations of suns and carrier, forces of pins, 10 samples."""
    plan = draw_plan(600001, "none", channels="shafts_pins")
    made = make_campaign(replace(plan, samples_per_cycle=10))
    return GearObservations(as_prepared(made).of_role("fit"))


@pytest.mark.parametrize("channel", ["u_s_R", "F_pin2"])
@pytest.mark.parametrize(
    ("error", "step", "within"),
    [("gain", 1e-4, 1e-3), ("bias", 1e-6, 1e-6), ("delay", 1e-8, 5e-3), ("clock", 1e-7, 5e-3)],
)
def test_columns_of_sensors_are_what_their_errors_add(
    gear: GearObservations, channel: str, error: str, step: float, within: float
) -> None:
    """What is predicted without an error less what is with it: the column, ten samples a cycle."""
    trajectory = gear.trajectories[1]
    shot, s, name = trajectory.nominal, trajectory.recorded, f"{error} of {channel}"
    drive = trajectory.forcing(LawChange(), np.ones(9), ())
    wrong = with_sensor_errors(s, {name: step})
    right, off = (stacked_residual(evaluated(one, shot.starts, drive)) for one in (s, wrong))
    column = column_of(trajectory, gear, shot, name)
    assert np.linalg.norm((right - off) / step - column) < within * np.linalg.norm(column)


@pytest.mark.parametrize("names", [("u_s_L", "u_c"), ("F_pin1", "F_pin3")])
def test_the_column_of_an_exchange_is_what_it_takes_off(
    gear: GearObservations, names: tuple[str, str]
) -> None:
    """At kept states, with the noise of each channel left where it is."""
    trajectory = gear.trajectories[1]
    shot, s = trajectory.nominal, trajectory.windows
    i, j = (s.channels.names.index(name) for name in names)
    drive = trajectory.forcing(LawChange(), np.ones(9), ())
    measured = s.measured.copy()
    measured[:, :, [i, j]] = measured[:, :, [j, i]]
    right, off = (
        stacked_residual(evaluated(one, shot.starts, drive))
        for one in (s, replace(s, measured=measured))
    )
    column = column_of(trajectory, gear, shot, f"swap of {' and '.join(names)}")
    np.testing.assert_allclose(right - off, column, atol=1e-9 * np.abs(column).max())


@pytest.mark.parametrize("names", [("u_s_R", "u_c"), ("F_pin2", "F_pin3")])
def test_the_noise_of_a_channel_is_exchanged_with_it(
    gear: GearObservations, names: tuple[str, str]
) -> None:
    """Twice exchanged is as it was; a rotation of the carrier is known better than a sun's."""
    run = gear.trajectories[1].run
    back = without_sensor_error(run, "swap", names, 1.0)
    every = (run, back, without_sensor_error(back, "swap", names, 1.0))
    before, after, again = (
        dict(zip(c.names, c.sigma.tolist(), strict=True)) for c in map(window_channels, every)
    )
    one, other = names
    assert (after[one], after[other]) == (before[other], before[one])
    assert again == before


def test_exchanged_accelerometers_are_named() -> None:
    """Any two channels of one kind may be exchanged, not encoders alone."""
    plan = draw_plan(656000, "channel_swap", channels="accelerometers")
    made = make_campaign(plan)
    machine = GearMachine(GearObservations(as_prepared(made).of_role("fit")[:2]))
    null = no_effect(machine)
    ranked = [(h, null.mean) for h in machine.hypotheses() if h.effect == "channel_swap"]
    ((_, best, _), *_) = machine.nonlinear_trials(ranked, null)
    names = tuple(made.label["effects"][0]["locus"]["channels"])
    assert set(dict(best.options)["channels"]) == set(names)
    run = machine.gear.runs[0].run
    back = correct_sensors(run, [active(effect("channel_swap"), values={"channels": names})])
    right = without_sensor_error(run, "swap", names, 1.0)
    np.testing.assert_array_equal(back.a.values, right.a.values)


@pytest.mark.parametrize("error", ["delay", "clock"])
def test_a_channel_later_than_a_window_is_long_is_read_from_the_windows_before(
    gear: GearObservations, error: str
) -> None:
    """By ten samples: it shows what it showed on time ten samples before, within the jumps."""
    trajectory = gear.trajectories[1]
    shot, s, name = trajectory.nominal, trajectory.recorded, "u_s_R"
    drive = trajectory.forcing(LawChange(), np.ones(9), ())
    at, steps = s.channels.names.index(name), 10 * s.steps_per_sample
    late = steps * s.h
    on_time, _ = s.channel_outputs(shot.states, drive)
    if error == "clock":  # as late as that in the middle of the recording
        late /= s.run.times[s.n_windows * s.samples_per_window // 2]
    off, _ = with_sensor_errors(s, {f"{error} of {name}": late}).channel_outputs(
        shot.states, drive
    )
    shown, before = off[:, :, at].ravel(), on_time[:, :, at].ravel()
    inner = np.arange(30, len(shown) - 1)
    size = np.sqrt(np.mean(before**2))
    if error == "delay":
        np.testing.assert_allclose(shown[inner], before[inner - 10], atol=0.02 * size)
    else:
        at_half = s.n_windows * s.samples_per_window // 2
        assert shown[at_half] == pytest.approx(before[at_half - 10], abs=0.02 * size)
    others = np.arange(off.shape[2]) != at
    np.testing.assert_array_equal(off[:, :, others], on_time[:, :, others])


@pytest.mark.parametrize(
    ("effect", "seed", "parameter", "unit", "share"),
    [("sensor_delay", 600113, "delay", 1.0, 0.03), ("clock_drift", 600107, "ppm", -1e-6, 0.25)],
)
def test_a_late_gauge_is_predicted_as_late_as_it_is(
    effect: str, seed: int, parameter: str, unit: float, share: float
) -> None:
    """The true delay of a gauge in a pin takes its squares off, but for noise and tolerances.

    On the fastest run, at ten samples a mesh cycle.
    """
    plan = draw_plan(seed, effect, d=10.0, channels="shafts_pins", law="catalogue")
    made = make_campaign(replace(plan, samples_per_cycle=10))
    of = made.label["effects"][0]
    late = of["locus"]["channels"]
    kind = "delay" if parameter == "delay" else "clock"
    sizes = {f"{kind} of {name}": unit * of["parameters"][parameter]["value"] for name in late}
    trajectory = Trajectory(as_prepared(made).of_role("fit")[4])
    names = trajectory.recorded.channels.names
    gauges = [i for i, name in enumerate(names) if name in late]
    left = []
    for amplitudes in ({}, sizes):
        shot = trajectory.fitted_states((), lambda m: LawChange(), amplitudes)
        left.append(np.mean(shot.residuals[:, :, gauges] ** 2))
    on_time, with_delay = left
    assert with_delay < share * on_time


def test_a_clock_of_gauges_alone_is_named() -> None:
    """Those of the pins are drawn; the size is known within 5 %."""
    plan = draw_plan(600107, "clock_drift", d=10.0, channels="shafts_pins", law="catalogue")
    made = make_campaign(plan)
    found = examine(GearMachine(GearObservations(as_prepared(made).of_role("fit")[:2])))
    first, of = found.singles[0], made.label["effects"][0]
    assert first.hypotheses[0].effect == "clock_drift"
    assert first.hypotheses[0].options == (("channels", tuple(of["locus"]["channels"])),)
    size = of["parameters"]["ppm"]["value"]
    assert -1e6 * first.score.mean[-1] == pytest.approx(size, rel=0.05)
    assert first.loss < found.none.loss


def test_a_late_encoder_is_named() -> None:
    found = examine(practised(372023, "sensor_delay", runs=2))
    first = found.singles[0]
    assert first.hypotheses[0].effect == "sensor_delay"
    assert first.hypotheses[0].options == (("channels", ("u_s_L",)),)
    assert first.score.mean[-1] == pytest.approx(4.17e-6, rel=0.05)
    assert first.loss < 1.1 * found.count < found.none.loss


@pytest.fixture(scope="module")
def exchanged() -> GearMachine:
    """Encoders of a sun and of the carrier are exchanged; two runs."""
    return practised(372312, "channel_swap", runs=2)


def test_exchanged_encoders_are_put_back(exchanged: GearMachine) -> None:
    """What they show together no motion of the gear does, so that nothing linear says it."""
    null = no_effect(exchanged)
    ranked = [(h, null.mean) for h in exchanged.hypotheses() if h.effect == "channel_swap"]
    ((squares, best, _),) = exchanged.nonlinear_trials(ranked, null)
    assert best.options == (("channels", ("u_s_R", "u_c")),)
    assert squares < 0.01 * null.in_sample


def test_exchanged_encoders_are_put_back_on_a_gear_that_is_off_the_nominal() -> None:
    """Its stiffness, 4 % too large, leaves more than noise then; a wrong law leaves more still."""
    whole = rig({"k_m_sp": 1.04 * Parameters().k_m_sp}, share=1e-3)
    names = ("u_s_R", "u_c")
    runs = [without_sensor_error(of_shafts(run), "swap", names, 1.0) for run in whole.runs]
    machine = GearMachine(GearObservations(runs))
    null = no_effect(machine)
    ranked = [
        (h, np.append(null.mean, [c.sd for c in h.coefficients]))
        for h in machine.hypotheses()
        if h.effect in ("channel_swap", "stagger")
    ]
    (share, best, _), (other, *_), *_ = machine.nonlinear_trials(ranked, null)
    assert best.options == (("channels", names),)
    assert share < 0.1 * other


def test_a_start_at_which_runs_diverge_explains_nothing(gear: GearObservations) -> None:
    """With a gain below -1 the weight of a channel is negative, and its column not finite."""
    search = Search(GearMachine(GearObservations([run.run for run in gear.runs[:2]])))
    gain = next(
        h
        for h in search.machine.hypotheses()
        if h.effect == "sensor_gain" and h.options == (("channels", ("u_s_R",)),)
    )
    with np.errstate(all="ignore"):
        score = search.refined(gain.coefficients, np.append(search.null.mean, -1.5))
    assert np.isfinite(score.log_density)
    assert 0.99 * search.null.in_sample < score.in_sample < 1.01 * search.null.in_sample


def test_a_moderate_bias_of_a_pin_is_a_share_of_what_it_carries(gear: GearObservations) -> None:
    """As that of a gain is: pins carry ten thousands of N."""
    pins = [run.run.pin.values for run in gear.runs]
    rms = np.sqrt(np.mean([np.mean(values**2) for values in pins]))
    (unit,) = {
        h.coefficients[0].sd
        for h in GearMachine(gear).hypotheses()
        if h.effect == "sensor_bias" and h.options[0][1][0].startswith("F_pin")
    }
    assert unit == pytest.approx(0.05 * rms, rel=1e-3)


def test_an_error_of_a_sensor_is_of_its_own_planet(gear: GearObservations) -> None:
    """That of the tenth is not of the first, whose number is part of its own."""
    names = ("F_pin10", "F_rp11_R", "u_p12_L", "u_p2_R", "u_c")
    of_many = copy.copy(gear)
    of_many.__dict__["followed_channels"] = names
    of_many.__dict__["rms_by_quantity"] = {**gear.rms_by_quantity, "F": 1.0}
    every = list(window_sensor_errors(CoefficientBuilder(of_many)))
    planets = [h.locus.planet for h in every if h.effect == "sensor_gain"]
    assert planets == ["10", "11", "12", "2", "all"]


def test_an_error_of_a_gauge_in_a_tooth_is_no_force_on_the_gear(gear: GearObservations) -> None:
    """Where windows are fitted, and the displacement of its mesh is not recorded."""
    on = np.arange(12) == 0
    runs = []
    for run in (one.run for one in gear.runs[:2]):
        values = np.where(on, 0.5 * run.pin.values[:, :1], np.nan)
        runs.append(replace(run, F=Measured(values, on, np.where(on, run.pin.sigma[0], np.nan))))
    machine = GearMachine(GearObservations(runs))
    names = machine.gear.followed_channels
    assert "F_sp1_L" in names
    gains = [h for h in machine.hypotheses() if h.effect == "sensor_gain"]
    assert Counter(dict(h.options)["channels"] for h in gains) == {(name,): 1 for name in names}


def test_what_exchanged_encoders_leave_is_not_noise(exchanged: GearMachine) -> None:
    """With the noise unknown, its factors are those of the fit of the exchange."""
    search = Search(exchanged)
    found = _exchange_of_channels(search, FittedExplanation((), search.null))
    assert found is not None
    assert found.hypotheses[0].options == (("channels", ("u_s_R", "u_c")),)
    assert found.score.in_sample < 1.1 * found.score.count < 0.1 * search.null.loss
