"""pynamicalsys' rows for the exponent: compiled right-hand side and Jacobian, one exponent."""

from __future__ import annotations

import numpy as np
from numba import njit
from pynamicalsys import ContinuousDynamicalSystem

from benchmarks.peers.methods import SweepMethod
from benchmarks.peers.problem import (
    TRANSIENT,
    Array,
    constants,
    paper,
    slope,
    tangent_slope,
    zero_start,
)
from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import TWO_PI


@njit
def _rate(tau, y, p):
    dy = np.empty(8)
    slope(tau, y, p, dy)
    return dy


@njit
def _jacobian(tau, y, p):
    columns = np.empty((8, 8))
    unit = np.zeros(8)
    for k in range(8):
        unit[k] = 1.0
        tangent_slope(tau, y, p, unit, columns[k])
        unit[k] = 0.0
    return columns.T.copy()


def exponent_methods(cycles: int) -> list[SweepMethod]:
    """Rows of work (c): fixed steps of RK4, and adaptive ones."""
    return [
        _method("RK4, 200 steps", cycles, "rk4", {"time_step": TWO_PI / 200}),
        _method("RK45, rtol 1e-8", cycles, "rk45", {"rtol": 1e-8, "atol": 1e-10}),
    ]


def _method(setting: str, cycles: int, integrator: str, options: dict[str, float]) -> SweepMethod:
    system = ContinuousDynamicalSystem(
        equations_of_motion=_rate, jacobian=_jacobian, system_dimension=8, number_of_parameters=15
    )
    system.integrator(integrator, **options)

    def run(values: Array) -> Array:
        return np.array([_exponent(system, paper(value), cycles) for value in values])

    return SweepMethod("pynamicalsys", setting, run, most=4)


def _exponent(system: ContinuousDynamicalSystem, model: Model, cycles: int) -> float:
    return float(
        system.lyapunov(
            zero_start(model),
            (TRANSIENT + cycles) * TWO_PI,
            parameters=constants(model),
            transient_time=TRANSIENT * TWO_PI,
            num_exponents=1,
        )
    )
