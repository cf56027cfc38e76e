"""The 0-1 test for chaos on maps whose answer is known, and on the gear."""

from __future__ import annotations

import numpy as np
import pytest
from flows import circle_map, logistic

from herringbone_sim.analysis.zero_one import LEAST, zero_one_test
from herringbone_sim.dynamics.flow import GearFlow, settle
from herringbone_sim.errors import AnalysisError


def K_of(series, seed=0):
    return zero_one_test(series, np.random.default_rng(seed)).K


@pytest.mark.parametrize("r", [4.0, 3.97, 3.9])
def test_chaos_of_the_logistic_map(r):
    assert K_of(logistic(r, 2000)) > 0.95


@pytest.mark.parametrize("r", [3.2, 3.5, 3.55, 3.83])
def test_periods_of_the_logistic_map(r):
    """P2, P4, P8 and the window of P3."""
    assert abs(K_of(logistic(r, 2000))) < 0.05


def test_a_quasi_periodic_motion_is_regular():
    assert abs(K_of(circle_map(3000))) < 0.1


def test_scale_and_offset_do_not_matter():
    chaos, order = logistic(4.0, 1500), circle_map(1500)
    assert K_of(1e-5 * chaos + 3e-4) == pytest.approx(K_of(chaos), abs=0.02)
    assert abs(K_of(1e-5 * order + 3e-4)) < 0.1


def test_oversampled_chaos_looks_regular():
    """The caveat of the docstring: the same chaos, each step drawn out over 40 samples."""
    chaos = logistic(4.0, 100)
    smooth = np.interp(np.arange(100 * 40) / 40.0, np.arange(100), chaos)
    assert K_of(logistic(4.0, 400)) > 0.9
    assert K_of(smooth) < 0.5


def test_gear(gear):
    """Section of q_L: chaos at delta_T 20; period 1, a constant, at 85."""
    for delta_T, low, high in ((20.0, 0.9, 1.01), (85.0, -0.05, 0.05)):
        flow = GearFlow(gear(delta_T=delta_T))
        points = [settle(flow, flow.start(), 1500)]
        for _ in range(1000):
            points.append(settle(flow, points[-1], 1))
        assert low < K_of(np.array(points)[:, 0]) < high


def test_wrong_input():
    for series in (np.zeros(LEAST - 1), np.zeros((LEAST, 2)), np.full(LEAST, np.nan)):
        with pytest.raises(AnalysisError, match="0-1 test"):
            K_of(series)
