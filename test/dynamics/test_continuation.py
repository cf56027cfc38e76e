"""Continuation: branches that are known in closed form, through folds and to their ends."""

from __future__ import annotations

import numpy as np
import pytest
from orbit_support import SWAP, LinearOscillator, branch_of, coupled, henon, logistic

from herringbone_sim.dynamics.continuation import StepControl, branch_off, follow
from herringbone_sim.dynamics.curve import Family, begin
from herringbone_sim.errors import AnalysisError


def test_a_branch_goes_round_its_fold():
    """a x^2 + (1 - b) x - 1 = 0 with b = 0.3: both roots lie on one curve, a >= -(1 - b)^2 / 4."""
    _, branch = branch_of(henon, -0.3, -0.05, [1.7, 0.5], -0.06)
    assert branch.ends == ("range", "range")
    values = np.array([point.value for point in branch.points])
    x = np.array([point.orbit.points[0, 0] for point in branch.points])
    assert values[0] == values[-1] == pytest.approx(-0.05)
    assert values.min() == pytest.approx(-(0.7**2) / 4, abs=1e-4)
    assert values * x * x + 0.7 * x == pytest.approx(np.ones(len(x)), abs=1e-9)
    roots = np.sort(np.roots([-0.05, 0.7, -1.0]))
    assert sorted((x[0], x[-1])) == pytest.approx(roots, abs=1e-8)
    by_x = sorted(branch.points, key=lambda p: p.orbit.points[0, 0])
    assert by_x[0].multipliers.unstable == (0, 0)
    assert by_x[-1].multipliers.unstable != (0, 0)


def test_a_branch_of_the_linear_oscillator_follows_its_resonance():
    _, branch = branch_of(lambda w: LinearOscillator(0.05, 0.05, w), 0.5, 1.5, [0.1, 0.0], 0.6)
    for point in branch.points:
        flow = LinearOscillator(0.05, 0.05, point.value)
        assert point.orbit.points[0] == pytest.approx(flow.orbit, abs=1e-8)
        modulus = np.exp(-0.05 * flow.period)
        assert np.abs(point.multipliers.within) == pytest.approx([modulus] * 2, rel=1e-9)
    assert max(np.hypot(*p.orbit.points[0]) for p in branch.points) == pytest.approx(0.5, rel=0.02)


def test_a_doubled_branch_is_that_of_the_closed_form():
    """P2 of the logistic map: x = (r + 1 +- sqrt((r - 3) (r + 1))) / (2 r)."""
    family = Family(logistic, 2.9, 3.4)
    curve, start = begin(family, np.array([[2 / 3]]), 3.0)
    doubled, first = branch_off(curve, start, np.array([1.0]), 2, 1e-3)
    branch = follow(doubled, first)
    assert branch.ends[1] == "range"
    for point in branch.points:
        r = point.value
        root = np.sqrt((r - 3) * (r + 1))
        expected = [(r + 1 - root) / (2 * r), (r + 1 + root) / (2 * r)]
        assert np.sort(point.orbit.points[:, 0]) == pytest.approx(expected, abs=1e-6)


def test_a_doubled_branch_ends_where_it_halves():
    """From its stable middle P2 is followed down to the flip at r = 3, and stops there."""
    _, branch = branch_of(logistic, 2.9, 3.4, [[0.4794], [0.8236]], 3.3)
    assert branch.ends[0] == "halved"
    assert branch.ends[1] == "range"
    assert branch.points[0].value == pytest.approx(3.0, abs=1e-3)


def test_where_left_and_right_are_alike_they_stay_so():
    """The transverse multiplier passes -1 at r = 2 + 1 / 0.8 without being noticed by Newton."""
    curve, branch = branch_of(lambda r: coupled(r, 0.1), 2.5, 3.9, [0.6, 0.6], 2.6, SWAP)
    assert branch.ends == ("range", "range")
    assert curve.symmetric
    for point in branch.points:
        assert np.ptp(point.orbit.points) == 0.0
        assert point.multipliers.transverse[0] == pytest.approx(0.8 * (2 - point.value), abs=1e-8)
    assert branch.points[-1].multipliers.unstable == (1, 1)


def test_a_branch_that_cannot_begin_or_go_on_says_why():
    with pytest.raises(AnalysisError, match="no orbit of period 1"):
        begin(Family(henon, -1.0, 1.0), np.array([[0.5, 0.1]]), -0.9)
    _, branch = branch_of(henon, -0.5, 0.5, [0.7, 0.2], 0.4, steps=StepControl(points=4))
    assert branch.ends == ("4 points", "4 points")
