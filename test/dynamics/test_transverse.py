"""Exponents within and across a symmetry: coupled maps with known ones, and the gear."""

from __future__ import annotations

import numpy as np
import pytest
from flows import CoupledLogistic
from gears import paper

from herringbone_sim.dynamics.flow import GearFlow, settle, symmetry
from herringbone_sim.dynamics.spectrum import lyapunov_spectrum
from herringbone_sim.dynamics.transverse import symmetric_exponents
from herringbone_sim.errors import AnalysisError


def settled(**values):
    model = paper(**values)
    flow = GearFlow(model)
    return flow, settle(flow, flow.start(), 1000), symmetry(model)


@pytest.mark.parametrize("eps", [0.05, 0.2, 0.25, 0.3, 0.4])
def test_coupled_logistic_maps(eps):
    """ln 2 in step, ln 2 + ln |1 - 2 eps| across it: they part where eps < 1/4."""
    flow = CoupledLogistic(eps)
    found = symmetric_exponents(flow, np.full(2, 0.3), flow.exchange, periods=4000, transient=10)
    assert found.within.exponents == pytest.approx([np.log(2.0)], abs=0.02)
    expected = found.within.exponents + np.log(abs(1.0 - 2.0 * eps))
    assert found.transverse.exponents == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("delta_T", [20.0, 70.0])
def test_within_and_across_make_up_the_spectrum(delta_T):
    flow, y, exchange = settled(delta_T=delta_T)
    whole = lyapunov_spectrum(flow, y, periods=500)
    parts = symmetric_exponents(flow, y, exchange, periods=500, k=4)
    both = np.concatenate([parts.within.exponents, parts.transverse.exponents])
    assert np.sort(both)[::-1] == pytest.approx(whole.exponents, abs=3e-3)
    assert both.sum() == pytest.approx(whole.exponents.sum(), abs=1e-9)


def test_symmetric_chaos_of_the_gear_can_t_last():
    """delta_T = 20: the transverse exponent is positive, by many times its error."""
    flow, y, exchange = settled(delta_T=20.0)
    found = symmetric_exponents(flow, y, exchange, periods=800)
    assert found.within.exponents[0] > 0.06
    assert 0.03 < found.transverse.exponents[0] < 0.1
    assert found.transverse.exponents[0] > 10.0 * found.transverse.errors[0]


@pytest.mark.parametrize(
    ("delta_T", "low", "high"), [(70.0, -0.012, -0.003), (85.0, -0.035, -0.015)]
)
def test_periodic_windows_are_stable_but_weakly(delta_T, low, high):
    flow, y, exchange = settled(delta_T=delta_T)
    found = symmetric_exponents(flow, y, exchange, periods=500)
    assert low < found.transverse.exponents[0] < high
    assert found.within.exponents[0] < found.transverse.exponents[0]


def test_a_small_asymmetry_grows_at_the_transverse_rate():
    """Not by tangents: the distance of left from right itself, from 1e-12 on, out of chaos."""
    flow, y, exchange = settled(delta_T=20.0)
    none = np.zeros((0, flow.n))
    rates = []
    for _ in range(30):
        y, _ = flow.advance(y, none)
        now = y + 1e-12 * np.array([1.0, -1.0, 0.5, -0.5, 0.2, -0.2, 0.3, -0.3])
        now = settle(flow, now, 8)
        start = np.linalg.norm(now - now[exchange])
        now = settle(flow, now, 25)
        rates.append(np.log(np.linalg.norm(now - now[exchange]) / start) / (25 * flow.period))
        y = settle(flow, y, 20)
    found = symmetric_exponents(flow, y, exchange, periods=800)
    scatter = np.std(rates) / np.sqrt(len(rates))
    assert np.mean(rates) == pytest.approx(found.transverse.exponents[0], abs=4.0 * scatter)
    assert scatter < 0.01


def test_a_motion_without_the_symmetry_is_refused():
    flow, y, exchange = settled(delta_T=20.0, initial_noise=0.1)
    with pytest.raises(AnalysisError, match="symmetric motion"):
        symmetric_exponents(flow, y, exchange)
