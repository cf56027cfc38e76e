"""Runs the cases of ``test_pure_python.py`` in this process and saves what they give.

NUMBA_DISABLE_JIT=1 python interpreted.py OUT.npz    # by the interpreter
NUMBA_DISABLE_JIT=0 python interpreted.py OUT.npz    # compiled
"""

from __future__ import annotations

import math
import sys

import numpy as np
from gears import UNEVEN, make
from numba import config

from herringbone_sim.core import orbit, sensitivity
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.lanes import columns as lane_columns
from herringbone_sim.core.lanes import extended as lane_extended
from herringbone_sim.core.lanes import nonlinear_forces, nonlinear_moves, nonlinear_series
from herringbone_sim.core.lanes import run as lane_run
from herringbone_sim.core.lanes import series as lane_series
from herringbone_sim.core.lanes import switching as lane_switching
from herringbone_sim.core.lanes.vector import LANES
from herringbone_sim.core.mirror import state_mirror
from herringbone_sim.core.run import Kernel
from herringbone_sim.core.sensitivity import Directions
from herringbone_sim.core.switching import leaves_at
from herringbone_sim.effects.assemble import assemble
from herringbone_sim.effects.sensitivity import directions
from herringbone_sim.effects.trajectory import trajectory
from herringbone_sim.effects.written import read_effects

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


# Gears with effects: all that the kernel without powers knows, and that with powers.
EVENTS = (
    "tooth_crack@sp:depth=0.3,member=sun,position=0.4,width=0.5; "
    "tooth_spall@rp:height=4e-6,member=ring,position=0.3,width=0.4; torque_ripple:amplitude=0.2; "
    "runout@rp:member=ring,amplitude=5e-6"
)
BENDS = (
    "tooth_friction:mu=0.08; contact_nonlinearity@sp:exponent=1.1; "
    "damping_law@rp:share=0.4,power=0.5,depth=1e-5; ring_flexibility@rp:stiffness=3e9; "
    "bearing_clearance:clearance=5e-6"
)
ROUND = "bearing_clearance:clearance=5e-6,softness=0.1"
RUBS = "tooth_friction:mu=0.08; ring_flexibility@rp:stiffness=3e9; damping_law:share=1,power=0"
JUMPS = "damping_law:share=0.4,power=0,depth=1e-5; bearing_clearance:clearance=5e-6"
HOT = {"xi": 0.07, "delta_T": 90.0, "K": 0.1}
SLOW = {"method": "rk4", "steps_per_cycle": 32}
EFFECT_CASES = {
    "events": (EVENTS, HOT, 20, 1),
    "bends": (BENDS, HOT, 6, 1),
    "jumps": (JUMPS, HOT, 16, 1),
    "rubs": (RUBS, HOT, 16, 1),
    "round": (ROUND, HOT, 4, 1),
    "rk4": (f"{EVENTS}; tooth_friction:mu=0.08; {JUMPS}", HOT | SLOW, 10, 0),
    "rk4_bends": (f"{BENDS},softness=0.1", HOT | SLOW, 10, 0),
}
EFFECT_BATCHES = {
    name: (text, True)
    for name, text in (
        ("events", EVENTS),
        ("bends", BENDS),
        ("jumps", JUMPS),
        ("rubs", RUBS),
        ("round", ROUND),
    )
}

