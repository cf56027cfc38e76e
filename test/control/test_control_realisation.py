"""Torques and the accelerations of the meshes: planted ones recovered, motions compared."""

from __future__ import annotations

import numpy as np
import pytest
from equations import body_accelerations
from gears import make

from herringbone_sim.cli.control_text import demand_text
from herringbone_sim.control.amplitude import Target, run_survey
from herringbone_sim.control.realisation import (
    BODIES,
    TorqueDemand,
    mesh_map,
    single_actuators,
    smallest_demand,
    substitutes,
    torque_arms,
    torque_demands,
    torques_for,
)
from herringbone_sim.control.runs import MotionRunner, RunSettings
from herringbone_sim.control.starts import Starts
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.sweeps.grid import Axis

PAPER = (1.0, 1.0, 1.0, 1.0)
UNEVEN = {"I_s_factor": (1.1, 0.9), "I_p_factor": (0.95, 1.2)}
RIGID = (2.0, 2.0, 1.0, 1.0, 1.0)  # u'' of the bodies in a rigid rotation of the train


def pattern_of(model, torques_n_m):
    """Vector K (4,) of Eq. (22) that torque amplitudes (5,) [N m] on the bodies realise."""
    unit = model.scales.cos_beta / model.scales.acceleration_m_per_s2
    return -unit * mesh_map() @ (np.asarray(torques_n_m) / torque_arms(model))


def relative(model, bodies):
    """Dimensionless accelerations of the four meshes, Eqs. (15), (16)."""
    s_L, s_R, c, p_L, p_R = np.asarray(bodies) * model.scales.cos_beta
    meshes = [s_L - c - p_L, s_R - c - p_R, p_L - c, p_R - c]
    return np.array(meshes) / model.scales.acceleration_m_per_s2


def accelerations(model):
    """Of the bodies with contact nowhere: torques alone."""
    return body_accelerations(model, np.zeros(4))


@pytest.mark.parametrize(
    ("name", "sign", "body"), [("T_1", 0.5, (0, 1)), ("T_2", -1.0, (2,))], ids=["sun", "carrier"]
)
def test_a_torque_planted_in_the_equations_of_the_bodies_is_recovered(name, sign, body):
    """Eqs. (12), (14): half of T_1 on each half of the sun, T_2 against the carrier."""
    base = {"T_1": 220.0, "T_2": 800.0, **UNEVEN}
    before, after = make(**base), make(**base | {name: base[name] + 70.0})
    moved = relative(after, accelerations(after) - accelerations(before))
    torques = np.zeros(5)
    torques[list(body)] = sign * 70.0
    np.testing.assert_allclose(-pattern_of(before, torques), moved, atol=1e-12 * abs(moved).max())
    found = torques_for(before, -moved, [BODIES[i] for i in body])
    np.testing.assert_allclose(found, torques, rtol=1e-9)


def test_the_load_of_the_kernel_is_the_same_torque():
    """A constant control of the sun's pattern moves the gear as a smaller T_1 does."""
    gear = {"T_1": 220.0, "T_2": 847.0, "initial_x": (0.4, 0.3, 0.2, -0.1), "delta_T": 30.0}
    model = make(**gear)
    actuator = {one.name: one for one in single_actuators(model)}["sun"]
    K = 0.02
    other = make(**gear | {"T_1": 220.0 + 2.0 * K * actuator.torques_n_m[0]})
    steady = make(**gear, K=K, control_order=0.0, control_on=actuator.pattern)
    ends = [run_batch([one], None, 5, 1, 0).end for one in (other, steady, model)]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)
    assert np.abs(ends[1] - ends[2]).max() > 1e-3


def test_the_carrier_alone_realises_the_control_of_the_paper():
    model = make(**UNEVEN)
    torques = torques_for(model, PAPER, ["c"])
    assert torques[2] == pytest.approx(model.scales.control_torque_n_m(1.0), rel=1e-12)
    np.testing.assert_allclose(np.delete(torques, 2), 0.0)


@pytest.mark.parametrize("on", [("s_L", "s_R"), ("p_L", "p_R"), ("s_L", "s_R", "p_L")])
def test_what_cannot_be_realised_is_not(on):
    assert np.isnan(torques_for(make(), PAPER, on)).all()


def test_patterns_of_single_bodies():
    found = {one.name: one.pattern for one in single_actuators(make(**UNEVEN))}
    assert found == {
        "carrier": (1.0, 1.0, 1.0, 1.0),
        "sun": (1.0, 1.0, 0.0, 0.0),
        "sun left": (1.0, 0.0, 0.0, 0.0),
        "planets": (1.0, 1.0, -1.0, -1.0),
        "planets left": (1.0, 0.0, -1.0, 0.0),
    }


