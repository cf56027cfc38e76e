"""A free pin against the equations of the whole machine in absolute coordinates, SI units."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.assemble import assemble, by_laws
from herringbone_sim.effects.effect import Active, Locus, active
from herringbone_sim.effects.evaluate import evaluate, motion
from herringbone_sim.effects.law_stepper import LawStepper
from herringbone_sim.effects.registry import effect
from herringbone_sim.effects.written import read_effects

SEAT = {"clearance": 1e-5, "stiffness": 1e10, "damping": 0.1, "softness": 0.12}
PINS = {"all": [1, 4], "L": [1], "R": [4]}  # halves p1_L, p2_L, .., p3_R that are free


@pytest.fixture(scope="module")
def rig() -> Model:
    values: dict[str, Any] = {"T_1": 600.0, "K": 0.2, "initial_x": (1.0, 0.8, -0.7, 0.9)}
    return build(Parameters(model="full", delta_T=40.0, samples_per_cycle=400, **values))


def free(side: str, **values: float) -> Active:
    return active(effect("bearing_clearance"), Locus("all", "2", side), SEAT | values)


def seat(w: float) -> float:
    width = SEAT["softness"] * SEAT["clearance"]
    ends = np.array([w, -w]) - SEAT["clearance"]
    found = SEAT["stiffness"] * width * np.logaddexp(0.0, ends / width)
    return float(found[0] - found[1])


def whole_machine(rig: Model, side: str, times: Array, x: Array, v: Array) -> Array:
    """Deflections (n, 12) [m] from those at the start; bodies s_L, s_R, c, planets, pin."""
    p, s = rig.parameters, rig.scales
    omega, beta, halves = p.Omega * s.omega_n, s.cos_beta, PINS[side]
    mass = p.m_p * len(halves) / 2.0
    masses = np.array([s.M_s, s.M_s, s.M_c - mass, *[s.M_p] * 6, mass])
    k_m, b, c = np.repeat([1.5e9, 1.2e9], 6), rig.half_backlash_m, rig.damping_n_s_per_m
    along = np.zeros((12, 10))  # deflection of each mesh by body
    for h in range(6):
        pin = 9 if h in halves else 2
        along[h, [h // 3, 3 + h, pin]] = 1.0, -1.0, -1.0
        along[6 + h, [3 + h, pin]] = 1.0, -1.0
    loads = np.zeros(10)
    loads[:2], loads[2] = p.T_1 / 2.0 / s.r_bs, -2.0 * p.T_1 / s.r_bs
    control = p.K * p.b_c * s.omega_n**2 * s.M_c / beta
    damping = 2.0 * SEAT["damping"] * np.sqrt(SEAT["stiffness"] * mass)

    def slope(t: float, y: Array) -> Array:
        u, rate = y[:10], y[10:]
        e, e_rate = 0.35e-4 * np.sin(omega * t), 0.35e-4 * omega * np.cos(omega * t)
        deflection = beta * along @ u - e
        f = np.sign(deflection) * np.maximum(np.abs(deflection) - b, 0.0)
        F = k_m * (1.0 + 0.25 * np.cos(omega * t)) * f + c * (beta * along @ rate - e_rate)
        push = loads - beta * along.T @ F
        hold = seat(u[9] - u[2]) + damping * (rate[9] - rate[2])
        push[2] += control * np.cos(omega * t) + hold
        push[9] -= hold
        return np.concatenate([rate, push / masses])

    rigid = along[:, :9].copy()
    rigid[:, 2] += along[:, 9]
    start = [np.linalg.lstsq(beta * rigid, g, rcond=None)[0] for g in (x, v)]
    y = np.concatenate([start[0], [start[0][2]], start[1], [start[1][2]]])
    run = solve_ivp(slope, (0.0, times[-1]), y, "DOP853", times, rtol=1e-9, atol=1e-13)
    seen: Array = beta * run.y[:9].T @ rigid.T  # encoders see no pin
    return seen - 0.35e-4 * np.sin(omega * times)[:, None]


@pytest.mark.parametrize("side", PINS)
def test_the_motion_is_that_of_the_whole_machine(rig: Model, side: str) -> None:
    machine = LawStepper(by_laws(rig, [free(side)]))
    rows = machine.advance(machine.start(), 1200).rows
    wave = np.array([0.0, 0.35e-4 * rig.parameters.Omega * rig.scales.omega_n])
    x, v = rows[0, 5:17] + wave[0], rows[0, 17:29] + wave[1]
    exact = whole_machine(rig, side, rows[:, 0], x, v)
    without = LawStepper(by_laws(rig, []))
    plain = without.advance(without.start(), 1200).rows[:, 5:17]
    size = np.abs(exact).max()
    assert np.abs(rows[:, 5:17] - exact).max() < 1e-5 * size
    assert np.abs(plain - exact).max() > 1e-1 * size


def test_recorded_motion_and_forces_tell_where_the_pin_is(rig: Model) -> None:
    machine = LawStepper(by_laws(rig, [free("all")]))
    rows = machine.advance(machine.start(), 1200).rows
    seen = motion(rig, TimeSeries(rows[:, 0], rows, rig.layout.channels))
    wanted = rows[:, 29:41]

    def missed(*actives: Active) -> float:
        force = evaluate(rig, actives, seen).force
        return float(np.sqrt(np.mean((force - wanted) ** 2) / np.mean(wanted**2)))

    right = missed(free("all"))
    assert right < 0.004
    assert missed(free("all", clearance=1.05e-5)) > 2.0 * right
    assert missed(free("L")) > 50.0 * right
    assert missed() > 50.0 * right


def test_a_free_pin_bears_the_output_torque_without_input_torque() -> None:
    pins = read_effects("bearing_clearance")
    gears = [build(Parameters(T_1=T_1, T_2=100.0)) for T_1 in (0.0, 1e-9)]
    loads = [assemble(gear, pins).packed.load_cos for gear in gears]
    assert loads[0].any()
    np.testing.assert_allclose(*loads, rtol=1e-9)
    # By the law of the effect as well as by the slots that it fills.
    own = [LawStepper(by_laws(gear, pins)) for gear in gears]
    (at_rest, loaded) = (one.advance(one.start(), 24).end.y for one in own)
    np.testing.assert_allclose(at_rest, loaded, rtol=1e-6)
