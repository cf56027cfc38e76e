"""The steppers against each other, other methods and a fine reference; divergence."""

from __future__ import annotations

from dataclasses import replace

import newton
import numpy as np
import pytest
from gears import LINEAR, ONE_HARMONIC, after, dimensionless, make, samples, state_at
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from herringbone_sim.core import reference as references
from herringbone_sim.core.integrate import Stepper, largest_exponent, simulate, warm_up
from herringbone_sim.core.model import body_displacements, mean_stiffness
from herringbone_sim.errors import DivergenceError, ParameterError


@pytest.fixture(scope="module")
def orbit(gear):
    """The periodic orbit at delta_T 90, xi 0.07, which loses contact: a state at phase 0."""
    return samples(gear(delta_T=90.0), 3000).end.y


@pytest.fixture(scope="module")
def reference(gear, orbit):
    """That orbit 20 mesh cycles on, with order 24 and 128 steps a cycle."""
    return after(gear(delta_T=90.0, order=24, steps_per_cycle=128), 20, orbit)


@pytest.mark.parametrize(("delta_T", "cycles", "error"), [(90.0, 120, 1e-13), (20.0, 5, 1e-12)])
def test_identical_planets_make_the_full_model_the_reduced_one(gear, delta_T, cycles, error):
    reduced = samples(gear(delta_T=delta_T), cycles)
    full = samples(gear(delta_T=delta_T, model="full"), cycles)
    assert np.abs(full.end.y[:2] - reduced.end.y[:2]).max() < error
    assert np.abs(full.end.y[2:8] - np.repeat(reduced.end.y[2:4], 3)).max() < error
    assert full.switches == reduced.switches > 2 * cycles
    names = gear(model="full").layout.channels
    for i, name in enumerate(gear().layout.channels):
        numbered = name.replace("p_", "p1_")
        other = full.rows[:, names.index(numbered)]
        scale = np.abs(other).max() + 1e-300
        assert np.abs(other - reduced.rows[:, i]).max() < 20.0 * error * scale


def test_samples_hold_force_and_rate_of_their_displacement(uneven):
    """F = k f(x) + c v of Eqs. (4), (11), from the recorded x and v alone."""
    model = uneven(**ONE_HARMONIC)
    p = model.parameters
    block = samples(model, 3)
    x, v, F = np.split(block.rows[:, 5:41], 3, axis=1)
    phase = block.rows[:, 1:2]
    k = mean_stiffness(p) * (1.0 + 0.25 * np.cos(phase + np.array(p.phi_a)))
    f = np.sign(x) * np.maximum(np.abs(x) - model.half_backlash_m, 0.0)
    expected = k * f + model.damping_n_s_per_m * v
    assert np.abs(F - expected).max() < 1e-9 * np.abs(F).max()


def test_head_of_the_samples(gear):
    """Time, unwrapped phase and the parameters in force; mesh frequency Omega omega_n."""
    model = gear(K=0.1, delta_T=40.0, T_1=300.0, Omega=0.8, samples_per_cycle=5)
    block = samples(model, 4)
    index = np.arange(20)
    assert block.rows[:, 1] == pytest.approx(2.0 * np.pi * index / 5.0, abs=1e-12)
    speed = 0.8 * model.scales.omega_n
    assert block.rows[:, 0] == pytest.approx(block.rows[:, 1] / speed, rel=1e-12)
    assert np.unique(block.rows[:, 2:5], axis=0).tolist() == [[0.1, 40.0, 300.0]]
    assert block.section.tolist() == [0, 5, 10, 15]
    assert block.contact.sum(axis=1).tolist() == [20] * 4


def test_bodies_of_the_samples(uneven):
    """u = r_b theta with the rigid rotation removed, as ``body_displacements`` has it."""
    model = uneven()
    stepper = Stepper(model)
    state = samples(model, 5).end
    u = stepper.advance(state, 1).rows[0, 41:]
    assert u == pytest.approx(body_displacements(model, state.y) * 1e-4, rel=1e-11)


