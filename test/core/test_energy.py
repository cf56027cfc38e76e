"""Energy is conserved without damping, across loss of contact, and lost to it otherwise."""

from __future__ import annotations

import numpy as np
import pytest
from gears import CONSTANT, samples

from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.model import body_displacements, mean_stiffness, relative


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
