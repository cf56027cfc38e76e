"""The largest exponent from two trajectories, and the three methods side by side."""

from __future__ import annotations

import numpy as np
import pytest
from flows import Henon, Lorenz
from gears import LINEAR, paper

from herringbone_sim.analysis.lyapunov import largest_exponent as from_series
from herringbone_sim.dynamics.flow import GearFlow, iterate, settle
from herringbone_sim.dynamics.spectrum import lyapunov_spectrum
from herringbone_sim.dynamics.two_trajectories import DISTANCE, over_distances
from herringbone_sim.errors import AnalysisError

NEAR = (DISTANCE,)


def test_henon_map():
    [[value, _]] = over_distances(Henon(), np.array([0.1, 0.1]), NEAR, periods=10000)
    assert value == pytest.approx(0.4192, abs=0.015)


def test_lorenz_system():
    y = settle(Lorenz(), np.ones(3), 100)
    [[value, _]] = over_distances(Lorenz(), y, NEAR, periods=1000, transient=50)
    assert value == pytest.approx(0.9056, abs=0.05)


def test_gear_that_keeps_contact(gear):
    flow = GearFlow(gear(**LINEAR, xi=0.15))
    y = np.arange(8.0)
    exact = np.log(np.abs(np.linalg.eigvals(flow.map(y)[1]))).max() / flow.period
    [[value, _]] = over_distances(flow, settle(flow, y, 50), NEAR, periods=1000, transient=200)
    assert value == pytest.approx(exact, abs=1e-3)


def test_three_methods_agree_on_the_chaos_of_the_gear():
    """delta_T = 20 of the paper's set: tangent flow, two trajectories, the recorded section."""
    flow = GearFlow(paper(delta_T=20.0))
    y = settle(flow, flow.start(), 500)
    tangent = lyapunov_spectrum(flow, y, periods=1500, k=1)
    [[pair, error]] = over_distances(flow, y, NEAR, periods=1500, transient=200)
    series = from_series(iterate(flow, y, 1501), np.random.default_rng(0))
    value = tangent.exponents[0]
    assert value > 0.06
    both = np.hypot(tangent.errors[0], error)
    assert pair == pytest.approx(value, abs=4.0 * both)
    assert series.value / flow.period == pytest.approx(value, rel=0.2)


def test_too_far_apart_the_exponent_is_lost_and_nearer_it_is_not(gear):
    """A distance of the attractor's size can't grow; from 1e-12 to 1e-5 it does not matter."""
    flow = GearFlow(gear(delta_T=20.0))
    y = settle(flow, flow.start(), 300)
    found = over_distances(flow, y, (1e-20, 1e-12, 1e-8, 1e-5, 0.3), periods=600)
    assert np.isnan(found[0]).all()
    plateau = found[1:4, 0]
    assert np.ptp(plateau) < 4.0 * found[1, 1]
    assert found[4, 0] < plateau.min() - 4.0 * found[4, 1]


def test_the_paper_s_runge_kutta_steps_over_the_kinks_and_agrees(gear):
    """At 200 steps a cycle the noise of the kinks lies below a distance of 1e-4."""
    exact = GearFlow(gear(delta_T=20.0))
    rough = GearFlow(gear(delta_T=20.0, method="rk4", steps_per_cycle=200))
    y = settle(exact, exact.start(), 300)
    one, two = (over_distances(f, y, (1e-4,), 800, 200)[0] for f in (exact, rough))
    assert two[0] == pytest.approx(one[0], abs=4.0 * np.hypot(one[1], two[1]))


def test_wrong_input():
    with pytest.raises(AnalysisError, match="positive, got -1e-08"):
        over_distances(Henon(), np.zeros(2), (1e-7, -1e-8))
