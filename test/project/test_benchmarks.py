"""The benchmarks compare like with like: peers see the kernel's equations, counts are right."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from gears import make

from benchmarks import counting
from benchmarks.peers import measure, ours, problem
from benchmarks.peers.measure import Row, cost_at
from herringbone_sim.core.integrate import largest_exponent
from herringbone_sim.core.lanes import series as lane_series
from herringbone_sim.core.lanes.vector import LANES
from herringbone_sim.core.model import jacobian
from herringbone_sim.core.orbit import orbit_of
from herringbone_sim.core.packed import make_work
from herringbone_sim.core.right_hand_side import right_hand_side
from herringbone_sim.core.switching import polynomial

STATES = np.random.default_rng(5).normal(size=(20, 8))


@pytest.fixture(scope="module")
def model():
    return problem.rig()


@pytest.mark.parametrize("y", STATES)
def test_the_peers_see_the_right_hand_side_of_the_kernel(model, y):
    found, known, tau = np.empty(8), np.empty(8), 0.3 + y[0] ** 2
    problem.slope(tau, y, problem.constants(model), found)
    right_hand_side(model.packed, make_work(4, 4), y, tau, 0, known)
    np.testing.assert_allclose(found, known, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("y", STATES)
def test_one_half_stands_for_both_where_they_are_alike(model, y):
    half, whole = np.empty(4), np.empty(8)
    problem.slope_of_half(0.7, y[:4], problem.constants(model), half)
    problem.slope(0.7, y[:4][problem.FROM_HALF], problem.constants(model), whole)
    np.testing.assert_allclose(half[problem.FROM_HALF], whole, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("y", STATES)
def test_the_peers_see_the_jacobian_of_the_model(model, y):
    z, found = np.roll(y, 3), np.empty(8)
    problem.tangent_slope(0.7, y, problem.constants(model), z, found)
    known = jacobian(model, y, 0.7) @ z
    np.testing.assert_allclose(found, known, rtol=1e-12, atol=1e-13)


def test_a_gear_that_the_peers_do_not_know_is_refused():
    with pytest.raises(ValueError, match="Omega 1"):
        problem.constants(make(Omega=0.9))


@pytest.mark.parametrize(("name", "within"), [("scipy", 1e-9), ("heyoka", 2e-14)])
def test_an_independent_method_confirms_the_reference(name, within):
    pytest.importorskip(name)
    peer = importlib.import_module(f"benchmarks.peers.with_{name}")
    errors = [
        np.abs(method.run(problem.ORBIT_CYCLES) - problem.orbit_end()).max()
        for method in peer.orbit_methods()
        if not method.setting.endswith(("e-05", "e-06")) and "solve_ivp" not in method.family
    ]
    assert min(errors) < within


def test_exponents_one_by_one_are_those_of_the_package():
    found = ours.exponents_one_by_one(np.array([85.0]), 300)
    known, error = largest_exponent(problem.paper(85.0), cycles=300, transient=300)
    assert abs(found[0] - known) < 0.01 + error
    assert found[0] < 0.0


def operations(work):
    """All operations of one run of it."""
    return sum(counting.tally(work).values())


@pytest.mark.parametrize("degree", [1, 4, 12])
def test_a_polynomial_costs_a_product_and_a_sum_a_degree(degree):
    a = counting.wrapped(np.ones((degree + 1, 1)))
    done = counting.tally(lambda: polynomial.py_func(a, 0, counting.Counted(0.5)))
    assert done == {"products": degree, "sums": degree}


def test_the_product_of_two_series_costs_what_it_does_by_hand(monkeypatch):
    for name in counting.VECTOR.keys() & vars(lane_series).keys():
        monkeypatch.setattr(lane_series, name, counting.VECTOR[name])
    work = orbit_of(problem.rig(order=4), 0).work
    # Order 2, two meshes: three products, each added.
    assert operations(lambda: lane_series.cauchy.py_func(work, 2, 0)) == 2 * 3 * 2


def test_lanes_count_one_each_and_a_fused_operation_twice(monkeypatch):
    for name in counting.VECTOR.keys() & vars(lane_series).keys():
        monkeypatch.setattr(lane_series, name, counting.VECTOR[name])
    one = counting.Counted(np.ones(LANES))
    assert operations(lambda: one * one + one) == 2 * LANES
    assert operations(lambda: lane_series.fma(one, one, one)) == 2 * LANES
    assert operations(lambda: lane_series.choose(one > one, one, one)) == 0


def test_the_cost_at_an_error_is_straight_on_logarithmic_axes():
    def row(error, cost):
        return Row("", "", error, cost, 0.0)

    assert cost_at([row(1e-6, 10.0), row(1e-10, 1000.0)], 1e-8) == pytest.approx(100.0)
    assert cost_at([row(1e-6, 10.0), row(1e-10, 1000.0), row(1e-9, 5.0)], 1e-8) == 5.0
    assert np.isnan(cost_at([row(1e-6, 10.0)], 1e-8))


def test_sections_are_compared_whatever_point_comes_first():
    orbit = np.array([[0.0, 1.0], [1.0, 0.0], [0.3, 0.4]])
    reference = np.tile(orbit, (20, 1))
    late = np.roll(reference, 1, axis=0) + 1e-7
    judge = measure.judge_sections(reference[None])
    error, note = judge(np.array([0]), late[None])
    assert error == pytest.approx(1e-7)
    assert note == "same period at 1 of 1 periodic values"


def test_what_a_campaign_did_not_measure_is_a_dash() -> None:
    from benchmarks.faults.__main__ import table
    from benchmarks.faults.trial import Trial

    found = {"one": [Trial("a"), Trial("b")], "two": [Trial("a", 0.25, 3 << 20), Trial("b")]}
    rows = [line.split("|") for line in table(found).splitlines()[2:]]
    assert [[cell.strip() for cell in row[-3:-1]] for row in rows] == [
        ["-", "-"],
        ["0.2 s", "3 MiB"],
    ]
