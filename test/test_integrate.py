"""The steppers: energy, order, symmetry, switching, tangents, changes, divergence."""

from __future__ import annotations

from dataclasses import replace

import newton
import numpy as np
import pytest
from gears import UNEVEN, make
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from herringbone_sim.core.integrate import (
    State,
    Stepper,
    change,
    largest_exponent,
    simulate,
    warm_up,
)
from herringbone_sim.core.model import body_displacements, jacobian, mean_stiffness, relative
from herringbone_sim.errors import DivergenceError

ONE_HARMONIC = {"phasing": "in_phase", "planet_angle": (), "k_amp": (0.25,), "e_amp": (1.0,)}
CONSTANT = {"k_amp": (), "e_m": 0.0, "e_offset": (0.0,)}
LINEAR = {"b": 0.0, "b_offset": (0.0,), "delta_T": 0.0}


def samples(model, cycles, state=None):
    stepper = Stepper(model)
    n = round(cycles * model.parameters.samples_per_cycle)
    return stepper.advance(state or stepper.start(), n)


def state_at(y):
    return State(np.array(y), 0, 0, 0.0, np.zeros((0, len(y))), np.zeros(0))


def after(model, cycles, y):
    return samples(model, cycles, state_at(y)).end.y


def dimensionless(model, row):
    """(x, v) (2 n_mesh,) of a row of samples."""
    n, s = model.layout.n_mesh, model.scales
    scaled = [row[5 : 5 + n] / s.b_c, row[5 + n : 5 + 2 * n] / s.velocity_m_per_s]
    return np.concatenate(scaled)


@pytest.fixture(scope="module")
def orbit(gear):
    """The periodic orbit at delta_T 90, xi 0.07, which loses contact: a state at phase 0."""
    return samples(gear(delta_T=90.0), 3000).end.y


@pytest.fixture(scope="module")
def reference(gear, orbit):
    """That orbit 20 mesh cycles on, with order 24 and 128 steps a cycle."""
    return after(gear(delta_T=90.0, order=24, steps_per_cycle=128), 20, orbit)


# The two models


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


# Against other methods


def test_linear_limit_is_the_matrix_exponential(uneven):
    """No backlash, constant stiffness: 10 cycles at once by expm, 470 passages through zero."""
    model = uneven(**ONE_HARMONIC | LINEAR | {"k_amp": ()})
    block = samples(model, 10.0625)
    start = np.concatenate([dimensionless(model, block.rows[0]), [1.0, 0.0, 1.0]])
    expected = expm(newton.gear(model).linear() * 20.0 * np.pi) @ start
    assert np.abs(dimensionless(model, block.rows[160]) - expected[:24]).max() < 1e-12
    assert block.switches > 200


def test_taylor_against_dop853_with_an_independent_right_hand_side(uneven):
    """Unequal everything, both flanks hit; DOP853 at 1e-12 steps over kinks by tiny steps."""
    model = uneven(**ONE_HARMONIC, delta_T=90.0)
    block = samples(model, 2.0625)
    found = solve_ivp(
        newton.gear(model).slope,
        (0.0, 4.0 * np.pi),
        dimensionless(model, block.rows[0]),
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
    )
    assert block.switches > 20
    assert np.abs(dimensionless(model, block.rows[32]) - found.y[:, -1]).max() < 1e-9


@pytest.mark.parametrize("method", ["taylor", "rk4"])
def test_both_methods_follow_the_same_motion(uneven, method):
    model = uneven(delta_T=90.0, method=method, steps_per_cycle=16 if method == "taylor" else 3200)
    fine = uneven(delta_T=90.0, order=24, steps_per_cycle=128)
    y = Stepper(model).start().y
    error = np.abs(after(model, 2, y) - after(fine, 2, y)).max()
    assert error < (2e-8 if method == "taylor" else 1e-5)


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


# Energy


def mechanical_energy(model, y):
    """Energy [J]: bodies by their rates, springs by their deflection, less the work of torques."""
    s, p = model.scales, model.packed
    n = model.layout.n_coordinate
    u = body_displacements(model, y) * s.b_c
    rate = body_displacements(model, np.concatenate([y[n:], np.zeros(n)])) * s.velocity_m_per_s
    planets = p.multiplicity / p.inv_M_p.ravel()
    masses = np.concatenate([1.0 / p.inv_M_s, [s.M_c], planets])
    T_1 = model.parameters.T_1
    work = T_1 / 2.0 / s.r_bs * (u[0] + u[1]) - s.T_2 / s.r_bc * u[2]
    x, _ = relative(model, y, 0.0)
    f = np.sign(x) * np.maximum(np.abs(x) * s.b_c - model.half_backlash_m, 0.0)
    spring = 0.5 * p.multiplicity * mean_stiffness(model.parameters) @ f**2
    return 0.5 * masses @ rate**2 + spring - work


