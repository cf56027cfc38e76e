"""The practice rig: its own integrator, effects as large as asked, recorded as rigs record."""

from __future__ import annotations

import json

import numpy as np
import pytest

from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import DivergenceError, ParameterError, RecordingError
from herringbone_sim.practice import record
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.cause import Cause, at, mesh_mask
from herringbone_sim.practice.channels import CHANNEL_SETS, channels_of, drawn_channels
from herringbone_sim.practice.label import label_text, read_label, seal
from herringbone_sim.practice.laws import window
from herringbone_sim.practice.observe import largest, observe_run, pooled, simulate_run
from herringbone_sim.practice.outside import UNSEEN
from herringbone_sim.practice.plan import KINDS, NAMED, TRUTHS, UNNAMED, RequestedNoise, draw_plan
from herringbone_sim.practice.random_physics import RANDOM_PHYSICS
from herringbone_sim.practice.record import (
    MOVED,
    Sampling,
    geometry,
    law_force,
    own_error_shift,
    simulate_motion,
)
from herringbone_sim.practice.rig_model import BODIES, MESHES, NOMINAL, rig_model
from herringbone_sim.practice.sensors import distort
from herringbone_sim.practice.shapes import displaced, flank
from herringbone_sim.practice.solve import solve_size
from herringbone_sim.practice.stepper import integrate
from herringbone_sim.practice.tables import table

WRONG = (
    {"truth": "gremlins"},
    {"channels": "most"},
    {"regime": "loud"},
    {"noise": RequestedNoise("pink")},
    {"law": "mine"},
)
EVENT = {"peak": 0.3, "plateau": 0.2, "rise": 1.5, "fall": 1.0, "dip": 0.3}
POINT = {"delta_T": 84.3, "K": 0.14, "T_1": 819.0, "Omega": 1.154}


def at_rest(p):
    """(30,) start with all relative displacements and rates zero at phase 0."""
    y = np.zeros(30)
    rate = p.error[0] * p.omega / p.cos_beta
    y[18:24], y[15:17] = rate, 2.0 * rate
    return y


def without_losses():
    return rig_model(NOMINAL, POINT)