def test_contact_counts_are_those_of_the_samples(uneven):
    model = uneven()
    block = samples(model, 30)
    x, b = block.rows[:, 5:17], model.half_backlash_m
    counted = np.stack([(x < -b).sum(0), (np.abs(x) <= b).sum(0), (x > b).sum(0)], axis=1)
    assert np.array_equal(block.contact, counted)
    assert np.all(block.contact.sum(axis=0) > 0)


def test_linear_limit_is_the_matrix_exponential(uneven):
    """No backlash, constant stiffness: 10 cycles at once by expm, 470 passages through zero."""
    model = uneven(**ONE_HARMONIC | LINEAR | {"k_amp": (), "Omega": 1.3})
    block = samples(model, 10.0625)
    start = np.concatenate([dimensionless(model, block.rows[0]), [1.0, 0.0, 1.0]])
    expected = expm(newton.gear(model).linear() * 20.0 * np.pi / 1.3) @ start
    assert np.abs(dimensionless(model, block.rows[160]) - expected[:24]).max() < 1e-12
    assert block.switches > 200


def test_taylor_against_dop853_with_an_independent_right_hand_side(uneven):
    """Unequal everything, both flanks hit; DOP853 at 1e-12 steps over kinks by tiny steps."""
    model = uneven(**ONE_HARMONIC, delta_T=90.0, Omega=0.8)
    block = samples(model, 2.0625)
    found = solve_ivp(
        newton.gear(model).slope,
        (0.0, 4.0 * np.pi / 0.8),
        dimensionless(model, block.rows[0]),
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
    )
    assert block.switches > 20
    assert np.abs(dimensionless(model, block.rows[32]) - found.y[:, -1]).max() < 1e-9


def test_both_methods_follow_the_same_motion(uneven):
    """Three harmonics, a control of broken order, and Omega away from 1."""
    values = {"delta_T": 90.0, "Omega": 0.8, "K": 0.3, "control_order": 1.5}
    y = Stepper(uneven(**values)).start().y
    taylor = after(uneven(**values), 2, y)
    rk4 = after(uneven(**values, method="rk4", steps_per_cycle=6400), 2, y)
    fine = after(uneven(**values, order=24, steps_per_cycle=128), 2, y)
    assert np.abs(taylor - fine).max() < 2e-8
    assert np.abs(taylor - rk4).max() < 1e-5


def test_switching_is_located_on_a_periodic_orbit_that_loses_contact(gear, orbit, reference):
    """The default step: 1e-8 after 20 mesh cycles and 160 switches."""
    model = gear(delta_T=90.0)
    block = samples(model, 20, state_at(orbit))
    assert block.switches >= 100
    assert np.abs(block.end.y - reference).max() < 1e-8
    assert np.abs(block.end.y - orbit).max() < 1e-8


def order_by_regression(errors, steps):
    return -np.polyfit(np.log(steps), np.log(errors), 1)[0]


@pytest.mark.parametrize(
    ("order", "steps"),
    [(4, (24, 32, 48, 64, 96, 128)), (6, (16, 24, 32, 48, 64, 96)), (8, (12, 16, 24, 32, 48))],
)
def test_taylor_keeps_its_order_across_kinks(gear, orbit, reference, order, steps):
    errors = []
    for n in steps:
        model = gear(delta_T=90.0, order=order, steps_per_cycle=n, samples_per_cycle=1)
        errors.append(np.abs(after(model, 20, orbit) - reference).max())
    assert abs(order_by_regression(errors, steps) - order) < 0.7


def test_rk4_is_of_order_4_without_kinks(gear):
    smooth = LINEAR | {"samples_per_cycle": 1}
    y = samples(gear(**smooth), 50).end.y
    exact = after(gear(**smooth, order=24, steps_per_cycle=128), 20, y)
    steps = (32, 64, 128, 256)
    errors = []
    for n in steps:
        model = gear(**smooth, method="rk4", steps_per_cycle=n)
        errors.append(np.abs(after(model, 20, y) - exact).max())
    assert order_by_regression(errors, steps) == pytest.approx(4.0, abs=0.15)


def test_rk4_loses_its_order_at_kinks(gear, orbit, reference):
    steps = (100, 200, 400, 800, 1600, 3200)
    errors = []
    for n in steps:
        model = gear(delta_T=90.0, method="rk4", steps_per_cycle=n, samples_per_cycle=1)
        errors.append(np.abs(after(model, 20, orbit) - reference).max())
    assert 0.8 < order_by_regression(errors, steps) < 2.5