def energies(model, cycles):
    stepper = Stepper(model)
    state, found = stepper.start(), []
    contact = np.zeros(3, dtype=int)
    for _ in range(cycles * model.parameters.samples_per_cycle):
        found.append(mechanical_energy(model, state.y))
        block = stepper.advance(state, 1)
        contact += block.contact.sum(axis=0)
        state = block.end
    return np.array(found), contact


@pytest.mark.parametrize("kind", ["reduced", "uneven"])
def test_energy_is_conserved_across_loss_of_contact(gear, uneven, kind):
    """xi = 0, constant stiffness, no error: kinetic + elastic - work of T_1 and T_2."""
    values = CONSTANT | {"xi": 0.0, "initial_x": (2.0, 1.5, 0.5, -1.0)}
    model = gear(**values) if kind == "reduced" else uneven(**values)
    energy, contact = energies(model, 20)
    assert np.all(contact > 0)
    assert np.abs(energy - energy[0]).max() < 1e-10 * abs(energy[0])


@pytest.mark.parametrize("kind", ["reduced", "uneven"])
def test_energy_lost_is_what_the_damping_takes(gear, uneven, kind):
    """Integral of c v^2 over all meshes, by Simpson's rule on 400 samples a cycle."""
    values = CONSTANT | {"initial_x": (2.0, 1.5, 0.5, -1.0), "samples_per_cycle": 400}
    model = gear(**values) if kind == "reduced" else uneven(**values)
    block = samples(model, 2.0025)
    n = model.layout.n_mesh
    v = block.rows[:, 5 + n : 5 + 2 * n]
    power = model.packed.multiplicity * v**2 @ model.damping_n_s_per_m
    weights = np.resize([2.0, 4.0], 801) * (block.rows[1, 0] - block.rows[0, 0]) / 3.0
    weights[[0, -1]] /= 2.0
    first = mechanical_energy(model, block.start.y)
    last = mechanical_energy(model, samples(model, 2).end.y)
    assert first - last == pytest.approx(weights @ power, rel=1e-6)
    assert first - last > 0.1 * first


# Symmetry, repetition


@pytest.mark.parametrize("model", ["reduced", "full"])
def test_left_is_right_to_the_bit_in_chaos(gear, model):
    gears = gear(model=model, delta_T=20.0, K=0.02, control_phase=0.3)
    rows = samples(gears, 1500).rows
    names = gears.layout.channels
    for name in names:
        if name.endswith("_L"):
            other = names.index(f"{name[:-1]}R")
            assert np.array_equal(rows[:, names.index(name)], rows[:, other]), name


def test_left_is_right_to_the_bit_with_unequal_planets(uneven):
    half = {"k_factor": (1.0, 1.1, 0.9, 1.0, 1.1, 0.9, 0.8, 1.2, 1.0, 0.8, 1.2, 1.0)}
    alike = dict.fromkeys(("c_factor", "e_factor", "I_s_factor", "I_p_factor"), (1.0,))
    alike |= dict.fromkeys(("e_offset", "b_offset", "phi_a", "phi_b", "initial_x"), (0.0,))
    model = uneven(**half | alike, initial_noise=0.0, delta_T=20.0)
    rows = samples(model, 500).rows
    assert np.array_equal(rows[:, 5:8], rows[:, 8:11])
    assert np.array_equal(rows[:, 11:14], rows[:, 14:17])
    assert not np.allclose(rows[:, 5], rows[:, 6])


