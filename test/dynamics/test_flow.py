"""A gear as a map over its period, and its monodromy across switching and grazing."""

from __future__ import annotations

import numpy as np
import pytest
from gears import CONSTANT, LINEAR, after, make
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from herringbone_sim.core.mirror import layout_mirror
from herringbone_sim.core.model import jacobian
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.flow import (
    GearFlow,
    cycles_of,
    effect_cycles,
    forcing_cycles,
    settle,
    symmetry,
)
from herringbone_sim.dynamics.gear_family import GearCache
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import DivergenceError, ParameterError

NONE = np.zeros((0, 8))
GRAZING = 0.4234563182159026  # half-backlash that the swing of ``graze`` just touches
TURN = 2.0 * np.pi
CLOSED = np.arange(8.0)  # a state with all meshes in contact


def differences(flow, y, d):
    """Central differences (n, n) of the map."""
    steps = d * np.eye(flow.n)
    columns = [flow.advance(y + s, NONE)[0] - flow.advance(y - s, NONE)[0] for s in steps]
    return np.array(columns).T / (2.0 * d)


def forward(flow, y, direction, d):
    """(F(y + d u) - F(y)) / d."""
    return (flow.advance(y + d * direction, NONE)[0] - flow.advance(y, NONE)[0]) / d


@pytest.mark.parametrize("kind", ["reduced", "uneven"])
def test_the_map_is_the_run_to_the_last_bit(gear, uneven, kind):
    model = gear(delta_T=20.0) if kind == "reduced" else uneven(Omega=0.7)
    flow = GearFlow(model)
    assert np.array_equal(settle(flow, flow.start(), 5), after(model, 5, flow.start()))
    assert flow.period == pytest.approx(TURN / model.packed.Omega)


def test_arguments_are_left_alone(gear):
    flow = GearFlow(gear())
    y, tangents = flow.start(), np.eye(8)
    flow.advance(y, tangents)
    assert np.array_equal(y, flow.start())
    assert np.array_equal(tangents, np.eye(8))


def test_monodromy_of_constant_coefficients_is_an_exponential(gear):
    model = gear(**LINEAR, **CONSTANT)
    _, monodromy = GearFlow(model).map(CLOSED)
    assert monodromy == pytest.approx(expm(TURN * jacobian(model, CLOSED, 0.0)), abs=1e-11)


def test_monodromy_of_periodic_stiffness_is_that_of_hills_equation(gear):
    """Against DOP853 on dM/dtau = J(tau) M, with the Jacobian written out in NumPy."""
    model = gear(**LINEAR, k_amp=(0.25, 0.1), xi=0.03)

    def slope(tau, flat):
        return (jacobian(model, CLOSED, tau) @ flat.reshape(8, 8)).ravel()

    exact = solve_ivp(slope, (0.0, TURN), np.eye(8).ravel(), "DOP853", rtol=1e-11, atol=1e-12)
    _, monodromy = GearFlow(model).map(CLOSED)
    assert monodromy == pytest.approx(exact.y[:, -1].reshape(8, 8), abs=1e-9)


@pytest.mark.parametrize("kind", ["reduced", "uneven"])
def test_determinant_is_the_loss_by_damping(gear, uneven, kind):
    """Liouville: det M = exp(period trace J), and the trace is the same in and out of contact."""
    model = gear(delta_T=20.0) if kind == "reduced" else uneven()
    flow = GearFlow(model)
    y, monodromy = flow.map(settle(flow, flow.start(), 20))
    trace = np.trace(jacobian(model, y, 0.0))
    sign, logarithm = np.linalg.slogdet(monodromy)
    assert sign == 1.0
    assert logarithm == pytest.approx(flow.period * trace, rel=1e-9)


def test_saltation_is_the_identity_where_borders_are_crossed(gear):
    """Across transversal crossings the map is smooth: central differences err as d^2."""
    flow = GearFlow(gear(delta_T=20.0))
    y = settle(flow, flow.start(), 50)
    _, monodromy = flow.map(y)
    errors = [np.abs(differences(flow, y, d) - monodromy).max() for d in (3e-3, 3e-4, 3e-5)]
    assert np.abs(monodromy).max() > 0.3
    assert errors[-1] < 1e-6
    assert np.log10(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)
    assert np.log10(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.1)


def graze(b):
    """A flow and a state whose swing touches the border once, and crosses none before."""
    flow = GearFlow(make(delta_T=0.0, initial_v=(-0.35,), b=b))
    return flow, flow.start()


