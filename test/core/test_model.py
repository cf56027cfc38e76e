"""The kernel's right-hand side against the paper's equations, written another way."""

from __future__ import annotations

import numpy as np
import pytest
from equations import body_accelerations, reduced_accelerations
from gears import CONSTANT, samples

from herringbone_sim.core import mesh
from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.model import (
    body_displacements,
    carry_over,
    errors_at,
    initial_state,
    jacobian,
    mean_stiffness,
    mean_sun_force,
    mesh_phases,
    relative,
    state,
)

PHASES = (0.0, 0.3, 1.7, 3.1, 5.9)


def random_states(model, n=20, seed=1, scale=2.0):
    rng = np.random.default_rng(seed)
    return scale * rng.normal(size=(n, model.layout.n_state))


def error_accelerations(model, phase, d=1e-4):
    """d2e/dtau2 of every mesh by differences of its rate."""
    ahead, behind = (errors_at(model, phase + s)[1] for s in (d, -d))
    return model.parameters.Omega * (ahead - behind) / (2.0 * d)


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"projection": "torque", "thermal_rp": "sun"},
        {"Omega": 0.7, "T_1": 500.0, "T_2": 900.0, "n_planets": 4},
        {"K": 0.3},
        {"K": 0.3, "control_phase": 0.4, "control_order": 2.0, "control_on": (1.0, 0.0, 0.5, 0.0)},
        {"I_s_factor": (1.1, 0.9), "I_p_factor": (0.8, 1.2), "k_factor": (1.0, 0.9, 1.1, 1.2)},
        {"mesh_phase": (0.0, 0.3, -0.2, 0.5), "c_factor": (1.0, 0.5, 2.0, 0.1)},
    ],
    ids=str,
)
def test_kernel_is_equation_18_with_the_control_of_22(gear, slope_of, values):
    model = gear(**values)
    for phase, y in zip(PHASES * 4, random_states(model), strict=True):
        x, v = relative(model, y, phase)
        q_L, q_R, r_L, r_R = slope_of(model, y, phase)[4:]
        e_dd = error_accelerations(model, phase)
        kernel = np.array([q_L - r_L, q_R - r_R, r_L, r_R]) - e_dd
        literal = reduced_accelerations(model, x, v, phase)
        assert kernel == pytest.approx(literal, rel=1e-9, abs=1e-6)


def full_forces_n(model, y, phase):
    """k f(x) + c v [N] of Eqs. (4), (7), (9), (11), mesh by mesh, from the parameter set."""
    p, s = model.parameters, model.scales
    x, v = relative(model, y, phase)
    shift = mesh_phases(p)
    forces = []
    for m, k_m in enumerate(mean_stiffness(p)):
        share = sum(
            a * np.cos((j + 1) * (phase + shift[m]) + np.array(p.phi_a)[m % len(p.phi_a)])
            for j, a in enumerate(p.k_amp)
        )
        spring = k_m * (1.0 + share) * mesh.backlash(x[m] * s.b_c, model.half_backlash_m[m])
        forces.append(spring + model.damping_n_s_per_m[m] * v[m] * s.velocity_m_per_s)
    return np.array(forces)


@pytest.mark.parametrize("values", [{}, {"Omega": 1.3, "T_1": -400.0, "xi": 0.2}], ids=str)
def test_kernel_is_equations_12_to_14_projected_by_15_and_16(uneven, slope_of, values):
    """Unequal planets, sides and meshes; three harmonics; planets at odd angles."""
    model = uneven(**values)
    s = model.scales
    for phase, y in zip(PHASES * 4, random_states(model), strict=True):
        u = body_accelerations(model, full_forces_n(model, y, phase))
        suns, carrier, planets = u[:2], u[2], u[3:]
        q = (suns - 2.0 * carrier) * s.cos_beta
        r = (planets - carrier) * s.cos_beta
        expected = np.concatenate([q, r]) / s.acceleration_m_per_s2
        assert slope_of(model, y, phase)[8:] == pytest.approx(expected, rel=1e-11, abs=1e-11)


def test_body_accelerations_are_newtons_law_by_hand(gear):
    """Eqs. (12)-(14) with I theta'' and r_b: one sun mesh at 1000 N, the rest free."""
    model = gear(model="full")
    s, p = model.scales, model.parameters
    force = np.zeros(12)
    force[1] = 1000.0
    u = body_accelerations(model, force)
    lever = 1000.0 * s.cos_beta
    assert u[0] == pytest.approx(s.r_bs * (110.0 - lever * s.r_bs) / p.I_s)
    assert u[1] == pytest.approx(s.r_bs * 110.0 / p.I_s)
    I_ce = p.I_c + 3.0 * p.m_p * s.r_bc**2
    assert u[2] == pytest.approx(s.r_bc * (lever * s.r_bc - s.T_2) / I_ce)
    assert u[3:] == pytest.approx([0.0, s.r_bp * lever * s.r_bp / p.I_p, 0.0, 0.0, 0.0, 0.0])


