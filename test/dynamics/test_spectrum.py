"""The Lyapunov spectrum by the tangent flow, on systems whose exponents are known."""

from __future__ import annotations

import numpy as np
import pytest
from flows import Henon, Lorenz
from gears import CONSTANT, LINEAR

from herringbone_sim.core.integrate import largest_exponent
from herringbone_sim.core.model import jacobian
from herringbone_sim.dynamics.flow import GearFlow, settle
from herringbone_sim.dynamics.growth import Growth, batch_error
from herringbone_sim.dynamics.spectrum import kaplan_yorke, lyapunov_spectrum
from herringbone_sim.errors import AnalysisError

HENON = [0.4192, -1.6229]
LORENZ = [0.9056, 0.0, -14.5723]


def test_henon_map():
    found = lyapunov_spectrum(Henon(), np.array([0.1, 0.1]), periods=10000)
    assert found.errors.max() < 0.01
    assert found.exponents == pytest.approx(HENON, abs=0.015)
    assert found.exponents.sum() == pytest.approx(np.log(0.3), abs=1e-9)
    assert kaplan_yorke(found.exponents) == pytest.approx(1.2583, abs=0.01)


def test_lorenz_system():
    found = lyapunov_spectrum(Lorenz(), settle(Lorenz(), np.ones(3), 100), periods=1500)
    assert found.exponents == pytest.approx(LORENZ, abs=0.05)
    assert np.abs(found.exponents - LORENZ)[[0, 2]].max() < 4.0 * found.errors.max()
    assert found.exponents.sum() == pytest.approx(-41.0 / 3.0, abs=2e-3)
    assert kaplan_yorke(found.exponents) == pytest.approx(2.062, abs=0.01)


@pytest.mark.parametrize("k_amp", [(), (0.25,)], ids=["constant", "periodic"])
def test_a_gear_that_keeps_contact_has_the_exponents_of_its_multipliers(gear, k_amp):
    """ln |eigenvalues of the monodromy matrix| / period; those of the Jacobian when constant."""
    model = gear(**LINEAR | CONSTANT | {"k_amp": k_amp, "xi": 0.15})
    flow, y = GearFlow(model), np.arange(8.0)
    _, monodromy = flow.map(y)
    expected = np.sort(np.log(np.abs(np.linalg.eigvals(monodromy))))[::-1] / flow.period
    if not k_amp:
        real = np.linalg.eigvals(jacobian(model, y, 0.0)).real
        assert expected == pytest.approx(np.sort(real)[::-1], abs=1e-9)
    found = lyapunov_spectrum(flow, y, periods=2000, transient=300)
    assert found.exponents == pytest.approx(expected, abs=5e-4)


@pytest.mark.parametrize("kind", ["reduced", "uneven"])
def test_sum_of_all_is_the_mean_divergence(gear, uneven, kind):
    """Damping acts in and out of contact: the trace of the Jacobian is constant."""
    model = gear(delta_T=20.0) if kind == "reduced" else uneven()
    flow = GearFlow(model)
    found = lyapunov_spectrum(flow, flow.start(), periods=60, transient=5)
    trace = np.trace(jacobian(model, flow.start(), 0.0))
    assert found.exponents.sum() == pytest.approx(trace, rel=1e-9)


def test_largest_exponent_is_that_of_the_stepper(gear):
    model = gear(delta_T=20.0)
    flow = GearFlow(model)
    y = settle(flow, flow.start(), 200)
    found = lyapunov_spectrum(flow, y, periods=1500)
    value, error = largest_exponent(model, cycles=1500)
    assert np.all(np.diff(found.exponents) <= 0.0)
    assert found.exponents[0] == pytest.approx(value, abs=4.0 * np.hypot(error, found.errors[0]))
    assert found.exponents[0] > 20.0 * found.errors[0]
    few = lyapunov_spectrum(flow, y, periods=1500, k=2)
    assert few.exponents == pytest.approx(found.exponents[:2], abs=0.01)


def test_convergence_ends_at_the_exponents_and_the_error_is_honest():
    """Of ten stretches, the errors tell how far each lies from the exact value."""
    found = lyapunov_spectrum(Henon(), np.array([0.1, 0.1]), periods=10000, k=1)
    assert found.running[-1] == pytest.approx(found.exponents)
    parts = [Growth(p, 1.0, found.end) for p in np.split(found.logarithms, 10)]
    off = np.array([(p.exponents[0] - HENON[0]) / p.errors[0] for p in parts])
    assert 0.3 < np.sqrt(np.mean(off**2)) < 2.5
    assert found.finite_time(1000)[:, 0] == pytest.approx([p.exponents[0] for p in parts])
    off = np.abs(found.running[:, 0] - HENON[0])
    assert off[-1] < 0.3 * off[10:100].max()


def test_dimension_of_what_has_none_and_of_what_fills_all():
    assert kaplan_yorke(np.array([-0.1, -0.2])) == 0.0
    assert kaplan_yorke(np.array([0.0, -0.2])) == 1.0
    assert kaplan_yorke(np.array([0.2, -0.1])) == 2.0


def test_wrong_input():
    with pytest.raises(AnalysisError, match=r"k must lie in 1 .. 2"):
        lyapunov_spectrum(Henon(), np.zeros(2), k=3)
    with pytest.raises(AnalysisError, match="20 periods"):
        batch_error(np.zeros((5, 1)))
