"""Runs the cases of ``test_pure_python.py`` in this process and saves what they give.

NUMBA_DISABLE_JIT=1 python interpreted.py OUT.npz
"""

from __future__ import annotations

import math
import sys

import numpy as np
from gears import UNEVEN, make

from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.switching import leaves_at

COARSE = {"delta_T": 90.0, "steps_per_cycle": 4, "samples_per_cycle": 4}
SWING = {"delta_T": 0.0, "initial_v": (-0.35,), "samples_per_cycle": 4}
CASES = {
    "reduced": ({"delta_T": 90.0, "K": 0.1, "k_amp": (0.25, 0.1)}, 40, 2),
    "full": (UNEVEN | {"delta_T": 90.0}, 30, 1),
    "rk4": ({"method": "rk4", "steps_per_cycle": 32, "K": 0.1, "control_order": 0.5}, 40, 0),
    "touching": ({"delta_T": 0.0, "b": 0.0, "initial_x": (0.0, 0.0, 0.1, -0.1)}, 20, 0),
    "bounces": (COARSE | {"order": 20, "phi_a": (0.0, 0.3, 0.1, 0.5)}, 80, 0),
    "grazes": (SWING | {"b": 0.4234563182159026 - 1e-4}, 4, 1),
    "no_harmonics": ({"k_amp": (), "e_amp": (), "initial_x": (1.0,)}, 20, 0),
    "runaway": ({"method": "rk4", "steps_per_cycle": 4, "samples_per_cycle": 4, "xi": 2.0}, 9, 0),
}


POLYNOMIALS = [
    (0.0, 1.0, -2.0, 0.0),
    (0.0, 1e-6, -1.0, 0.0),
    (-1e-13, 1e-9, -1.0, 0.0),
    (0.0, -1.0, 0.5, 0.0),
    (1.0, -1.0, -1.0, 0.0),
    (1e-20, 0.0, 0.0, -1.0),
    (1.0, -4.0, 4.0 - 1e-9, 0.0),
    (1.0, -4.0, 4.0 + 1e-9, 0.0),
    (0.0, -1.0, 1.5, 0.0),
    (0.3, -1.0, 0.2, 1.0),
    (0.001, -1.0, 0.0, 0.0),
    (1.0, 0.0, 0.0, -1.001),
    (0.0, 1.0, -0.999, 0.0),
    (0.5, 1.0, 1.0, 0.0),
]


def leaving():
    """``leaves_at`` of the polynomials above at level 0, and mirrored at level 0.1."""
    found = []
    for row in POLYNOMIALS:
        for sign, level in ((1.0, 0.0), (-1.0, -0.1)):
            a = np.array(row)[:, None] * sign
            a[0] += level
            end, slope = a.sum(), np.arange(4.0) @ a[:, 0]
            found.append([leaves_at(a, 0, level, sign, end, slope, t) for t in (2.0, 0.01)])
    return np.array(found)


def ready():
    """(stepper, start, samples) of every case, by name."""
    built = {name: (Stepper(make(**values)), n, k) for name, (values, n, k) in CASES.items()}
    return {name: (stepper, stepper.start(k), n) for name, (stepper, n, k) in built.items()}


def results(cases):
    """Rows, end state, tangents and counts of every case, by name."""
    found = {}
    for name, (stepper, start, n) in cases.items():
        block = stepper.advance(start, n)
        found[f"{name}_rows"] = block.rows
        found[f"{name}_end"] = block.end.y
        found[f"{name}_tangents"] = np.column_stack([block.end.growth, block.end.tangents])
        found[f"{name}_counts"] = np.append(block.contact.ravel(), block.switches)
    return found


if __name__ == "__main__":
    cases = ready()
    # Compiled code calls the C library; NumPy has a cosine of its own on some processors.
    np.cos, np.sin = math.cos, math.sin
    np.savez(sys.argv[1], leaving=leaving(), **results(cases))