def test_every_actuator_gives_its_pattern():
    model = make(**UNEVEN)
    for one in (*single_actuators(model), *substitutes(model)):
        np.testing.assert_allclose(pattern_of(model, one.torques_n_m), one.pattern, atol=1e-12)


def test_realisations_differ_by_a_rigid_rotation():
    """Torques that turn the whole train faster move no mesh; sun and planets can spare the
    carrier, and of all ways the least-squares one is the least."""
    model = make()
    rigid = torque_arms(model) * RIGID
    np.testing.assert_allclose(pattern_of(model, 1e3 * rigid), 0.0, atol=1e-12)
    carrier = np.array(single_actuators(model)[0].torques_n_m)
    spared, least = (np.array(one.torques_n_m) for one in substitutes(model))
    for one in (spared, least):
        along = (one - carrier) / rigid
        np.testing.assert_allclose(along, along[0], rtol=1e-9)
    assert spared[2] == 0.0
    weight = np.array([1.0, 1.0, 1.0, 3.0, 3.0])
    best = weight @ least**2
    for shift in (-0.01, 0.01):
        assert weight @ (least + shift * carrier[2] * rigid / rigid[2]) ** 2 > best


def test_the_motion_under_planted_torques_is_that_of_the_control():
    """Bodies integrated by Eqs. (12)-(14) with a torque on them, against the kernel's control."""
    model = make(**UNEVEN, b=1e-9, gamma=0.0, e_m=0.0, T_1=0.0)
    for actuator in single_actuators(model):
        K = 0.2
        controlled = make(**_changed(model, K=K, control_on=actuator.pattern))
        expected = _bodies(model, K * np.array(actuator.torques_n_m), cycles=1, steps=2000)
        found = run_batch([controlled], np.zeros((1, 8)), 0, 1, 0).end[0]
        np.testing.assert_allclose(found, expected, atol=1e-7)


def _changed(model, **values):
    p = model.parameters
    names = ("I_s_factor", "I_p_factor", "b", "gamma", "e_m", "T_1")
    return {name: getattr(p, name) for name in names} | values


def _bodies(model, torques_n_m, cycles, steps):
    """State of the kernel after some cycles from rest: RK4 on rotations of the bodies."""
    s, omega = model.scales, model.scales.omega_n
    to_meshes = np.array(
        [[1, 0, -1, -1, 0], [0, 1, -1, 0, -1], [0, 0, -1, 1, 0], [0, 0, -1, 0, 1]]
    )
    k_m = np.array([model.parameters.k_m_sp] * 2 + [model.parameters.k_m_rp] * 2)

    def rates(t, z):
        u, v = z.reshape(2, 5)
        k = k_m * (1.0 + 0.25 * np.cos(omega * t))
        x, rate = to_meshes @ u * s.cos_beta, to_meshes @ v * s.cos_beta
        force = k * x + model.damping_n_s_per_m * rate
        pushed = np.cos(omega * t) * torques_n_m / torque_arms(model)
        return np.concatenate([v, body_accelerations(model, force) + pushed])

    z, h = np.zeros(10), 2.0 * np.pi * cycles / omega / steps
    for i in range(steps):
        a = rates(i * h, z)
        b = rates((i + 0.5) * h, z + 0.5 * h * a)
        c = rates((i + 0.5) * h, z + 0.5 * h * b)
        d = rates((i + 1) * h, z + h * c)
        z = z + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    (s_L, s_R, c, p_L, p_R) = z.reshape(2, 5).T / np.array([s.b_c, s.velocity_m_per_s])
    bodies = np.array([s_L - 2 * c, s_R - 2 * c, p_L - c, p_R - c]) * s.cos_beta
    return bodies.T.ravel()


def test_the_torque_needed_is_the_amplitude_times_the_torque_of_one():
    """Much damping: period 1 at every K, so the need is the least K tried."""
    gear = make(xi=0.5).parameters
    turn, K = Axis("control_phase", (0.0, 1.0)), np.array([0.1, 0.2, 0.3])
    planets = {one.name: one for one in single_actuators(make())}["planets"]
    starts, settings = Starts(alike=0, parted=0), RunSettings(60, 50)
    runner = MotionRunner()
    survey = run_survey(runner, planets.controlled(gear), turn, K, starts, settings)
    found = torque_demands(runner, survey, planets, [Target(1, "zero")])
    assert [one.K for one in found] == [0.1, 0.1]
    assert smallest_demand(found).torque_n_m == pytest.approx(0.1 * abs(planets.torques_n_m[3]))


def test_a_demand_without_a_rated_torque_is_told_without_it() -> None:
    """A torque T_1 of 0 is a valid gear."""
    demand = TorqueDemand(
        single_actuators(build(Parameters()))[0], Target(1, "all"), 0.0, 0.5, 2.0, 100.0
    )
    assert "times T_1" not in demand_text(demand, 0.0)
    assert "2 times T_1" in demand_text(demand, -50.0)