def test_scales_of_the_nominal_rig(gear):
    """Data sheet: omega_n about 3.2e4 rad/s, mesh frequency 5094 Hz, T_2 = 847.4 N m."""
    s = gear().scales
    assert s.omega_n == pytest.approx(32009, abs=1.0)
    assert s.omega_n / (2.0 * np.pi) == pytest.approx(5094, abs=1.0)
    assert abs(s.T_2 - 847.4) < 0.05


def test_control_is_a_torque_on_the_carrier(gear):
    """K = 0.3 on every relative acceleration is about 1e5 N m (Eqs. 19-22 in SI)."""
    assert gear().scales.control_torque_n_m(0.3) == pytest.approx(1e5, rel=0.15)


def test_control_acts_on_the_equations_that_it_is_given(gear, slope_of):
    """Eq. (22): K cos(phase) comes off sp_R alone, which is q_R and leaves r_R."""
    y = random_states(gear())[0]
    free = slope_of(gear(), y, 0.4)
    held = slope_of(gear(K=0.3, control_on=(0.0, 1.0, 0.0, 0.0)), y, 0.4)
    assert held - free == pytest.approx([0, 0, 0, 0, 0, -0.3 * np.cos(0.4), 0, 0], abs=1e-12)


def test_control_of_broken_order_goes_on_over_the_cycles(gear, slope_of):
    """Order 1.5: at phase 0 of cycle 1 its angle is 3 pi, so that it pushes the other way."""
    y = random_states(gear())[0]
    free = slope_of(gear(), y, 0.0)
    model = gear(K=0.3, control_order=1.5)
    first, second = (slope_of(model, y, 0.0, cycle) - free for cycle in (0, 1))
    assert first[6:] == pytest.approx([-0.3, -0.3], abs=1e-12)
    assert second == pytest.approx(-first, abs=1e-12)


@pytest.mark.parametrize("kind", ["reduced", "uneven"])
def test_jacobian_against_central_differences(gear, uneven, slope_of, kind):
    """Off the kinks the slope is linear in y: differences are exact to rounding."""
    model = gear() if kind == "reduced" else uneven()
    checked = 0
    d = 1e-5
    for phase, y in zip(PHASES * 4, random_states(model), strict=True):
        x, _ = relative(model, y, phase)
        if np.min(np.abs(np.abs(x) - model.packed.b)) < 4.0 * d:
            continue
        steps = d * np.eye(len(y))
        columns = [
            (slope_of(model, y + s, phase) - slope_of(model, y - s, phase)) / (2.0 * d)
            for s in steps
        ]
        assert jacobian(model, y, phase) == pytest.approx(np.array(columns).T, abs=1e-9)
        checked += 1
    assert checked > 10


@pytest.mark.parametrize("kind", ["reduced", "uneven"])
def test_trace_of_the_jacobian_is_the_damping(gear, uneven, kind):
    """Divergence of the flow: -sum of c (1/M) over both bodies of each mesh, all dimensionless."""
    model = gear() if kind == "reduced" else uneven()
    y = random_states(model)[3]
    p = model.packed
    c = p.damping.reshape(2, 2, -1)
    N = p.multiplicity
    sun, ring = c
    by_hand = -(
        np.sum(sun * (N * p.inv_M_s[:, None] + 2.0 * N * p.inv_M_c))
        + np.sum(sun * (p.inv_M_p - N * p.inv_M_c))
        + np.sum(ring * (p.inv_M_p + N * p.inv_M_c))
    )
    assert np.trace(jacobian(model, y, 0.4)) == pytest.approx(by_hand, rel=1e-12)


@pytest.mark.parametrize("kind", ["reduced", "uneven"])
def test_state_is_the_inverse_of_relative(gear, uneven, kind):
    model = gear() if kind == "reduced" else uneven()
    for phase, y in zip(PHASES * 4, random_states(model), strict=True):
        assert state(model, *relative(model, y, phase), phase) == pytest.approx(y, abs=1e-13)


def test_relative_displacements_are_equations_15_and_16(uneven):
    """x_sp = (u_s - u_p - u_c) cos beta - e_sp, x_rp = (u_p - u_c) cos beta - e_rp."""
    model = uneven()
    y = random_states(model)[0]
    u = body_displacements(model, y)
    suns, carrier, planets = u[:2, None], u[2], u[3:].reshape(2, 3)
    e, _ = errors_at(model, 0.9)
    cos_beta = model.scales.cos_beta
    x, _ = relative(model, y, 0.9)
    sun = (suns - planets - carrier) * cos_beta
    ring = (planets - carrier) * cos_beta
    assert x == pytest.approx(np.concatenate([sun.ravel(), ring.ravel()]) - e, abs=1e-12)


