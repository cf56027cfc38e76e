"""Error after 20 mesh cycles against cost per mesh cycle: our kernel, RK4, and SciPy.

    python benchmarks/kernel.py [--repeats 9]

The orbit is the rig's at xi 0.07, delta_T 90: periodic, losing contact eight times a cycle. The
error is the largest of the state against order 24 with 128 steps. Costs are medians over repeats
in one thread; with the kernel they hold the writing of 16 samples a cycle. SciPy's methods call
the same compiled right-hand side, through Python once an evaluation.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from herringbone_sim.core.integrate import State, Stepper
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.packed import TWO_PI, compiled, make_work
from herringbone_sim.core.parameters import Parameters, ParameterWarning
from herringbone_sim.core.right_hand_side import right_hand_side

CYCLES = 20
TIMED_CYCLES = 2000
TAYLOR = [(8, 16), (8, 32), (10, 16), (12, 8), (12, 12), (12, 16), (14, 8), (14, 16), (16, 8)]
RK4 = (200, 800, 1600)
SCIPY = [("LSODA", 1e-6), ("LSODA", 1e-10), ("DOP853", 1e-6), ("DOP853", 1e-10)]


@dataclass(frozen=True)
class Line:
    """One method: its name, error after 20 cycles [-], cost [us per mesh cycle] and its spread."""

    name: str
    error: float
    cost_us: float
    spread_us: float


@compiled
def slope(p, w, y, tau, dy):
    right_hand_side(p, w, y, p.Omega * tau, 0, dy)


def gear(**values: object) -> Model:
    """The rig at xi 0.07, delta_T 90, with some values changed."""
    return build(Parameters().changed({"xi": 0.07, "delta_T": 90.0} | values))


def state_at(y: np.ndarray) -> State:
    """State at phase 0 without tangents."""
    return State(y.copy(), 0, 0, 0.0, np.zeros((0, len(y))), np.zeros(0))


def after(model: Model, cycles: int, y: np.ndarray) -> np.ndarray:
    """State (n_state,) so many mesh cycles after y."""
    n = cycles * model.parameters.samples_per_cycle
    return Stepper(model).advance(state_at(y), n).end.y


def timed(work: Callable[[], object], cycles: int, repeats: int) -> tuple[float, float]:
    """Median and interquartile range of the cost [us per mesh cycle], after one run to warm up."""
    work()
    costs = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        costs.append((time.perf_counter() - start) / cycles * 1e6)
    low, middle, high = np.percentile(costs, [25, 50, 75])
    return float(middle), float(high - low)


def kernel_line(name: str, model: Model, y: np.ndarray, exact: np.ndarray, repeats: int) -> Line:
    """Line of a method of our own."""
    error = float(np.abs(after(model, CYCLES, y) - exact).max())
    stepper, start = Stepper(model), state_at(y)
    n = TIMED_CYCLES * model.parameters.samples_per_cycle
    return Line(name, error, *timed(lambda: stepper.advance(start, n), TIMED_CYCLES, repeats))


def scipy_line(method: str, rtol: float, y: np.ndarray, exact: np.ndarray, repeats: int) -> Line:
    """Line of a method of SciPy's."""
    model = gear()
    work = make_work(model.layout.n_mesh, model.layout.n_coordinate, 4)

    def rate(tau: float, state: np.ndarray) -> np.ndarray:
        dy = np.empty_like(state)
        slope(model.packed, work, state, tau, dy)
        return dy

    def solve() -> np.ndarray:
        span = (0.0, CYCLES * TWO_PI)
        found = solve_ivp(rate, span, y, method=method, rtol=rtol, atol=rtol * 1e-2)
        return np.asarray(found.y[:, -1])

    error = float(np.abs(solve() - exact).max())
    return Line(
        f"SciPy {method}, rtol {rtol:g}", error, *timed(solve, CYCLES, max(repeats // 3, 1))
    )


def lines(repeats: int) -> list[Line]:
    """All lines, the default of the package first."""
    y = after(gear(), 3000, Stepper(gear()).start().y)
    exact = after(gear(order=24, steps_per_cycle=128), CYCLES, y)
    found = [kernel_line("default, reduced", gear(), y, exact, repeats)]
    for order, steps in TAYLOR:
        model = gear(order=order, steps_per_cycle=steps, samples_per_cycle=4)
        name = f"Taylor order {order}, {steps} steps"
        found.append(kernel_line(name, model, y, exact, repeats))
    for steps in RK4:
        model = gear(method="rk4", steps_per_cycle=steps, samples_per_cycle=4)
        found.append(kernel_line(f"RK4, {steps} steps", model, y, exact, repeats))
    for method, rtol in SCIPY:
        found.append(scipy_line(method, rtol, y, exact, repeats))
    return [*found, full_line(y, exact, repeats)]


def full_line(y: np.ndarray, exact: np.ndarray, repeats: int) -> Line:
    """Line of the full model with three planets on the same orbit."""

    def spread(state: np.ndarray) -> np.ndarray:
        q, r, dq, dr = state.reshape(4, 2)
        return np.concatenate([q, np.repeat(r, 3), dq, np.repeat(dr, 3)])

    return kernel_line("default, full", gear(model="full"), spread(y), spread(exact), repeats)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9, help="timed runs of each method")
    repeats = parser.parse_args().repeats
    warnings.simplefilter("ignore", ParameterWarning)
    table = lines(repeats)
    base = table[0].cost_us
    print(f"{'method':28} {'error':>9} {'us/cycle':>9} {'+-':>6} {'ratio':>8}")
    for line in table:
        cost = f"{line.cost_us:9.1f} {line.spread_us:6.1f} {line.cost_us / base:8.2f}"
        print(f"{line.name:28} {line.error:9.1e} {cost}")


if __name__ == "__main__":
    main()
