"""How near the kernels come to what one core can do: operations counted, over measured peaks.

    python -m benchmarks.limit [--rounds 9]

Peaks are those of loops of fused multiply-adds, one number at a time and in lanes, measured in the
same run. The operations are counted by ``benchmarks.counting``; sines and cosines of the
scalar kernels (calls of the C library) are left out of the rates. The stepper fuses half of its
operations.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from benchmarks.peers.measure import cpu_name, seconds, summary
from benchmarks.peers.problem import BOTH, at_rest, orbit_start, rig
from herringbone_sim.arrays import Array
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.lanes.vector import LANES, fma, load, store
from herringbone_sim.core.packed import make_work
from herringbone_sim.core.parameters import ParameterWarning
from herringbone_sim.core.right_hand_side import right_hand_side

CHAINS = 12
TURNS = 1_000_000
CYCLES = 2000
VALUES = LANES
CALLS = 100_000
CALLED = "sines and cosines"


@njit(fastmath={"contract"})
def scalar_chains(turns, x, y):
    """Twelve independent chains of fused multiply-adds."""
    a = b = c = d = e = f = g = h = i = j = k = m = 1.0
    for _ in range(turns):
        a, b, c, d = a * x + y, b * x + y, c * x + y, d * x + y
        e, f, g, h = e * x + y, f * x + y, g * x + y, h * x + y
        i, j, k, m = i * x + y, j * x + y, k * x + y, m * x + y
    return a + b + c + d + e + f + g + h + i + j + k + m


@njit
def vector_chains(turns, out, x, y):
    """The same in lanes."""
    a = b = c = d = e = f = g = h = i = j = k = m = load(out, 0, 0)
    for _ in range(turns):
        a, b, c, d = fma(a, x, y), fma(b, x, y), fma(c, x, y), fma(d, x, y)
        e, f, g, h = fma(e, x, y), fma(f, x, y), fma(g, x, y), fma(h, x, y)
        i, j, k, m = fma(i, x, y), fma(j, x, y), fma(k, x, y), fma(m, x, y)
    store(out, 0, 0, a + b + c + d + e + f + g + h + i + j + k + m + load(out, 0, 0))


@njit
def many_right_hand_sides(calls, p, w, y, dy):
    """So many evaluations; each waits for the one before."""
    for _ in range(calls):
        right_hand_side(p, w, y, 1e-9 * dy[0], 0, dy)


def rates(rounds: int) -> tuple[float, float]:
    """Scalar and vector peak [GFLOP/s]."""
    out = np.zeros((1, 1, LANES))
    flops = 2 * CHAINS * TURNS
    scalar = timed(lambda: scalar_chains(TURNS, 0.5, 0.25), rounds)[0]
    vector = timed(lambda: vector_chains(TURNS, out, 0.5, 0.25), rounds)[0]
    return flops / scalar / 1e9, flops * LANES / vector / 1e9


def timed(work: Callable[[], object], rounds: int) -> tuple[float, float]:
    """Median and interquartile range [s], after one run to compile."""
    work()
    return summary(np.array([seconds(work) for _ in range(rounds)]))


def counts() -> dict[str, dict[str, float]]:
    """Operations by kernel and kind, counted by an interpreter of its own."""
    root = str(Path(__file__).parents[1])
    paths = os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])
    found = subprocess.run(
        [sys.executable, "-m", "benchmarks.counting"],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": paths},
        input=json.dumps(orbit_start().tolist()),
        capture_output=True,
        text=True,
        check=True,
    )
    result: dict[str, dict[str, float]] = json.loads(found.stdout)
    return result


def works() -> dict[str, tuple[Callable[[], object], int]]:
    """What is timed, by the names of ``counts``: a run, and what it counts for."""
    found: dict[str, tuple[Callable[[], object], int]] = {
        "right-hand side": (right_hand_sides(), CALLS),
        "RK4, 200 steps": (stepping(method="rk4", steps_per_cycle=200), CYCLES),
    }
    for steps in (16, 8):
        name, values = f"order 12, {steps} steps", {"order": 12, "steps_per_cycle": steps}
        found[f"one at a time, {name}"] = (stepping(**values), CYCLES)
        found[f"in lanes, {name}, both halves"] = (in_lanes(**values, **BOTH), CYCLES * VALUES)
        found[f"in lanes, {name}, one half for both"] = (in_lanes(**values), CYCLES * VALUES)
    return found


def right_hand_sides() -> Callable[[], object]:
    """Evaluations of the right-hand side, one after the other."""
    model = rig()
    work = make_work(model.layout.n_mesh, model.layout.n_coordinate)
    y, dy = orbit_start(), np.zeros(model.layout.n_state)
    return lambda: many_right_hand_sides(CALLS, model.packed, work, y, dy)


def stepping(**values: Any) -> Callable[[], object]:
    """Mesh cycles of the stepper; four samples a cycle are written, their cost is in it."""
    stepper, start = Stepper(rig(samples_per_cycle=4, **values)), at_rest(orbit_start())
    return lambda: stepper.advance(start, CYCLES * 4)


def in_lanes(**values: Any) -> Callable[[], object]:
    """Mesh cycles of a batch."""
    models = [rig(samples_per_cycle=4, **values)] * VALUES
    starts: Array = np.repeat(orbit_start()[None], VALUES, axis=0)
    return lambda: run_batch(models, starts, transient=0, cycles=CYCLES, points=1)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9, help="timed runs of each kernel")
    rounds = parser.parse_args().rounds
    warnings.simplefilter("ignore", ParameterWarning)
    known, timings = counts(), works()
    scalar, vector = rates(rounds)
    print(f"one core ({cpu_name()}): {scalar:.1f} GFLOP/s scalar, {vector:.1f} in lanes")
    print(
        f"{'kernel':50} {'operations':>10} {'sin, cos':>8} {'us':>8} {'+-':>6} "
        f"{'GFLOP/s':>8} {'of peak':>8}"
    )
    for name, found in known.items():
        work, units = timings[name]
        cost, spread = timed(work, rounds)
        flops = sum(number for kind, number in found.items() if kind != CALLED)
        rate = flops * units / cost / 1e9
        peak = vector if name.startswith("in lanes") else scalar
        print(
            f"{name:50} {flops:10.0f} {found.get(CALLED, 0.0):8.0f} {cost / units * 1e6:8.3f} "
            f"{spread / units * 1e6:6.3f} {rate:8.2f} {rate / peak:8.0%}"
        )


if __name__ == "__main__":
    main()