def test_rigid_rotation_is_taken_out_by_momentum(uneven):
    """2 M_s u_s + M_p u_p + M_c u_c = 0, the momentum along the rigid rotation (2, 1, 1)."""
    model = uneven()
    s, p = model.scales, model.packed
    u = body_displacements(model, random_states(model)[0])
    planets = u[3:].reshape(2, 3)
    momentum = np.sum(2.0 * u[:2] / p.inv_M_s) + np.sum(planets / p.inv_M_p) + s.M_c * u[2]
    assert momentum == pytest.approx(0.0, abs=1e-11)


def test_geometric_phases_go_with_the_teeth(gear):
    """Planet 2 at 90 degrees: 27 x 90 on the sun, -77 x 90 on the ring, both sides."""
    p = gear(model="full", phasing="geometric", planet_angle=(0.0, 90.0, 200.0)).parameters
    degrees = np.degrees(mesh_phases(p)).reshape(2, 2, 3)
    assert degrees[0] == pytest.approx(np.array([[0.0, 2430.0, 5400.0]] * 2))
    assert degrees[1] == pytest.approx(np.array([[0.0, -6930.0, -15400.0]] * 2))


def test_geometric_phases_of_equal_spacing_add_to_the_given_ones(gear):
    p = gear(model="full", phasing="geometric", mesh_phase=(0.1,)).parameters
    assert np.degrees(mesh_phases(p) - 0.1)[:3] == pytest.approx([0.0, 3240.0, 6480.0])


def test_sun_and_ring_mesh_of_a_planet_agree_where_the_gear_can_be_assembled(gear):
    """(z_s + z_r) / N whole: 27 + 78 = 105; both shifts are the same part of a tooth."""
    p = gear(model="full", phasing="geometric", z_r=78).parameters
    sun, ring = mesh_phases(p).reshape(2, 6)
    assert np.cos(sun - ring) == pytest.approx(np.ones(6))


def test_phases_in_step_by_default(gear):
    assert mesh_phases(gear(model="full").parameters).tolist() == [0.0] * 12


@pytest.mark.parametrize("model", ["reduced", "full"])
def test_initial_state_is_what_was_asked_for(gear, model):
    gears = gear(model=model, initial_x=(0.1, 0.2, 0.3, 0.4), initial_v=(1.0, 2.0, 3.0, 4.0))
    x, v = relative(gears, initial_state(gears), 0.0)
    c = gears.layout.n_classes
    assert x == pytest.approx(np.repeat([0.1, 0.2, 0.3, 0.4], c), abs=1e-14)
    assert v == pytest.approx(np.repeat([1.0, 2.0, 3.0, 4.0], c), abs=1e-14)


def test_initial_noise_goes_with_the_seed(gear):
    first, again, other = (
        initial_state(gear(model="full", initial_noise=0.1, seed=seed)) for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first[:8], other[:8])
    assert np.array_equal(first[8:], other[8:])
    assert 0.02 < np.std(first[:8] - initial_state(gear(model="full"))[:8]) < 0.3


def test_initial_state_is_the_first_sample(uneven):
    model = uneven()
    stepper = Stepper(model)
    row = stepper.advance(stepper.start(), 1).rows[0]
    x, _ = relative(model, initial_state(model), 0.0)
    assert row[5:17] == pytest.approx(x * 1e-4, rel=1e-13)


@pytest.mark.parametrize(
    "values",
    [{"K": 0.4}, {"delta_T": 90.0}, {"xi": 0.3}, {"T_1": 500.0}, {"control_phase": 1.0}],
    ids=str,
)
def test_a_change_that_leaves_the_error_keeps_the_state_to_the_bit(uneven, values):
    old = uneven()
    y = random_states(old)[0]
    assert carry_over(old, uneven(**values), y, 1.1) is y


def test_a_change_of_omega_with_planets_out_of_step(uneven):
    """Ring meshes and planet 1 are kept, x is kept throughout; the sun rates of the others
    follow from geometry."""
    old, new = uneven(), uneven(Omega=1.4)
    y = random_states(old)[0]
    before, after = relative(old, y, 1.1), relative(new, carry_over(old, new, y, 1.1), 1.1)
    assert after[0] == pytest.approx(before[0], abs=1e-13)
    kept = [0, 3, *range(6, 12)]
    assert after[1][kept] == pytest.approx(before[1][kept], abs=1e-13)
    rates = [errors_at(m, 1.1)[1].reshape(2, 2, 3) for m in (old, new)]
    loop = (rates[1] - rates[0]).sum(axis=0)
    moved = loop[:, :1] - loop
    assert after[1][:6] - before[1][:6] == pytest.approx(moved.ravel(), abs=1e-13)


@pytest.mark.parametrize("projection", ["mesh_and_torque", "torque"])
def test_a_gear_at_rest_carries_the_input_torque_at_its_sun_meshes(gear, projection):
    model = gear(**CONSTANT, projection=projection, xi=0.2)
    last = samples(model, 1, samples(model, 400).end).rows[-1]
    of_sun = [last[model.layout.channels.index(f"F_{mesh}")] for mesh in ("sp_L", "sp_R")]
    assert of_sun == pytest.approx(2 * [mean_sun_force(model)], rel=1e-9)