def test_at_grazing_the_map_has_one_derivative_and_no_second():
    """A border entered by a depth d is held for a time like d^(1/2), so the derivative is that
    without contact, and the difference quotient approaches it like d^(1/2) on the touching side;
    on the other side there is no contact, and the map is linear.
    """
    flow, y = graze(GRAZING)
    _, monodromy = flow.map(y)
    _, free = GearFlow(make(delta_T=0.0, b=2.0)).map(y)
    assert monodromy == pytest.approx(free, abs=1e-12)
    inwards = np.repeat([0.0, 1.0], 4)
    sizes = 10.0 ** -np.arange(3, 9)

    def errors(u):
        return [np.abs(forward(flow, y, u, d) - monodromy @ u).max() for d in sizes]

    slopes = np.diff(np.log10(errors(inwards)))
    assert slopes == pytest.approx(np.full(5, -0.5), abs=0.02)
    assert errors(inwards)[-1] < 1e-4
    assert max(errors(-inwards)[:3]) < 1e-10


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("gap", [1e-3, 1e-5, 1e-7])
def test_near_grazing_differences_agree_once_they_are_smaller_than_the_gap(side, gap):
    flow, y = graze(GRAZING + side * gap)
    _, monodromy = flow.map(y)
    wide, narrow = (np.abs(differences(flow, y, d * gap) - monodromy).max() for d in (10.0, 0.01))
    assert wide > 5e-3
    assert narrow < 1e-4


def test_symmetry_of_a_gear(gear, uneven):
    """Mirrored states move as mirror images, to the last bit, where the halves are alike."""
    for model in (gear(delta_T=20.0), gear(model="full", phasing="geometric", k_amp=())):
        flow, exchange = GearFlow(model), symmetry(model)
        y = np.random.default_rng(1).normal(size=flow.n)
        assert np.array_equal(exchange[exchange], np.arange(flow.n))
        mirrored, _ = flow.advance(y[exchange], np.zeros((0, flow.n)))
        assert np.array_equal(mirrored, flow.advance(y, np.zeros((0, flow.n)))[0][exchange])
    names = np.array(model.layout.state_names)
    assert all(a[:-1] == b[:-1] and a != b for a, b in zip(names, names[exchange], strict=True))
    assert symmetry(uneven()) is None
    for change in ({"I_s_factor": (1.0, 1.01)}, {"control_on": (1.0, 0.0, 1.0, 1.0)}):
        assert symmetry(gear(**change)) is None
    assert np.array_equal(layout_mirror(gear().layout), [1, 0, 3, 2, 5, 4, 7, 6])


def test_a_control_of_half_order_repeats_after_two_cycles(gear):
    """By the map of two cycles a forced linear gear settles; by that of one it never does."""
    model = gear(**LINEAR, xi=0.2, K=0.3, control_order=0.5)
    flow = GearFlow(model)
    y = settle(flow, flow.start(), 100)
    assert flow.cycles == 2
    assert np.abs(flow.advance(y, NONE)[0] - y).max() < 1e-9
    assert np.abs(after(model, 1, y) - y).max() > 1e-3
    assert GearFlow(make(control_order=0.5)).cycles == 1


def test_orders_that_never_repeat_are_refused():
    assert [cycles_of(order) for order in (1.0, 2.0, 1.5, 0.1, 7 / 3)] == [1, 1, 2, 10, 3]
    with pytest.raises(ParameterError, match="ratio of whole numbers"):
        cycles_of(2.0**0.5)


def test_what_has_no_tangents_and_what_has_no_bounds(gear):
    with pytest.raises(ParameterError, match="method: taylor"):
        GearFlow(gear(method="rk4")).map(np.zeros(8))
    with pytest.raises(DivergenceError):
        GearFlow(gear()).advance(np.full(8, 1e9), NONE)


def test_orbits_over_the_amplitude_have_one_forcing_period_at_zero_too(gear):
    """A control of order one half repeats after two mesh cycles, one of amplitude 0 after one."""
    gears = GearCache(gear(control_order=0.5).parameters, "K")
    assert gears(0.0).cycles == gears(0.01).cycles == 2


def test_the_forcing_repeats_with_control_and_effects_together(gear):
    assert forcing_cycles(gear(K=0.1, control_order=0.05)) == 20
    assert forcing_cycles(gear(K=0.0, control_order=0.05)) == 1
    assert forcing_cycles(gear(K=0.1, control_order=2.0**0.5)) == 1  # none together


@pytest.mark.parametrize("order", [1 / 3, 0.618034])
def test_the_control_does_not_count_in_the_period_of_effects(order):
    """A free pin feels the control through the carrier."""
    actives = read_effects("bearing_clearance; tooth_crack@sp/all/L")
    assert effect_cycles(build_with(Parameters(K=0.1, control_order=order), actives)) == 27