# Gears with columns, and by what: of either kind of kernel, with jumps and own coordinates.
COLUMN_CASES = {
    "plain": ("", ["delta_T", "Omega", "k_factor[0]"]),
    "jumps": (JUMPS, ["b", "bearing_clearance:clearance"]),
    "powers": ("contact_nonlinearity@sp:exponent=1.1", ["contact_nonlinearity@sp:exponent"]),
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


LANES_CASES = {
    "alike": ([{"delta_T": 90.0}, {"delta_T": 90.0, "K": 0.1, "control_order": 0.5}], 3, True),
    "unlike": ([{"xi": 0.2, "phi_a": (0.0, 0.3, 0.1, 0.5), "k_amp": (0.25, 0.1)}], 2, True),
    "full": ([UNEVEN | {"delta_T": 90.0}], 1, False),
    "touching": ([{"delta_T": 0.0, "b": 0.0, "initial_x": (0.0, 0.0, 0.1, -0.1)}], 2, False),
    "bounces": ([COARSE | {"order": 20, "phi_a": (0.0, 0.3, 0.1, 0.5)}], 6, False),
    "grazes": ([SWING | {"b": 0.4234563182159026 - 1e-4}], 1, False),
    "no_harmonics": ([{"k_amp": (), "e_amp": (), "initial_x": (1.0,)}], 2, False),
    "runaway": ([{"initial_x": (1e7,)}, {"delta_T": 80.0}], 2, False),
    "many": ([{"delta_T": 80.0 + i} for i in range(18)], 1, False),
}


# What ``core.lanes.vector`` and ``core.reference`` compile, for the interpreter; products are not
# fused there, and a table of references holds indices of ``TUPLES``.
TUPLES = []
VECTOR = {
    "load": lambda a, i, j: a[i, j].copy(),
    "choose": np.where,
    "get": lambda a, i, j, lane: a[i, j, lane] if a.ndim == 3 else a[i, j],
    "n_lanes": lambda a: LANES if a.ndim == 3 else 1,
    "fma": lambda a, b, c: a * b + c,
    "root": np.sqrt,
    "nearest": np.rint,
    "absolute": np.abs,
    "without": np.logical_not,
    "row_of": lambda like, rows, i: TUPLES[rows[i, 0]],
    "bits": lambda where: sum(1 << i for i, bit in enumerate(np.atleast_1d(where)) if bit),
}


def tables(tuples):
    TUPLES.extend(tuples)
    return np.arange(len(TUPLES) - len(tuples), len(TUPLES))[:, None]


def store(a, i, j, x):
    a[i, j] = x


def put(a, i, j, lane, x):
    a[(i, j, lane)[: a.ndim]] = x


def read_lanes():
    """Let the interpreter run the lanes: vectors become arrays of NumPy."""
    vector = VECTOR | {"store": store, "put": put, "tables": tables}
    for module in (
        sensitivity,
        *(orbit, lane_run, lane_series, lane_switching, lane_extended),
        *(lane_columns, nonlinear_forces, nonlinear_series, nonlinear_moves),
    ):
        for name in vars(module).keys() & vector.keys():
            setattr(module, name, vector[name])
    np.seterr(all="ignore")


def lane_models():
    """Models of the batches, by name."""
    return {name: [make(**one) for one in sets] for name, (sets, _, _) in LANES_CASES.items()}


def lanes(models_of):
    """Sections, ends, exponents and contact of the batches, by name."""
    found = {}
    for name, models in models_of.items():
        _, cycles, exponents = LANES_CASES[name]
        # The interpreter takes most of its time for all planets apart: one cycle will do.
        before = 0 if name == "full" else 1
        batch = run_batch(models, None, before, cycles, cycles, exponents)
        parts = [batch.sections, batch.end, batch.contact, batch.exponents]
        found[f"lanes_{name}"] = np.concatenate([part.ravel() for part in parts])
    return found


def ready_with_columns():
    """(gear, directions) of every gear with columns, by name."""
    made = {
        name: directions(assemble(make(**HOT), read_effects(text)), names)
        for name, (text, names) in COLUMN_CASES.items()
    }
    return {name: (gear, found, COLUMN_CASES[name][1]) for name, (gear, found) in made.items()}


def with_columns(cases):
    """Columns of gears in the stepper, by name; from a state in which meshes lose contact."""
    found = {}
    for name, (gear, _, names) in cases.items():
        y = np.linspace(-0.4, 0.4, gear.n_state)
        path = trajectory(gear, y, 8, names)
        found[f"columns_{name}"] = np.concatenate([path.columns.ravel(), path.by_start.ravel()])
    return found


def lanes_with_columns(cases):
    """Columns of gears in lanes, by name; of the gear with powers for one half."""
    found = {}
    for name, (gear, wanted, _) in cases.items():
        y = np.linspace(-0.4, 0.4, gear.n_state)
        if name == "powers":
            y = 0.5 * (y + y[state_mirror(gear)])
        batch = run_batch([Directions(gear, wanted)], y[None], 0, 1, 1)
        found[f"column_lanes_{name}"] = batch.columns
    return found


def ready_with_effects():
    """(stepper, start, samples) of every gear with effects, by name."""
    found = {}
    for name, (text, values, n, k) in EFFECT_CASES.items():
        stepper = Stepper(assemble(make(**values), read_effects(text)))
        found[name] = stepper, stepper.start(k), n
    return found


def batches_with_effects():
    """Models of the batches with effects, by name."""
    return {
        name: [assemble(make(**HOT), read_effects(text)), assemble(make(), read_effects(text))]
        for name, (text, _) in EFFECT_BATCHES.items()
    }


def lanes_with_effects(models_of):
    """Ends, exponents and contact of the batches with effects, by name."""
    found = {}
    for name, models in models_of.items():
        batch = run_batch(models, None, 0, 1, 1, EFFECT_BATCHES[name][1])
        parts = [batch.end, batch.contact, batch.exponents]
        found[f"effect_lanes_{name}"] = np.concatenate([part.ravel() for part in parts])
    return found


def with_effects(cases):
    """Rows, end states and tangents of gears with effects, and their map, by name."""
    found = {}
    for name, (stepper, start, n) in cases.items():
        block = stepper.advance(start, n)
        parts = [block.rows, block.end.y, block.end.growth, block.end.tangents]
        model = stepper.model
        y, tangents = start.y.copy(), np.eye(model.n_state)[: len(start.tangents)]
        Kernel(model).advance_cycles(y, tangents, 0, 1)
        found[f"effects_{name}"] = np.concatenate([part.ravel() for part in (*parts, y, tangents)])
    return found


def whole_cycles(cases):
    """State and tangents after two cycles, without samples."""
    found = {}
    for name in ("reduced", "rk4"):
        stepper, start, _ = cases[name]
        model = stepper.model
        y, tangents = start.y.copy(), np.eye(model.layout.n_state)
        Kernel(model).advance_cycles(y, tangents, 0, 2)
        found[f"cycles_{name}"] = np.vstack([y, tangents])
    return found


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
    cases, batches = ready(), lane_models()
    others, more = ready_with_effects(), batches_with_effects()
    beside = ready_with_columns()
    if config.DISABLE_JIT:
        read_lanes()
    found = lanes(batches) | lanes_with_effects(more) | with_effects(others)
    found |= lanes_with_columns(beside) | with_columns(beside)
    if config.DISABLE_JIT:
        # Compiled code calls the C library; NumPy has a cosine of its own on some processors.
        np.cos, np.sin = math.cos, math.sin
    found |= results(cases) | whole_cycles(cases)
    np.savez(sys.argv[1], leaving=leaving(), **found)
