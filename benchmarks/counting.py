"""Floating-point operations of the kernels, counted by running their own text on a counting type.

With NUMBA_DISABLE_JIT=1 the kernels are plain Python; fed with ``Counted`` numbers they count
themselves, so the numbers can't go stale. An operation on lanes counts one for each, whether or
not a lane had use for it. Sums, differences, products, quotients and roots count one, a fused
product and sum two, sines and cosines are kept apart; comparisons, magnitudes and moves count
nothing.

    NUMBA_DISABLE_JIT=1 python -m benchmarks.counting

reads a state on the periodic orbit of ``benchmarks.peers`` as JSON and prints the counts.
"""

from __future__ import annotations

import json
import math
import operator
import sys
import warnings
from collections import Counter
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from benchmarks.peers.problem import BOTH, rig
from herringbone_sim.arrays import Array
from herringbone_sim.core import batch, orbit
from herringbone_sim.core.lanes import run, series, switching
from herringbone_sim.core.lanes.vector import LANES
from herringbone_sim.core.packed import TWO_PI, make_work
from herringbone_sim.core.parameters import ParameterWarning
from herringbone_sim.core.right_hand_side import right_hand_side, rk4_step

CYCLES = 2
SETTINGS = [(12, 16), (12, 8)]


class Counted:
    """A number, or one in each lane, that counts what is done to it in ``Counted.done``."""

    done: ClassVar[Counter[str]] = Counter()
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, value: Any) -> None:
        self.value = value

    def __float__(self) -> float:
        return float(self.value)

    def __neg__(self) -> Counted:
        return Counted(-self.value)

    def __abs__(self) -> Counted:
        return Counted(abs(self.value))

    def cos(self) -> Counted:
        return self._call(math.cos)

    def sin(self) -> Counted:
        return self._call(math.sin)

    def _call(self, function: Callable[[float], float]) -> Counted:
        Counted.done["sines and cosines"] += 1
        return Counted(function(self.value))


def plain(x: Any) -> Any:
    """The value of a counted number, or the number itself."""
    return x.value if isinstance(x, Counted) else x


def counted(
    kind: str, function: Callable[..., Any], operations: int = 1
) -> Callable[..., Counted]:
    """A function of values as one of counted numbers."""

    def apply(*operands: Any) -> Counted:
        result = function(*(plain(x) for x in operands))
        Counted.done[kind] += operations * np.size(result)
        return Counted(result)

    return apply


