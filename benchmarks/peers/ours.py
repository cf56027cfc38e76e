"""Our own rows: the stepper, one value after the other, and ``run_batch``, values in lanes.

``run_batch`` sees by itself that left and right are alike and integrates one half, in the rows
called half; in those without, the halves differ where it does not matter.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.peers.methods import OrbitMethod, SweepMethod
from benchmarks.peers.problem import (
    BOTH,
    OBSERVED,
    TRANSIENT,
    Array,
    at_rest,
    initial_tangent,
    orbit_start,
    paper,
    rig,
)
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.lanes.vector import LANES
from herringbone_sim.core.packed import TWO_PI

SETTINGS = [(8, 8), (8, 12), (8, 16), (10, 8), (12, 8), (12, 12), (12, 16), (16, 8)]
RK4_STEPS = (200, 800, 3200)
DEFAULT = "order 12, 16 steps (default)"


def label(order: int, steps: int) -> str:
    """How a setting is called in the table."""
    default = (order, steps) == (12, 16)
    return DEFAULT if default else f"order {order}, {steps} steps"


def orbit_methods() -> list[OrbitMethod]:
    """Rows of work (a)."""
    taylor: dict[str, dict[str, Any]] = {
        label(order, steps): {"order": order, "steps_per_cycle": steps}
        for order, steps in SETTINGS
    }
    found = [_stepper("ours, one at a time", name, values) for name, values in taylor.items()]
    found += [_lanes("ours, in lanes, half", name, values) for name, values in taylor.items()]
    found += [_lanes("ours, in lanes", name, values | BOTH) for name, values in taylor.items()]
    for steps in RK4_STEPS:
        values: dict[str, Any] = {"method": "rk4", "steps_per_cycle": steps}
        found.append(_stepper("our RK4 (kinks stepped over)", f"{steps} steps", values))
    return [*found, _full_model()]


def _full_model() -> OrbitMethod:
    """The same orbit in the full model, three planets, each on its own."""
    stepper = Stepper(rig(model="full"))

    def run(cycles: int) -> Array:
        q, r, dq, dr = orbit_start().reshape(4, 2)
        start = np.concatenate([q, np.repeat(r, 3), dq, np.repeat(dr, 3)])
        end = stepper.advance(at_rest(start), cycles * 16).end.y
        return end[[0, 1, 2, 5, 8, 9, 10, 13]]

    return OrbitMethod("ours, full model", DEFAULT, run)


def _stepper(family: str, setting: str, values: Mapping[str, object]) -> OrbitMethod:
    stepper = Stepper(rig(samples_per_cycle=4, **values))
    n = stepper.model.parameters.samples_per_cycle

    def run(cycles: int) -> Array:
        return stepper.advance(at_rest(orbit_start()), cycles * n).end.y

    return OrbitMethod(family, setting, run)


def _lanes(family: str, setting: str, values: Mapping[str, object]) -> OrbitMethod:
    models = [rig(samples_per_cycle=4, **values)] * LANES
    starts = np.repeat(orbit_start()[None], LANES, axis=0)

    def run(cycles: int) -> Array:
        return run_batch(models, starts, transient=0, cycles=cycles, points=1).end[-1]

    return OrbitMethod(family, setting, run, lanes=LANES)


def diagram_methods() -> list[SweepMethod]:
    """Rows of work (b), the base of the ratios first."""
    coarse = {"order": 12, "steps_per_cycle": 8, "samples_per_cycle": 4}
    first = SweepMethod("ours, in lanes, half", DEFAULT, sections_in_lanes)
    return [
        first,
        on_two_cores(first),
        SweepMethod(
            "ours, in lanes, half", label(12, 8), lambda v: sections_in_lanes(v, **coarse)
        ),
        SweepMethod("ours, in lanes", DEFAULT, lambda v: sections_in_lanes(v, **BOTH)),
        SweepMethod("ours, one at a time", DEFAULT, sections_one_by_one, most=100),
    ]


def sections_in_lanes(values: Array, **settings: object) -> Array:
    """Sections (n, OBSERVED, 8) by ``run_batch``."""
    models = [paper(value, **settings) for value in values]
    return run_batch(models, None, TRANSIENT, OBSERVED, OBSERVED).sections


def sections_one_by_one(values: Array, **settings: object) -> Array:
    """Sections (n, OBSERVED, 8) by the stepper."""
    found = []
    for value in values:
        model = paper(value, **{"samples_per_cycle": 4} | settings)
        stepper, per_cycle = Stepper(model), model.parameters.samples_per_cycle
        state = stepper.advance(stepper.start(), TRANSIENT * per_cycle).end
        for _ in range(OBSERVED):
            found.append(state.y)
            state = stepper.advance(state, per_cycle).end
    return np.array(found).reshape(len(values), OBSERVED, -1)


def exponent_methods(cycles: int) -> list[SweepMethod]:
    """Rows of work (c), the base of the ratios first."""

    def in_lanes(values: Array) -> Array:
        models = [paper(value) for value in values]
        return run_batch(models, None, TRANSIENT, cycles, 1, exponents=True).exponents

    def both_halves(values: Array) -> Array:
        models = [paper(value, **BOTH) for value in values]
        return run_batch(models, None, TRANSIENT, cycles, 1, exponents=True).exponents

    def one_by_one(values: Array) -> Array:
        return exponents_one_by_one(values, cycles)

    first = SweepMethod("ours, in lanes, half", DEFAULT, in_lanes)
    return [
        first,
        on_two_cores(first),
        SweepMethod("ours, in lanes", DEFAULT, both_halves),
        SweepMethod("ours, one at a time", DEFAULT, one_by_one),
    ]


def exponents_one_by_one(values: Array, cycles: int, **settings: object) -> Array:
    """Largest exponents (n,) by the stepper, one tangent vector along."""
    found = []
    for value in values:
        model = paper(value, **{"samples_per_cycle": 4} | settings)
        stepper, per_cycle = Stepper(model), model.parameters.samples_per_cycle
        state = stepper.advance(stepper.start(), TRANSIENT * per_cycle).end
        state = at_rest(state.y, initial_tangent())
        growth = stepper.advance(state, cycles * per_cycle).end.growth[0]
        found.append(growth / (cycles * TWO_PI))
    return np.array(found)


class Halves:
    """A work on two threads, every other value each: the kernel lets the interpreter's lock go."""

    def __init__(self, run: Callable[[Array], Array]) -> None:
        self.run = run
        self.busiest_s = 0.0

    def __call__(self, values: Array) -> Array:
        with ThreadPoolExecutor(2) as pool:
            (even, one_s), (odd, other_s) = pool.map(self._timed, [values[::2], values[1::2]])
        self.busiest_s = max(one_s, other_s)
        found = np.empty((len(values), *even.shape[1:]))
        found[::2], found[1::2] = even, odd
        return found

    def _timed(self, values: Array) -> tuple[Array, float]:
        start = time.thread_time()
        found = self.run(values)
        return found, time.thread_time() - start

    def remark(self) -> str:
        """Processor time of the busier thread: the time on the wall of a machine at rest."""
        return f"{self.busiest_s:.2f} s of processor time in the busier thread"


def on_two_cores(method: SweepMethod) -> SweepMethod:
    """The same method on two threads."""
    halves = Halves(method.run)
    return replace(method, run=halves, cores=2, remark=halves.remark)
