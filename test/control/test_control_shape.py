"""Phase and frequency of the control: what it is worth as an error, and in a linear gear."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from equations import reduced_accelerations
from gears import make

from herringbone_sim.control.runs import MotionRunner, RunSettings
from herringbone_sim.control.shape import (
    around_cancelling,
    best,
    cancelling,
    cancels,
    equivalent_error,
    in_periods,
    phases,
    quiet,
    shape_map,
)
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import build, relative, state
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.written import read_effects
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.sweeps.grid import Axis

PAPER = Path(__file__).resolve().parents[2] / "config" / "paper.yaml"
LINEAR = {"b": 0.0, "gamma": 0.0, "k_amp": (), "e_m": 0.0, "T_1": 0.0, "xi": 0.1}


def motion(model, x, v, cycles):
    """Relative displacements and rates after some cycles from given ones."""
    start = state(model, np.array(x), np.array(v), 0.0)
    end = run_batch([model], start[None], cycles - 1, 1, 0).end[0]
    return np.concatenate(relative(model, end, 0.0))


@pytest.mark.parametrize("phase", [0.0, 0.7, np.pi / 2, -2.0])
def test_the_control_is_a_mesh_error_of_another_amplitude_and_phase(phase):
    """From the same displacements the gear with that error moves as the controlled one."""
    gear = {"Omega": 0.9, "T_1": 220.0, "delta_T": 40.0}
    controlled = make(**gear, K=0.3, control_phase=phase)
    e_m, phi_b = equivalent_error(controlled.parameters)
    other = make(**gear, e_m=e_m, phi_b=(phi_b,))
    x, v = (0.3, 0.3, 0.1, 0.1), (0.0, 0.0, 0.2, 0.2)
    np.testing.assert_allclose(
        motion(controlled, x, v, 3), motion(other, x, v, 3), atol=1e-8, rtol=1e-8
    )


def test_one_control_takes_the_error_away():
    gear = make(Omega=0.9).parameters
    K, phase = cancelling(gear)
    controlled = make(Omega=0.9, K=K, control_phase=phase)
    assert equivalent_error(controlled.parameters)[0] == pytest.approx(0.0, abs=1e-15)
    x, v = (0.3, 0.3, 0.1, 0.1), (0.0, 0.0, 0.2, 0.2)
    without = make(Omega=0.9, e_m=0.0)
    np.testing.assert_allclose(
        motion(controlled, x, v, 3), motion(without, x, v, 3), atol=1e-8, rtol=1e-8
    )


def test_where_the_error_is_cancelled_teeth_stay_in_contact():
    """Near it they do not: what is left of the error outweighs the load."""
    gear = make(k_amp=(), xi=0.2, gamma=0.0).parameters
    near = around_cancelling(MotionRunner(), gear, 3, RunSettings(300, 60))
    still = quiet(near)
    assert still[1, 1, :3].all()
    assert not still[0, 0].any()
    assert near.of("period")[1, 1, 0] == 1.0


@pytest.mark.parametrize("order", [0.5, 1.0, 1.5, 2.0])
@pytest.mark.parametrize("on", [(1.0, 1.0, 1.0, 1.0), (1.0, 0.0, -1.0, 0.0)])
def test_a_linear_gear_answers_as_its_transfer_function_says(order, on):
    """x = -K Re H exp(i (order phase + control_phase)) by the equations of the paper, Eq. (18)."""
    gear = {**LINEAR, "control_order": order, "control_phase": 0.4, "control_on": on}
    model, K = make(**gear, K=0.3), 0.3
    unit = np.eye(4)
    rest = make(**LINEAR)
    stiffness = -np.array([reduced_accelerations(rest, x, np.zeros(4), 0.0) for x in unit]).T
    damping = -np.array([reduced_accelerations(rest, np.zeros(4), v, 0.0) for v in unit]).T
    transfer = np.linalg.inv(stiffness - order**2 * unit + 1j * order * damping)
    answer = -K * np.exp(0.4j) * (transfer @ np.array(on))
    found = motion(model, np.zeros(4), np.zeros(4), 400)
    expected = np.concatenate([answer.real, (1j * order * answer).real])
    np.testing.assert_allclose(found, expected, atol=1e-7)
    assert np.abs(answer).max() > 0.05


def test_a_linear_gear_has_the_period_of_mesh_and_control_together():
    """Half the frequency of the mesh: two cycles, counted as one period of both."""
    gear = make(**LINEAR | {"e_m": 0.3}).parameters
    orders = Axis("control_order", (0.5, 0.6180339887498949, 1.0))
    found = shape_map(
        MotionRunner(), gear, orders, np.array([0.0, 0.3]), RunSettings(300, 200, True, 32)
    )
    assert found.period.tolist() == [[1.0, 1.0], [1.0, 0.0], [1.0, 1.0]]
    assert not found.chaotic.any()
    assert (found.exponent < 0.0).all()


def test_periods_in_units_of_the_forcing():
    cycles = np.array([[1.0, 4.0, 3.0, 0.0, np.nan]])
    K = np.array([0.0, 0.1, 0.2, 0.3, 0.4])
    found = in_periods(cycles, np.array([[2]]), K)
    np.testing.assert_array_equal(found, [[1.0, 2.0, 0.0, 0.0, np.nan]])
    np.testing.assert_array_equal(in_periods(cycles, np.array([[0]]), K)[0, :4], [1, 0, 0, 0])


def test_phases_and_the_best_of_them():
    turn = phases(8)
    assert turn[0] == -np.pi
    assert 0.0 in turn
    assert best(np.array(turn[:3]), np.array([0.4, np.nan, 0.2])) == (turn[2], 0.2)
    assert np.isnan(best(np.array(turn[:2]), np.array([np.nan, np.nan]))).all()


@pytest.mark.parametrize(
    "error", [{}, {"e_amp": (0.5,)}, {"phi_b": (0.7,)}, {"mesh_phase": (0.4,)}]
)
def test_the_control_cancels_a_mesh_error_of_any_amplitude_and_phase(error):
    """With constant stiffness nothing is left to move the gear in its meshes."""
    free = Parameters(k_amp=(0.0,), **error)
    K, phase = cancelling(free)

    def moved(K):
        model = build(free.changed({"K": K, "control_phase": phase}))
        _, settled = simulate(model, 300)
        series, _ = simulate(model, 4, settled)
        return np.ptp(series.columns(model.layout.channels_of("x")), axis=0).max()

    assert moved(K) < 1e-9 * moved(0.0)


@pytest.mark.parametrize(
    ("changes", "can"),
    [
        ({}, True),
        ({"control_order": 0.5}, False),
        ({"e_amp": (1.0, 0.6)}, False),
        ({"control_on": (1.0, 1.0, 0.0, 0.0)}, False),
        ({"Omega": 6.0}, False),  # K were 12.6
        ({"e_m": 0.0}, False),
        ({"e_factor": (1.2, 0.8, 1.2, 0.8)}, False),
        ({"phi_b": (0.0, 3.0, 0.0, 0.0)}, False),
        ({"mesh_phase": (0.0, 1.0, 0.0, 1.0)}, False),
        ({"phi_b": (-3.0,)}, True),
        ({"phi_b": (6.0,)}, True),
        ({"e_amp": (-1.0,)}, True),
    ],
)
def test_the_error_is_cancelled_by_a_control_of_its_order_on_all_equations(changes, can):
    """Measured over the last 20 of 320 mesh cycles: next to no relative motion, or much of it."""
    gear = load_parameters(PAPER).changed({"xi": 0.085} | changes)
    assert cancels(gear, build(gear)) is can
    K, phase = cancelling(gear)
    assert -np.pi <= phase < np.pi
    if 0.0 < K < 10.0:
        series, _ = simulate(build(gear.changed({"K": K, "control_phase": phase})), 320)
        last = slice(-20 * gear.samples_per_cycle, None)
        swing = max(np.ptp(series[name][last]) for name in ("x_sp_L", "x_sp_R")) / gear.b_c
        assert bool(swing < 0.02) is can


@pytest.mark.parametrize("text", ["stagger@all/all/L:phase=1.0", "profile_error:order=1,cos=1e-5"])
def test_no_control_cancels_the_error_that_an_effect_changes(text):
    gear = Parameters()
    assert cancels(gear, build(gear))
    assert not cancels(gear, build_with(gear, read_effects(text)))
