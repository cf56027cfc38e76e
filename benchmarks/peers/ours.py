"""Our own rows: the stepper, one value after the other, and ``run_batch``, values in lanes.

``run_batch`` sees by itself that left and right are alike and integrates one half, in the rows
called half; in those without, the halves differ where it does not matter.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

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
from herringbone_sim.core.packed import TWO_PI

SETTINGS = [(8, 8), (8, 12), (8, 16), (10, 8), (12, 8), (12, 12), (12, 16), (16, 8)]
RK4_STEPS = (200, 800, 3200)
LANES = 16
DEFAULT = "order 12, 16 steps (default)"


def label(order: int, steps: int) -> str:
    """How a setting is called in the table."""
    default = (order, steps) == (12, 16)
    return DEFAULT if default else f"order {order}, {steps} steps"


def orbit_methods() -> list[OrbitMethod]:
    """Rows of work (a)."""
    found = []
    for order, steps in SETTINGS:
        values = {"order": order, "steps_per_cycle": steps, "samples_per_cycle": 4}
        found.append(_stepper("ours, one at a time", label(order, steps), values))
    for order, steps in SETTINGS:
        values = {"order": order, "steps_per_cycle": steps, "samples_per_cycle": 4}
        found.append(_lanes("ours, in lanes, half", label(order, steps), values))
    for order, steps in SETTINGS:
        values = {"order": order, "steps_per_cycle": steps, "samples_per_cycle": 4} | BOTH
        found.append(_lanes("ours, in lanes", label(order, steps), values))
    for steps in RK4_STEPS:
        values = {"method": "rk4", "steps_per_cycle": steps, "samples_per_cycle": 4}
        found.append(_stepper("our RK4 (kinks stepped over)", f"{steps} steps", values))
    found.append(_full_model())
    return found


def _full_model() -> OrbitMethod:
    """The same orbit in the full model, three planets, each on its own."""
    stepper = Stepper(rig(model="full"))

    def run(cycles: int) -> Array:
        q, r, dq, dr = orbit_start().reshape(4, 2)
        start = np.concatenate([q, np.repeat(r, 3), dq, np.repeat(dr, 3)])
        end = stepper.advance(at_rest(start), cycles * 16).end.y
        return end[[0, 1, 2, 5, 8, 9, 10, 13]]

    return OrbitMethod("ours, full model", DEFAULT, run)


def _stepper(family: str, setting: str, values: dict[str, object]) -> OrbitMethod:
    stepper = Stepper(rig(**values))
    n = stepper.model.parameters.samples_per_cycle

    def run(cycles: int) -> Array:
        return stepper.advance(at_rest(orbit_start()), cycles * n).end.y

    return OrbitMethod(family, setting, run)


def _lanes(family: str, setting: str, values: dict[str, object]) -> OrbitMethod:
    models = [rig(**values)] * LANES
    starts = np.repeat(orbit_start()[None], LANES, axis=0)

    def run(cycles: int) -> Array:
        return run_batch(models, starts, transient=0, cycles=cycles, points=1).end[-1]

    return OrbitMethod(family, setting, run, lanes=LANES)


def diagram_methods() -> list[SweepMethod]:
    """Rows of work (b), the base of the ratios first."""
    coarse = {"order": 12, "steps_per_cycle": 8, "samples_per_cycle": 4}
    return [
        SweepMethod("ours, in lanes, half", DEFAULT, sections_in_lanes),
        SweepMethod("ours, in lanes, half", DEFAULT, _halved(sections_in_lanes), cores=2),
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

    return [
        SweepMethod("ours, in lanes, half", DEFAULT, in_lanes),
        SweepMethod("ours, in lanes, half", DEFAULT, _halved(in_lanes), cores=2),
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


def _halved(run):
    """The same on two threads: the kernel leaves the interpreter's lock alone."""

    def work(values: Array) -> Array:
        order = np.argsort(np.arange(len(values)) % 2, kind="stable")
        with ThreadPoolExecutor(2) as pool:
            parts = list(pool.map(run, [values[::2], values[1::2]]))
        found = np.concatenate(parts)
        return found[np.argsort(order, kind="stable")]

    return work
