"""numbalsoda's rows: LSODA and DOP853 in C++ and Fortran, called by and calling compiled code."""

from __future__ import annotations

from collections.abc import Callable

import numbalsoda
import numpy as np
from numba import carray, cfunc, njit

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

MANY = 10**8
RTOLS = (1e-6, 1e-8, 1e-9, 1e-10)
Solver = Callable[..., tuple[Array, bool]]
lsoda, dop853 = numbalsoda.lsoda, numbalsoda.dop853


@cfunc(numbalsoda.lsoda_sig)
def _rate(tau, y, dy, p):
    slope(tau, carray(y, (8,)), carray(p, (15,)), carray(dy, (8,)))


@cfunc(numbalsoda.lsoda_sig)
def _rate_of_half(tau, y, dy, p):
    slope_of_half(tau, carray(y, (4,)), carray(p, (15,)), carray(dy, (4,)))


@cfunc(numbalsoda.lsoda_sig)
def _rate_with_tangent(tau, y, dy, p):
    both, out, c = carray(y, (16,)), carray(dy, (16,)), carray(p, (15,))
    slope(tau, both, c, out)
    tangent_slope(tau, both, c, both[8:], out[8:])


@njit
def _exponent(pointer, both, y, p, transient, z, cycles, rtol):
    ends = np.array([0.0, transient * TWO_PI])
    state = np.empty(16)
    state[:8] = lsoda(pointer, y, ends, p, rtol, rtol * 1e-2, MANY)[0][-1]
    state[8:] = z
    growth = 0.0
    for _ in range(cycles):
        state = lsoda(both, state, np.array([0.0, TWO_PI]), p, rtol, rtol * 1e-2, MANY)[0][-1]
        length = np.sqrt(np.sum(state[8:] ** 2))
        growth += np.log(length)
        state[8:] /= length
    return growth / (cycles * TWO_PI)


def _solve(solver: Solver, half: bool, p: Array, y: Array, times: Array, rtol: float) -> Array:
    """States (n, 8) at times, by the whole gear or by one half that stands for both."""
    pointer, start = (_rate_of_half.address, y[LEFT]) if half else (_rate.address, y)
    found = solver(pointer, start, times, p, rtol, rtol * 1e-2, MANY)[0]
    return found[:, FROM_HALF] if half else found


def orbit_methods() -> list[OrbitMethod]:
    """Rows of work (a)."""
    p, y = constants(rig()), orbit_start()

    def method(name: str, solver: Solver, half: bool, rtol: float) -> OrbitMethod:
        def run(cycles: int) -> Array:
            return _solve(solver, half, p, y, np.array([0.0, cycles * TWO_PI]), rtol)[-1]

        return OrbitMethod(f"numbalsoda {name}", f"rtol {rtol:g}", run)

    kinds = [("LSODA", lsoda, False), ("LSODA, half", lsoda, True), ("DOP853", dop853, False)]
    return [method(*kind, rtol) for kind in kinds for rtol in RTOLS]


def diagram_methods() -> list[SweepMethod]:
    """Row of work (b)."""
    rtol = 1e-9
    times = np.concatenate([[0.0], TRANSIENT + np.arange(OBSERVED)]) * TWO_PI

    def sections(model: Model) -> Array:
        return _solve(lsoda, True, constants(model), zero_start(model), times, rtol)[1:]

    def run(values: Array) -> Array:
        return np.array([sections(paper(value)) for value in values])

    return [SweepMethod("numbalsoda LSODA, half", f"rtol {rtol:g}", run, most=40)]


def exponent_methods(cycles: int) -> list[SweepMethod]:
    """Row of work (c)."""
    rtol = 1e-8
    address, both = _rate.address, _rate_with_tangent.address

    def run(values: Array) -> Array:
        found = []
        for model in map(paper, values):
            start, z = zero_start(model), initial_tangent()
            p = constants(model)
            found.append(_exponent(address, both, start, p, TRANSIENT, z, cycles, rtol))
        return np.array(found)

    return [SweepMethod("numbalsoda LSODA", f"rtol {rtol:g}", run, most=20)]
