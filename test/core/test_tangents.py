"""The tangent flow and its exponents."""

from __future__ import annotations

import numpy as np
import pytest
from gears import LINEAR, after, samples

from herringbone_sim.core.integrate import Stepper, largest_exponent
from herringbone_sim.core.model import jacobian
from herringbone_sim.errors import ParameterError


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


@pytest.mark.parametrize("cycles", [2, 5, 25])
def test_exponent_is_the_growth_over_the_cycles_that_were_asked_for(gear, cycles):
    model = gear(delta_T=20.0)
    stepper = Stepper(model)
    begin = stepper.advance(stepper.start(tangents=1), 10 * 16).end
    end = stepper.advance(begin, cycles * 16).end
    growth = (end.growth[0] - begin.growth[0]) / (cycles * 2.0 * np.pi / model.packed.Omega)
    assert largest_exponent(model, cycles, 10)[0] == pytest.approx(growth, rel=1e-12)


def test_one_cycle_gives_no_standard_error(gear):
    with pytest.raises(ParameterError, match=r"at least 2 mesh cycles .*, got 1 "):
        largest_exponent(gear(), 1)


@pytest.mark.parametrize("delta_T", [85.0, 90.0])
def test_exponent_is_negative_and_the_period_one_when_hot(gear, delta_T):
    model = gear(delta_T=delta_T)
    settled = samples(model, 4000).end
    assert np.abs(samples(model, 1, settled).end.y - settled.y).max() < 1e-9
    exponent, error = largest_exponent(model, state=settled)
    assert exponent < -0.005
    assert error < 1e-3
