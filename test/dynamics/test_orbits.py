"""Periodic orbits by shooting: maps and oscillators with known orbits, then the gear."""

from __future__ import annotations

import numpy as np
import pytest
from gears import make
from orbit_support import SWAP, LinearOscillator, coupled, henon, logistic
from scipy.linalg import expm

from herringbone_sim.core.integrate import largest_exponent
from herringbone_sim.core.mirror import layout_mirror
from herringbone_sim.dynamics.flow import GearFlow, iterate, settle
from herringbone_sim.dynamics.orbits import (
    closest_return,
    find_orbit,
    least_period,
    multipliers,
    symmetry_bases,
)
from herringbone_sim.errors import AnalysisError

PAPER = {
    "thermal_rp": "sun",
    "projection": "torque",
    "gamma": 1.2e-5,
    "n_planets": 3,
}


def test_an_unstable_fixed_point_of_the_henon_map():
    """x = (b - 1 + sqrt((1 - b)^2 + 4 a)) / (2 a), multipliers of [[-2 a x, 1], [b, 0]]."""
    a, b = 1.4, 0.3
    x = (b - 1 + np.sqrt((1 - b) ** 2 + 4 * a)) / (2 * a)
    orbit = find_orbit(henon(a), np.array([0.5, 0.1]))
    assert orbit.converged
    assert orbit.points[0] == pytest.approx([x, b * x], abs=1e-12)
    expected = np.sort(np.roots([1, 2 * a * x, -b]))
    assert np.sort(multipliers(orbit).within.real) == pytest.approx(expected, abs=1e-10)
    assert multipliers(orbit).unstable == (1, 0)


def test_every_multiplier_of_a_linear_oscillator():
    """exp(T (-D +- i sqrt(1 - D^2))): the forcing has no say in it."""
    flow = LinearOscillator(damping=0.05, force=0.7, Omega=1.3)
    orbit = find_orbit(flow, np.zeros(2))
    assert orbit.points[0] == pytest.approx(flow.orbit, abs=1e-12)
    rate = complex(-0.05, np.sqrt(1 - 0.05**2))
    found = sorted(multipliers(orbit).all, key=lambda mu: mu.imag)
    expected = sorted(np.exp([rate * flow.period, rate.conjugate() * flow.period]), key=np.imag)
    assert found == pytest.approx(expected, abs=1e-12)
    three = find_orbit(flow, np.ones(2), period=3)
    assert least_period(three.points) == 1
    A = np.array([[0.0, 1.0], [-1.0, -0.1]])
    cubed = np.linalg.eigvals(expm(A * 3 * flow.period))
    assert np.abs(multipliers(three).within) == pytest.approx(np.abs(cubed), abs=1e-12)


def test_an_orbit_of_period_three_has_the_multiplier_of_its_product():
    r = 3.9
    start = closest_return(logistic(r), np.array([0.2]), 3, 3000)
    orbit = find_orbit(logistic(r), start)
    x = orbit.points[:, 0]
    assert least_period(orbit.points) == 3
    assert x == pytest.approx(np.roll(r * x * (1 - x), 1), abs=1e-10)
    assert multipliers(orbit).within[0] == pytest.approx(np.prod(r * (1 - 2 * x)), rel=1e-9)


def test_multipliers_of_halves_that_are_alike_are_split():
    r, share = 3.3, 0.1
    x = 1 - 1 / r
    orbit = find_orbit(coupled(r, share), np.array([0.6, 0.6]), mirror=SWAP)
    split = multipliers(orbit, SWAP)
    assert orbit.points[0] == pytest.approx([x, x])
    assert split.within == pytest.approx([2 - r], abs=1e-10)
    assert split.transverse == pytest.approx([(1 - 2 * share) * (2 - r)], abs=1e-10)
    assert split.unstable == (1, 1)


def test_where_there_is_no_orbit_a_reason_is_given():
    nothing = find_orbit(henon(-0.5), np.array([0.3, 0.1]))
    assert not nothing.converged
    assert nothing.reason
    with pytest.raises(AnalysisError, match="periodic orbit"):
        multipliers(nothing)
    far = find_orbit(henon(1.4), np.array([1e7, 0.0]))
    assert "left the range" in far.reason


def test_sides_part_at_the_rate_of_the_transverse_multiplier():
    """P3 at 64 K is stable for all that keep left and right alike, yet no halves stay alike."""
    flow = GearFlow(make(**PAPER | {"delta_T": 64.0}))
    sides = layout_mirror(flow.model.layout)
    orbit = find_orbit(
        flow, closest_return(flow, settle(flow, flow.start(), 500), 3, 60), 3, sides
    )
    split = multipliers(orbit, sides)
    assert least_period(orbit.points) == 3
    assert split.unstable == (0, 1)
    states = iterate(flow, orbit.points[0] + 1e-9 * symmetry_bases(sides)[1] @ np.ones(4), 25)[::3]
    apart = np.linalg.norm(states - states[:, sides], axis=1)
    assert apart[8] / apart[5] == pytest.approx(abs(split.transverse[0]) ** 3, rel=1e-3)


@pytest.fixture(scope="module")
def stable():
    """The gear of the paper at 85 K: the motion that simulation reaches, and its orbit."""
    flow = GearFlow(make(**PAPER | {"delta_T": 85.0}))
    y = settle(flow, flow.start(), 600)
    start = y + 1e-2 * symmetry_bases(layout_mirror(flow.model.layout))[0] @ np.array(
        [1.0, -1.0, 1.0, 1.0]
    )
    return flow, y, find_orbit(flow, start, mirror=layout_mirror(flow.model.layout))


def test_the_stable_orbit_is_the_one_that_simulation_reaches(stable):
    flow, y, orbit = stable
    assert orbit.converged
    assert orbit.points[0] == pytest.approx(y, abs=1e-9)
    assert iterate(flow, orbit.points[0], 20)[-1] == pytest.approx(y, abs=1e-9)


def test_the_largest_multiplier_is_the_largest_exponent(stable):
    flow, _, orbit = stable
    split = multipliers(orbit, layout_mirror(flow.model.layout))
    assert len(split.within) == len(split.transverse) == 4
    exponent, error = largest_exponent(flow.model, cycles=400, transient=400)
    largest = np.log(np.abs(split.all[0])) / flow.period
    assert largest == pytest.approx(exponent, abs=4 * error + 1e-4)
    assert np.log(np.abs(split.within[0])) / flow.period < largest


def test_the_product_of_the_multipliers_is_the_mean_divergence(stable):
    """The damping is constant, contact or none: det M = exp(trace(A) period) (Liouville)."""
    flow, _, orbit = stable
    with_contact = np.prod(multipliers(orbit, layout_mirror(flow.model.layout)).all).real
    free = GearFlow(make(**PAPER | {"delta_T": 0.0, "b": 10.0, "e_m": 0.0, "T_1": 0.0}))
    _, tangents = free.advance(np.zeros(8), np.eye(8))
    assert with_contact == pytest.approx(np.linalg.det(tangents), rel=1e-6)