@settings(max_examples=15, deadline=None)
@given(cuts=st.lists(st.integers(1, 60), min_size=1, max_size=6), rk4=st.booleans())
def test_blocks_of_whatever_size_give_the_same_bits(cuts, rk4):
    model = make(**UNEVEN, K=0.1, control_order=1.5, method="rk4" if rk4 else "taylor")
    stepper = Stepper(model)
    whole = stepper.advance(stepper.start(tangents=2), sum(cuts))
    state, rows, section = stepper.start(tangents=2), [], []
    for n in cuts:
        section += list(stepper.advance(state, n).section + sum(map(len, rows)))
        block = stepper.advance(state, n)
        rows.append(block.rows)
        state = block.end
    assert np.array_equal(np.concatenate(rows), whole.rows)
    assert section == whole.section.tolist()
    assert np.array_equal(state.y, whole.end.y)
    assert np.array_equal(state.tangents, whole.end.tangents)
    assert np.array_equal(state.growth, whole.end.growth)
    assert (state.cycle, state.index, state.t) == (
        whole.end.cycle,
        whole.end.index,
        whole.end.t,
    )


def test_a_second_stepper_gives_the_same_bits(uneven):
    first, second = (samples(uneven(delta_T=20.0), 100) for _ in range(2))
    assert np.array_equal(first.rows, second.rows)
    assert first.switches == second.switches


def test_advancing_leaves_the_state_it_started_from(gear):
    stepper = Stepper(gear())
    start = stepper.start(tangents=1)
    before = (start.y.copy(), start.tangents.copy(), start.growth.copy())
    stepper.advance(start, 50)
    assert all(
        np.array_equal(a, b)
        for a, b in zip(before, (start.y, start.tangents, start.growth), strict=True)
    )


# Grazing


def graze(gear, b, **more):
    """3/4 of a cycle that swings once towards the back side: -0.35 sin(tau) under a load."""
    free = {"delta_T": 0.0, "initial_v": (-0.35,), "samples_per_cycle": 4, "b": b}
    return samples(gear(**free | more), 0.75)


def test_an_orbit_that_just_touches_the_border(gear):
    """The border is bisected to the last bit: on both sides of it, and of a reference, the
    motion is the same, as the force there is zero."""
    touch, miss = 0.2, 0.5
    while (middle := 0.5 * (touch + miss)) not in (touch, miss):
        if graze(gear, middle).switches:
            touch = middle
        else:
            miss = middle
    fine = {"order": 24, "steps_per_cycle": 128}
    states = [graze(gear, b, **more).end.y for b in (touch, miss) for more in ({}, fine)]
    assert np.ptp(states, axis=0).max() < 1e-12
    assert graze(gear, miss + 1e-13, **fine).switches == 0
    assert graze(gear, touch - 1e-13, **fine).switches > 0


@settings(max_examples=40, deadline=None)
@given(exponent=st.floats(-14.0, -1.0), sign=st.sampled_from([-1.0, 1.0]))
def test_near_grazing_the_step_does_not_matter(exponent, sign):
    b = 0.3411 + sign * 10.0**exponent
    coarse, fine = graze(make, b), graze(make, b, order=24, steps_per_cycle=128)
    assert np.abs(coarse.end.y - fine.end.y).max() < 1e-9


# Tangents and exponents


@pytest.mark.parametrize("kind", ["reduced", "uneven"])
def test_tangents_follow_a_pair_of_runs_across_switches(gear, uneven, kind):
    """Central difference of two runs 2e-7 apart; the saltation matrix is the identity."""
    model = gear(delta_T=90.0) if kind == "reduced" else uneven(delta_T=90.0)
    stepper = Stepper(model)
    start = stepper.start(tangents=1)
    block = samples(model, 3, start)
    assert block.switches > 8
    d = 1e-7
    apart = [after(model, 3, start.y + s * d * start.tangents[0]) for s in (1.0, -1.0)]
    tangent = np.exp(block.end.growth[0]) * block.end.tangents[0]
    difference = (apart[0] - apart[1]) / (2.0 * d)
    assert np.abs(tangent - difference).max() < 1e-5 * np.abs(tangent).max()


@pytest.mark.parametrize("kind", ["reduced", "uneven"])
def test_sum_of_exponents_is_the_mean_divergence(gear, uneven, kind):
    """The trace of the Jacobian is constant: damping acts in and out of contact."""
    model = gear(delta_T=20.0) if kind == "reduced" else uneven()
    n = model.layout.n_state
    stepper = Stepper(model)
    end = stepper.advance(stepper.start(tangents=n), 16 * 60).end
    trace = np.trace(jacobian(model, end.y, 0.0))
    assert end.growth.sum() / (60 * 2.0 * np.pi) == pytest.approx(trace, rel=1e-9)
    assert end.tangents @ end.tangents.T == pytest.approx(np.eye(n), abs=1e-9)