PARAMETRIC = LINEAR | {"k_amp": (0.95,), "Omega": 1.4502, "xi": 0.0}


def test_parametric_resonance_runs_away_and_is_reported(gear):
    """Stiffness at twice a natural frequency (0.725), no damping, no backlash."""
    model = gear(**PARAMETRIC)
    block = samples(model, 1000)
    assert block.diverged
    assert len(block.rows) < 16 * 1000
    assert np.abs(block.rows[-1, 5:9]).max() > 1e6 * model.parameters.b_c
    assert np.abs(block.rows[-2, 5:9]).max() <= 1e6 * model.parameters.b_c


def test_too_few_steps_of_rk4_run_away_and_are_reported(gear):
    model = gear(method="rk4", steps_per_cycle=4, samples_per_cycle=4, xi=2.0)
    block = samples(model, 10)
    assert block.diverged
    assert len(block.rows) < 40


def test_a_state_that_is_no_number_is_reported(gear):
    block = samples(gear(), 1, state_at([np.nan] + [0.0] * 7))
    assert block.diverged
    assert len(block.rows) == 1


def test_single_calls_raise_on_divergence(gear):
    with pytest.raises(DivergenceError, match=r"diverged at t = 0\.00.* s with Parameters\("):
        simulate(gear(**PARAMETRIC), 1000)
    with pytest.raises(DivergenceError, match=r"diverged at t = "):
        largest_exponent(gear(**PARAMETRIC), cycles=1000)


def test_simulate_is_the_stepper_in_one_call(gear):
    series, end = simulate(gear(), 10)
    assert len(series) == 160
    assert series.names == gear().layout.channels
    assert np.array_equal(series.data, samples(gear(), 10).rows)
    further, _ = simulate(gear(), 5, end)
    assert np.array_equal(further.data, samples(gear(), 15).rows[160:])


def test_warm_up_runs_one_sample(gear):
    assert len(warm_up(gear()).rows) == 1


def test_phase_of_a_state(gear):
    state = replace(samples(gear(), 1.25).end)
    assert (state.cycle, state.index) == (1, 4)
    assert state.phase(16) == pytest.approx(0.5 * np.pi)


def test_a_block_whose_last_sample_is_out_of_range_has_diverged(gear):
    stepper = Stepper(gear())
    start = replace(stepper.start(), y=np.full(8, 1e7))
    assert stepper.advance(start, 1).diverged


COARSE = {"samples_per_cycle": 4, "steps_per_cycle": 32}


@pytest.mark.parametrize("method", ["taylor", "rk4"])
def test_whole_numbers_in_a_state_are_taken_as_floats(monkeypatch, method):
    monkeypatch.setattr(references, "_entries", {})  # as in a new process
    machine = Stepper(make(**COARSE, method=method))
    start = replace(machine.start(), y=np.zeros(machine.model.n_state))
    found = machine.advance(replace(start, y=start.y.astype(int), t=0), 4)
    for y in (start.y, start.y.astype(np.float32)):
        np.testing.assert_array_equal(found.end.y, machine.advance(replace(start, y=y), 4).end.y)
    assert found.end.y.any()
    assert machine.advance(replace(start, t=0.5), 1).rows[0, 0] == 0.5


def test_a_whole_natural_frequency_leaves_the_clock_of_other_gears_alone(monkeypatch):
    monkeypatch.setattr(references, "_entries", {})
    for values in ({"omega_n": 20000}, {}):
        machine = Stepper(make(**COARSE, **values))
        model = machine.model
        cycle = 2.0 * np.pi / (model.packed.Omega * model.scales.omega_n)
        assert machine.advance(machine.start(), 4).end.t == pytest.approx(cycle, rel=1e-12)


def test_what_gives_no_exponent_is_refused():
    for model, transient, words in (
        (make(method="rk4"), 5, "exponents need method: taylor"),
        (make(), -1, "got 10 after -1"),
    ):
        with pytest.raises(ParameterError, match=words):
            largest_exponent(model, 10, transient)
