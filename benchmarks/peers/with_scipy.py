"""SciPy's rows, each as fast as it goes: compiled right-hand side, no object made on the way.

``odeint`` and ``ode`` step in compiled code and call back for each evaluation; a compiled function
that fills one buffer for good is the cheapest such call there is. ``solve_ivp`` steps in Python.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from scipy import integrate

from benchmarks.peers.methods import OrbitMethod, SweepMethod
from benchmarks.peers.problem import (
    FROM_HALF,
    LEFT,
    OBSERVED,
    TRANSIENT,
    Array,
    constants,
    initial_tangent,
    orbit_start,
    paper,
    rig,
    slope,
    slope_of_half,
    tangent_slope,
    zero_start,
)
from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import TWO_PI

Fill = Callable[[float, Array, Array, Array], None]
MANY = 10**7
ORBIT: list[tuple[str, tuple[float, ...]]] = [("LSODA, odeint", (1e-6, 1e-8, 1e-9, 1e-10))]
ORBIT += [("LSODA, odeint, half", (1e-6, 1e-8, 1e-9, 1e-10))]
ORBIT += [("DOP853, ode", (1e-6, 1e-8, 1e-9, 1e-10))]
ORBIT += [("VODE, ode", (1e-8, 1e-10, 1e-11))]
ORBIT += [("LSODA, solve_ivp", (1e-6, 1e-10)), ("DOP853, solve_ivp", (1e-6, 1e-10))]


@njit("void(f8, f8[::1], f8[::1], f8[::1])", error_model="numpy")
def _fill(tau, y, p, dy):
    slope(tau, y, p, dy)


@njit("void(f8, f8[::1], f8[::1], f8[::1])", error_model="numpy")
def _fill_half(tau, y, p, dy):
    slope_of_half(tau, y, p, dy)


@njit("void(f8, f8[::1], f8[::1], f8[::1])", error_model="numpy")
def _fill_with_tangent(tau, y, p, dy):
    slope(tau, y, p, dy)
    tangent_slope(tau, y, p, y[8:], dy[8:])


def _rate(p: Array, fill: Fill = _fill, size: int = 8) -> Callable[[float, Array], Array]:
    out = np.empty(size)

    def rate(tau: float, y: Array) -> Array:
        fill(tau, y, p, out)
        return out

    return rate


def odeint(p: Array, y: Array, times: Array, rtol: float, fill: Fill = _fill) -> Array:
    """States (n, 8) at times from y on, by LSODA in compiled code."""
    options = {"rtol": rtol, "atol": rtol * 1e-2, "mxstep": MANY, "tfirst": True}
    return integrate.odeint(_rate(p, fill, len(y)), y, times, **options)


def _solve(method: str, rtol: float, p: Array, y: Array, end: float) -> Array:
    kind, _, api = method.partition(", ")
    if api == "odeint, half":
        return odeint(p, y[LEFT], np.array([0.0, end]), rtol, _fill_half)[-1][FROM_HALF]
    if api == "odeint":
        return odeint(p, y, np.array([0.0, end]), rtol)[-1]
    if api == "ode":
        solver = integrate.ode(_rate(p))
        options = {"rtol": rtol, "atol": rtol * 1e-2, "nsteps": MANY}
        solver.set_integrator(kind.lower(), **options).set_initial_value(y, 0.0)
        return solver.integrate(end)
    fresh = _rate(p)
    found = integrate.solve_ivp(
        lambda tau, state: fresh(tau, state).copy(),
        (0.0, end),
        y,
        kind,
        rtol=rtol,
        atol=rtol * 1e-2,
    )
    return found.y[:, -1]


def orbit_methods() -> list[OrbitMethod]:
    """Rows of work (a)."""
    p, y = constants(rig()), orbit_start()

    def method(name: str, rtol: float) -> OrbitMethod:
        def run(cycles: int) -> Array:
            return _solve(name, rtol, p, y, cycles * TWO_PI)

        return OrbitMethod(f"SciPy {name}", f"rtol {rtol:g}", run)

    return [method(name, rtol) for name, rtols in ORBIT for rtol in rtols]


def diagram_methods() -> list[SweepMethod]:
    """Row of work (b): the fastest of SciPy's on work (a)."""
    rtol = 1e-9
    times = np.concatenate([[0.0], TRANSIENT + np.arange(OBSERVED)]) * TWO_PI

    def halves(model: Model) -> Array:
        return odeint(constants(model), zero_start(model)[LEFT], times, rtol, _fill_half)[1:]

    def run(values: Array) -> Array:
        return np.array([halves(paper(value)) for value in values])[..., FROM_HALF]

    return [SweepMethod("SciPy LSODA, odeint, half", f"rtol {rtol:g}", run, most=16)]


def exponent_methods(cycles: int) -> list[SweepMethod]:
    """Row of work (c): the tangent vector runs along and is set to length 1 every cycle."""
    rtol = 1e-8

    def run(values: Array) -> Array:
        return np.array([_exponent(paper(value), cycles, rtol) for value in values])

    return [SweepMethod("SciPy LSODA, odeint", f"rtol {rtol:g}", run, most=8)]


def _exponent(model: Model, cycles: int, rtol: float) -> float:
    p = constants(model)
    y = odeint(p, zero_start(model), np.array([0.0, TRANSIENT * TWO_PI]), rtol)[-1]
    z, growth = np.concatenate([y, initial_tangent()]), 0.0
    for _ in range(cycles):
        z = odeint(p, z, np.array([0.0, TWO_PI]), rtol, _fill_with_tangent)[-1]
        length = np.linalg.norm(z[8:])
        growth += np.log(length)
        z[8:] /= length
    return growth / (cycles * TWO_PI)