def test_exponents_of_the_linear_gear_are_real_parts_of_eigenvalues(gear):
    model = gear(**LINEAR, k_amp=(), xi=0.05)
    expected = np.sort(np.linalg.eigvals(jacobian(model, np.arange(8.0), 0.0)).real)[::-1]
    stepper = Stepper(model)
    settled = stepper.advance(stepper.start(tangents=8), 16 * 200).end
    end = stepper.advance(settled, 16 * 500).end
    exponents = (end.growth - settled.growth) / (500 * 2.0 * np.pi)
    assert exponents == pytest.approx(expected, abs=1e-3)
    assert largest_exponent(model)[0] == pytest.approx(expected[0], abs=1e-3)


def test_exponent_is_positive_in_chaos(gear):
    exponent, error = largest_exponent(gear(delta_T=20.0), cycles=1000)
    assert exponent > 0.04
    assert 0.0 < error < 0.01


@pytest.mark.parametrize("delta_T", [85.0, 90.0])
def test_exponent_is_negative_and_the_period_one_when_hot(gear, delta_T):
    model = gear(delta_T=delta_T)
    settled = samples(model, 4000).end
    assert np.abs(samples(model, 1, settled).end.y - settled.y).max() < 1e-9
    exponent, error = largest_exponent(model, state=settled)
    assert exponent < -0.005
    assert error < 1e-3


# Live changes


LIVE = [
    {"K": 0.3},
    {"delta_T": 20.0},
    {"xi": 0.2},
    {"T_1": 400.0},
    {"Omega": 1.3},
    {"control_phase": 1.0},
]


@pytest.mark.parametrize("values", LIVE, ids=str)
def test_a_live_change_keeps_displacement_and_velocity(gear, values):
    """In the middle of a cycle: the next sample has the same x and v, whatever changed."""
    old = gear(delta_T=60.0, K=0.1)
    state = samples(old, 20.3).end
    new = gear(**{"delta_T": 60.0, "K": 0.1} | values)
    before = samples(old, 0.0625, state).rows[0]
    after_change = samples(new, 0.0625, change(old, new, state)).rows[0]
    assert after_change[:2].tolist() == before[:2].tolist()
    assert after_change[5:13] == pytest.approx(before[5:13], rel=1e-12, abs=1e-16)


def test_a_live_change_of_omega_with_planets_out_of_step(uneven):
    """x stays; the rates of the ring meshes and of planet 1 stay too (``carry_over``)."""
    old, new = uneven(), uneven(Omega=1.2)
    state = samples(old, 20.3).end
    before = samples(old, 0.0625, state).rows[0]
    after_change = samples(new, 0.0625, change(old, new, state)).rows[0]
    assert after_change[5:17] == pytest.approx(before[5:17], rel=1e-12)
    kept = 17 + np.array([0, 3, *range(6, 12)])
    assert after_change[kept] == pytest.approx(before[kept], rel=1e-12)


def test_a_change_back_and_forth_is_no_change(gear):
    old, new = gear(), gear(K=0.3)
    state = samples(old, 7.5).end
    again = change(new, old, change(old, new, state))
    assert np.array_equal(again.y, state.y)
    assert (again.cycle, again.index, again.t) == (state.cycle, state.index, state.t)


def test_samples_per_cycle_may_change_at_phase_zero(gear):
    old, new = gear(delta_T=90.0), gear(delta_T=90.0, samples_per_cycle=40)
    state = change(old, new, samples(old, 10).end)
    moved = samples(new, 5, state)
    assert np.abs(moved.end.y - samples(old, 5, samples(old, 10).end).end.y).max() < 1e-10
    assert (state.cycle, state.index, moved.end.cycle) == (10, 0, 15)


# Long runs


@pytest.mark.parametrize("model", ["reduced", "full"])
def test_nothing_drifts_with_the_control_on(gear, model):
    """2000 cycles under K = 0.3: the span of every displacement stays what it was."""
    block = samples(gear(model=model, K=0.3, delta_T=50.0), 2000)
    early, late = np.abs(block.rows[1600:9600, 5:]), np.abs(block.rows[-8000:, 5:])
    assert not block.diverged
    assert np.all(late.max(axis=0) < 1.5 * early.max(axis=0))
    assert np.abs(late).max(axis=0)[-1] < 3e-4


# Divergence


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


# Conveniences


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