def with_a_loose_pin():
    p = rig_model(NOMINAL, POINT)
    free, mass = p.free.copy(), p.mass.copy()
    free[12], mass[2] = 1.0, mass[2] - mass[12]
    return p._replace(free=free, mass=mass, support=np.array([2e-6, 2e9, 5e3, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("made", "lost"), [(without_losses, -3.8e-3), (with_a_loose_pin, -2.0e-3)]
)
def test_the_load_of_a_rig_that_loses_power_holds_its_speed(monkeypatch, made, lost):
    """The rigid rotation has no parabola as large as the motion; by the nominal load, ``lost``."""
    p = made()._replace(friction=np.full(12, 0.1))
    moved = MOVED * p.free * p.mass
    states = []

    def kept(*args):
        found = integrate(*args)
        states.append(found[0])
        return found

    monkeypatch.setattr(record, "integrate", kept)

    def motion_and_parabola():
        u = simulate_motion(p, 0.0, at_rest(p)).now.u
        along = states[-1][1:, :15] @ moved / (MOVED @ moved)
        times = np.linspace(-1.0, 1.0, len(along))
        return u, np.polynomial.legendre.legfit(times, along, 2)[2]

    u, parabola = motion_and_parabola()
    assert abs(parabola) < np.std(u[:, 0]) < 1e-4
    monkeypatch.setattr(record, "with_steady_load", lambda p, *_: p)
    assert motion_and_parabola()[1] == pytest.approx(lost, rel=0.05)


@pytest.mark.parametrize("Omega", [0.35, 1.154])
def test_agrees_with_the_simulator_without_effect(Omega):
    point = {**POINT, "Omega": Omega}
    p = rig_model(NOMINAL, point)
    model = build(Parameters(model="full", samples_per_cycle=24, **point))
    stepper = Stepper(model)
    rows = stepper.advance(stepper.start(), 24 * 20).rows
    _, force, _ = integrate(p, 0.0, at_rest(p), rows[:, 0], 1e-10)
    expected = rows[:, [model.layout.channels.index(f"F_{m}") for m in MESHES]]
    scale = np.sqrt(np.mean(expected**2))
    np.testing.assert_allclose(force, expected, atol=1e-6 * scale)


def test_error_falls_with_the_tolerance():
    p = rig_model(NOMINAL, POINT)
    times = np.linspace(0.0, 10 * 2 * np.pi / p.omega, 241)
    exact = integrate(p, 0.0, at_rest(p), times, 1e-12)[0]
    off = [
        np.abs(integrate(p, 0.0, at_rest(p), times, tolerance)[0] - exact).max()
        for tolerance in (1e-5, 1e-8)
    ]
    assert off[1] < 1e-2 * off[0]


def test_energy_balance():
    """Work of T_1, T_2 and K, less what the dampers take, is what is stored; k and e constant."""
    p = rig_model(NOMINAL, {**POINT, "K": 0.0})
    p = p._replace(k_cos=0.0 * p.k_cos, error=0.0 * p.error)
    y = np.zeros(30)
    y[15:17], y[18:24] = 4.0, -2.0
    times = np.linspace(0.0, 2e-3, 20001)
    states, _, _ = integrate(p, 0.0, y, times, 1e-11)
    u, rate = states[:, :9], states[:, 15:24]
    x, v = geometry(u) * p.cos_beta, geometry(rate) * p.cos_beta
    flanks = x - np.clip(x, -p.half_backlash, p.half_backlash)
    stored = 0.5 * rate**2 @ p.mass[:9] + 0.5 * flanks**2 @ p.stiffness
    brought = p.drive * (u[:, 0] + u[:, 1]) - p.brake * u[:, 2]
    lost = np.concatenate([[0.0], np.cumsum((v[1:] ** 2 + v[:-1] ** 2) @ p.damping)])
    lost *= 0.5 * (times[1] - times[0])
    balance = stored - stored[0] - brought + lost
    assert np.ptp(stored) > 1.0
    assert np.abs(balance).max() < 1e-4 * stored.max()


def test_kernel_shapes_have_the_slopes_they_claim():
    p = rig_model(NOMINAL, POINT)
    event, turn_cos = p.event.copy(), np.zeros((3, 12))
    event[4, 0], event[2, 0], turn_cos[:, 0] = 1e-5, 1.3, (2e-6, 0.0, 1e-6)
    p_sin = np.zeros((4, 12))
    p_sin[3, 0] = 1e-6
    p = p._replace(event=event, turn_cos=turn_cos, turn_sin=0.4 * turn_cos, offset=p.offset + 1e-6)
    p = p._replace(p_sin=p_sin, p_cos=0.5 * p_sin, window=table(window(EVENT)))
    for phase in (0.7, 3.0, 5.5):
        values = [displaced(p, 0, a, np.cos(a), np.sin(a)) for a in (phase - 1e-6, phase + 1e-6)]
        slope = (values[1][0] - values[0][0]) / 2e-6
        assert slope == pytest.approx(values[0][1], rel=1e-5)
    assert flank(5.0, 2.0, 1.0, 0.0) == 3.0
    assert flank(-5.0, 2.0, 1.0, 0.0) == -4.0
    assert flank(-5.0, 2.0, 2.0, 1e-3) == pytest.approx(-3.0, abs=1e-5)


def test_forces_of_a_rig_without_effect_obey_its_own_law():
    plan = draw_plan(3, "none")
    rig = NOMINAL.scaled(plan.factors)
    motion = simulate_motion(rig_model(rig, plan.points[4]), plan.phases[4], plan.starts[4]).now
    dx, dv = own_error_shift(rig, plan.points[4], motion.phase)
    law = law_force(rig, plan.points[4], motion.phase, motion.x - dx, motion.v - dv)
    np.testing.assert_allclose(motion.force, law, atol=1e-6)


def test_recorded_channels_are_consistent():
    """x is geometry of u less the nominal e, dx/dt is v, u has no rigid trend."""
    point = {**POINT, "K": 0.0}
    p = rig_model(NOMINAL.scaled({"e_sp": 1.02, "I_p": 0.99}), point)
    found = simulate_motion(p, 1.3, np.zeros(30), Sampling(lags=(1e-6,)))
    motion, (before,) = found.now, found.before
    e = NOMINAL.e_sp * np.sin(motion.phase)[:, None]
    np.testing.assert_allclose(motion.x, geometry(motion.u) * p.cos_beta - e, atol=1e-12)
    np.testing.assert_allclose(
        motion.x - before.x, 0.5e-6 * (motion.v + before.v), atol=2e-4 * np.abs(motion.x).max()
    )
    step = motion.times[1] - motion.times[0]
    middle = (motion.x[2:] - motion.x[:-2]) / (2.0 * step)
    share = np.sqrt(np.mean((middle - motion.v[1:-1]) ** 2) / np.mean(motion.v**2))
    assert share < 0.15
    rigid = np.array([2.0, 2.0, *[1.0] * 7]) * rig_model(NOMINAL, point).mass[:9]
    assert abs(np.polyfit(motion.times, motion.u @ rigid, 1)).max() < 1e-8
    assert motion.times[0] == 0.0
    assert motion.phase[0] == pytest.approx(1.3)


def taken(plan, rig, cause, i, sampling=None):
    moved = simulate_run(plan, rig, (cause,), i, sampling)
    return observe_run(plan, rig, (cause,), i, moved, largest([moved.now]))


@pytest.mark.parametrize("name", [*NAMED, *UNNAMED, *UNSEEN, *RANDOM_PHYSICS])
def test_every_effect_is_felt_and_none_at_size_zero(name):
    plan = draw_plan(5, name, 3.0)
    rig, cause = NOMINAL.scaled(plan.factors), plan.causes[0]
    felt = taken(plan, rig, cause, 3, Sampling(20, 78))
    assert felt.measure.d[0] > 0.01
    if KINDS[name].sense == "body":
        assert felt.measure.own_clean < 1e-6
    untouched = rig_model(rig, plan.points[4])
    sensor = KINDS[name].sense == "sensor"
    equipped = KINDS[name].apply(untouched, cause, plan.points[4])
    changed = [
        field
        for field, one in {**untouched._asdict(), **untouched.random._asdict()}.items()
        if field != "random"
        and not np.array_equal(one, {**equipped._asdict(), **equipped.random._asdict()}[field])
    ]
    assert bool(changed) is not sensor


@pytest.mark.parametrize("name", ["sensor_bias", "mean_stiffness"])
def test_detectability_is_as_asked(name):
    plan = draw_plan(8, name, 3.0)
    rig = NOMINAL.scaled(plan.factors)
    cause, d = solve_size(plan, rig, plan.causes[0])
    assert d == pytest.approx(3.0, rel=0.1)
    again = [taken(plan, rig, cause, i).measure for i in range(5)]
    assert pooled(again) == pytest.approx(3.0, rel=0.12)


def test_a_size_that_cannot_be_reached_is_told():
    plan = draw_plan(8, "tooth_crack", 300.0)
    rig = NOMINAL.scaled(plan.factors)
    cause, d = solve_size(plan, rig, plan.causes[0])
    assert cause.size == KINDS["tooth_crack"].cap
    assert d < 300.0


def test_a_seed_makes_the_same_campaign_again():
    one, other = (make_campaign(draw_plan(104)) for _ in range(2))
    assert seal(one.label) == seal(other.label)
    np.testing.assert_array_equal(one.series[3].data, other.series[3].data)
    assert one.label["truth"] == ["none"]


@pytest.mark.parametrize("channels", CHANNEL_SETS)
@pytest.mark.parametrize("fault", ["channel_swap", "sensor_bias"])
def test_faults_of_sensors_are_of_recorded_channels_and_have_a_unit(fault, channels):
    for seed in range(12):
        rng = np.random.default_rng(seed)
        among = drawn_channels(rng, channels)
        locus, shape = KINDS[fault].draw(rng, among)
        assert set(locus["channels"]) <= set(among)
        cause = Cause(fault, fault, locus, shape)
        for _, unit in KINDS[fault].parameters(cause).values():
            quantity = locus["channels"][0][0]
            assert unit == {"x": "m", "u": "m", "v": "m/s", "a": "m/s^2", "F": "N"}[quantity]


@pytest.mark.parametrize("channels", CHANNEL_SETS)
def test_a_clock_is_that_of_some_channels_of_one_quantity(channels):
    """A drift of all channels shows in nothing that is recorded."""
    drawn = set()
    for seed in range(30):
        rng = np.random.default_rng(seed)
        among = drawn_channels(rng, channels)
        locus, _ = KINDS["clock_drift"].draw(rng, among)
        names = set(locus["channels"])
        assert names < set(among)
        assert len({name[0] for name in names}) == 1
        drawn.add(tuple(locus["channels"]))
    assert len(drawn) > 1


def test_channels_of_a_clock_show_what_was_earlier_by_a_growing_time():
    """x (t - s t) = x - s t v to first order; other channels are as they were."""
    sampling = Sampling(20, 40, drifts=(-20e-6,))
    found = simulate_motion(rig_model(NOMINAL, POINT), 0.0, np.zeros(30), sampling)
    motion, names = found.now, ("x_sp1_L", "x_sp2_L")
    cause = Cause("clock_drift", "clock_drift", {"channels": names}, {"sign": -1.0}, 20.0)
    exact = channels_of(motion)
    seen = distort(cause, motion, found.before[0], exact)
    late = 20e-6 * (motion.times - motion.times[0])
    off = seen["x_sp1_L"] - exact["x_sp1_L"]
    np.testing.assert_allclose(off, -late * exact["v_sp1_L"], atol=0.05 * np.abs(off).max())
    assert np.abs(off[-24:]).max() > 2.0 * np.abs(off[:480]).max()
    assert all(np.array_equal(seen[n], exact[n]) for n in exact if n not in names)


def test_a_pair_is_labelled_and_sealed(tmp_path):
    plan = draw_plan(23, "pair", 3.0, channels="few")
    made = make_campaign(plan)
    assert made.campaign.noise_share == pytest.approx(1e-2)
    assert [run.role for run in made.campaign.runs] == ["fit"] * 5 + ["held_out"] * 3
    assert set(CHANNEL_SETS["few"]) <= set(made.series[0].names)
    file, sealed = tmp_path / "c.json", seal(made.label)
    file.write_text(label_text(made.label), encoding="utf-8")
    assert read_label(file, sealed) == made.label
    assert len(made.label["truth"]) == 2
    label = json.loads(file.read_text())
    file.write_text(json.dumps({**label, "truth": ["none"]}))
    with pytest.raises(RecordingError, match="changed after"):
        read_label(file, sealed)


def test_shares_of_truths_and_tolerance():
    plans = [draw_plan(seed) for seed in range(400)]
    kinds = ["none" if not p.causes else ("pair" if len(p.causes) > 1 else "one") for p in plans]
    unknown = sum(any(c.effect == "unknown" for c in p.causes) for p in plans)
    for count, wanted in (
        (kinds.count("none"), TRUTHS["none"]),
        (kinds.count("pair"), TRUTHS["pair"]),
        (unknown, TRUTHS["unknown"]),
    ):
        assert count / 400 == pytest.approx(wanted, abs=0.06)
    factors = np.array([list(p.factors.values()) for p in plans])
    assert 0.98 <= factors.min() < 0.981
    assert 1.019 < factors.max() <= 1.02
    assert len(UNNAMED) >= 6


def test_masks_and_refusals():
    assert mesh_mask(at("sp", 2, "R")).sum() == 1.0
    assert MESHES[int(mesh_mask(at("sp", 2, "R")).argmax())] == "sp2_R"
    assert mesh_mask(at(planet=3)).sum() == 4.0
    assert len(BODIES) == 9
    for wrong in WRONG:
        with pytest.raises(ParameterError, match="must be one of"):
            draw_plan(1, **wrong)
    p = rig_model(NOMINAL, POINT)
    with pytest.raises(DivergenceError, match="smaller effect"):
        integrate(p._replace(drive=1e12), 0.0, np.zeros(30), np.linspace(0.0, 1.0, 50))


def test_shocks_on_the_carrier_leave_its_mean_speed_as_it_is() -> None:
    """The load carries their mean: without it, u_c gains a parabola far above its motion."""
    plan = draw_plan(990123, "output_shock", 10.0)
    u = simulate_run(plan, NOMINAL, (plan.causes[0].sized(2e4),), 2).now.u[:, 2]
    parabola = np.polynomial.legendre.legfit(np.linspace(-1.0, 1.0, len(u)), u, 2)[2]
    assert abs(parabola) < np.std(u) < 1e-4


def test_a_fault_that_its_channels_hide_is_refused() -> None:
    """The mean of a raw angle is not known, so that a bias does not show."""
    with pytest.raises(ParameterError, match="can't be seen in raw_shafts"):
        draw_plan(1, "sensor_bias", channels="raw_shafts")
    assert draw_plan(1, "sensor_bias", channels="few").causes
