"""The search for a switch, on polynomials whose roots are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from interpreted import POLYNOMIALS, leaving

from herringbone_sim.core.switching import extremum, leaves_at, polynomial_zero


def column(*coefficients):
    return np.array(coefficients, dtype=float)[:, None]


def leaves(*coefficients, level=0.0, sign=1.0, before=2.0):
    a = column(*coefficients)
    end, slope = a.sum(), np.arange(float(len(a))) @ a[:, 0]
    return leaves_at(a, 0, level, sign, end, slope, before)


@given(at=st.floats(0.001, 0.999), steep=st.floats(0.01, 100.0), cubic=st.floats(0.0, 10.0))
def test_root_of_a_monotonic_cubic(at, steep, cubic):
    """steep (s - at) + cubic (s^3 - at^3) has its only root at ``at``."""
    a = column(-steep * at - cubic * at**3, steep, 0.0, cubic)
    assert polynomial_zero(a, 0, 0.0, 0.0, a[0, 0], 1.0, a.sum()) == pytest.approx(at, abs=1e-8)


@given(at=st.floats(0.001, 0.999), curved=st.floats(0.01, 100.0))
def test_turning_point_of_a_parabola(at, curved):
    for sign in (1.0, -1.0):
        a = sign * column(3.0, -2.0 * curved * at, curved)
        assert extremum(a, 0, 0.0, 1.0) == pytest.approx(at, abs=1e-9)


@pytest.mark.parametrize(
    ("coefficients", "at"),
    [
        pytest.param((1.0, -2.0, 0.0), 0.5, id="goes straight through"),
        pytest.param((1.0, 1.0, 1.0), 2.0, id="stays away"),
        pytest.param((0.0, 1.0, -2.0), 0.5, id="starts on the level, rises, comes back"),
        pytest.param((0.0, 1.0, -0.5), 2.0, id="starts on the level and rises"),
        pytest.param((0.0, -1.0, 0.5), 0.0, id="starts on the level and falls"),
        pytest.param((0.0, -1.0, 1.5), 0.0, id="starts on the level, falls, comes back"),
        pytest.param((0.04, -0.5, 1.0), 0.1, id="dips below between two ends above"),
        pytest.param((0.25, -1.0, 1.0), 2.0, id="touches"),
        pytest.param((0.2501, -1.0, 1.0), 2.0, id="misses by a hair"),
        pytest.param((0.249999, -1.0, 1.0), 0.499, id="dips by a hair"),
        pytest.param((-1e-13, 1e-9, -1.0), 0.0, id="below by rounding, and never above"),
    ],
)
def test_first_leaving_of_known_polynomials(coefficients, at):
    assert leaves(*coefficients) == pytest.approx(at, abs=1e-9)
    mirrored = [-c for c in coefficients]
    assert leaves(*mirrored, sign=-1.0) == pytest.approx(at, abs=1e-9)


def test_a_crossing_after_another_switch_is_left_out():
    assert leaves(1.0, -2.0, 0.0, before=0.4) == 2.0
    assert leaves(1.0, -2.0, 0.0, before=0.6) == pytest.approx(0.5, abs=1e-9)


def test_leaving_agrees_with_a_fine_search():
    s = np.linspace(0.0, 1.0, 200001)
    for row, found in zip(POLYNOMIALS, leaving()[::2, 0], strict=True):
        below = np.polynomial.polynomial.polyval(s, row) < -1e-10
        first = s[np.argmax(below)] if below.any() else 2.0
        assert found == pytest.approx(first, abs=1e-3), row