def _compare(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    return lambda a, b: function(plain(a), plain(b))


for _name, _kind in (("add", "sums"), ("sub", "sums"), ("mul", "products"), ("truediv", "rest")):
    _apply = counted(_kind, getattr(operator, _name))
    setattr(Counted, f"__{_name}__", lambda a, b, f=_apply: f(a, b))
    setattr(Counted, f"__r{_name}__", lambda a, b, f=_apply: f(b, a))
for _name in ("lt", "le", "gt", "ge", "eq", "ne"):
    setattr(Counted, f"__{_name}__", _compare(getattr(operator, _name)))


def _load(a: Array, i: int, j: int) -> Counted:
    return Counted(a[i, j].copy())


def _store(a: Array, i: int, j: int, x: Counted) -> None:
    a[i, j] = plain(x)


def _choose(where: Any, a: Counted, b: Counted) -> Counted:
    return Counted(np.where(where, plain(a), plain(b)))


# What ``core.lanes.vector`` compiles, for the interpreter.
VECTOR: dict[str, Callable[..., Any]] = {
    "load": _load,
    "store": _store,
    "choose": _choose,
    "get": lambda a, i, j, lane: a[i, j, lane] if a.ndim == 3 else a[i, j],
    "put": lambda a, i, j, lane, x: a.__setitem__((i, j, lane)[: a.ndim], plain(x)),
    "n_lanes": lambda a: LANES if a.ndim == 3 else 1,
    "fma": counted("fused", lambda a, b, c: a * b + c, 2),
    "root": counted("rest", np.sqrt),
    "nearest": counted("rest", np.rint),
    "absolute": abs,
    "without": np.logical_not,
    "bits": lambda where: sum(1 << i for i, bit in enumerate(np.atleast_1d(where)) if bit),
}


def wrapped(a: Any) -> Any:
    """Arrays and numbers of floats as counted ones, all else as it is."""
    if isinstance(a, float):
        return Counted(a)
    if isinstance(a, np.ndarray) and a.dtype == float:
        return np.array([Counted(x) for x in a.ravel()] + [None], dtype=object)[:-1].reshape(
            a.shape
        )
    return a


def tally(work: Callable[[], object]) -> dict[str, float]:
    """Operations of one run, by kind."""
    Counted.done = Counter()
    work()
    return dict(Counted.done)


def per_cycle(found: dict[str, float], n: int) -> dict[str, float]:
    """The same, of one mesh cycle of one value."""
    return {kind: number / n for kind, number in found.items()}


def of_right_hand_side(start: Array) -> dict[str, float]:
    """Operations of one evaluation of the right-hand side."""
    packed, work, y = scalar_kernel(start)
    return tally(lambda: right_hand_side(packed, work, y, Counted(0.1), 0, work.slope[0]))


def scalar_kernel(start: Array) -> tuple[Any, Any, Any]:
    """Model, scratch and state of work (a), all counted."""
    model = rig()
    layout = model.layout
    work = make_work(layout.n_mesh, layout.n_coordinate)
    packed = type(model.packed)(*(wrapped(a) for a in model.packed))
    return packed, type(work)(*(wrapped(a) for a in work)), wrapped(start)


def read_vectors() -> None:
    """Let the interpreter run the kernel, and count."""
    for module in (orbit, run, series, switching):
        for name in VECTOR.keys() & vars(module).keys():
            setattr(module, name, VECTOR[name])


def of_stepper(start: Array, order: int, steps: int) -> dict[str, float]:
    """Operations of a mesh cycle of the stepper's Taylor steps, samples not counted."""
    read_vectors()
    one = orbit.orbit_of(rig(order=order, steps_per_cycle=steps, samples_per_cycle=4), 0)
    one.work.y[0] = start

    def cycle() -> None:
        for i in range(CYCLES * steps):
            orbit.grid_step(run.move_linear, one, i // steps, i % steps)

    return per_cycle(tally(cycle), CYCLES)


def of_rk4(start: Array, steps: int) -> dict[str, float]:
    """Operations of a mesh cycle of the classical Runge-Kutta method."""
    packed, work, y = scalar_kernel(start)
    step = tally(lambda: rk4_step(packed, work, y, Counted(0.1), 0, Counted(TWO_PI / steps)))
    return {kind: steps * number for kind, number in step.items()}


def of_lanes(start: Array, order: int, steps: int, both: bool) -> dict[str, float]:
    """Operations of a mesh cycle of one value in the lanes; ``both`` halves or one for two."""
    read_vectors()
    values = {"order": order, "steps_per_cycle": steps, "samples_per_cycle": 4}
    models = [rig(**values | (BOTH if both else {}))] * LANES
    starts = np.repeat(start[None], LANES, axis=0)
    found = tally(lambda: batch.run_batch(models, starts, 0, CYCLES, 1))
    return per_cycle(found, LANES * CYCLES)


def count(start: Array) -> dict[str, dict[str, float]]:
    """All counts by name, from a state (8,) on the orbit."""
    found = {"right-hand side": of_right_hand_side(start)}
    for order, steps in SETTINGS:
        name = f"order {order}, {steps} steps"
        found[f"one at a time, {name}"] = of_stepper(start, order, steps)
        found[f"in lanes, {name}, both halves"] = of_lanes(start, order, steps, True)
        found[f"in lanes, {name}, one half for both"] = of_lanes(start, order, steps, False)
    return found | {"RK4, 200 steps": of_rk4(start, 200)}


if __name__ == "__main__":
    warnings.simplefilter("ignore", ParameterWarning)
    print(json.dumps(count(np.array(json.load(sys.stdin)))))
