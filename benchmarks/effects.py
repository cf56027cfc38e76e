"""What each effect costs and how exact it is: ``python -m benchmarks.effects [--quick]``.

Beside the gear without effects, in the same run: error of the state after 20 mesh cycles against
order 16 with three times the steps; processor time a mesh cycle of one orbit; processor time of 64
values of delta_T in lanes, 100 + 100 mesh cycles each. Compilation is not counted.

A second table has the example of docs/effects.md as slots and without ``fill``, and effects of the
catalogue by their laws: error against the slots at order 16, of the state after 20 mesh cycles and
of all tangents after one; processor time a mesh cycle of one orbit, of that with one tangent, and
of 8 values of delta_T in a batch. A third has laws that are written for lanes: processor time a
mesh cycle and value of a batch of 64, one after another and in lanes, and how far the ends differ.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.reference import Reference, in_si, integrate
from herringbone_sim.arrays import Array
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.integrate import Stepper, stepper
from herringbone_sim.core.mirror import has_equal_halves
from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters, ParameterWarning
from herringbone_sim.effects.assemble import build_with, by_laws
from herringbone_sim.effects.law_stepper import LawStepper
from herringbone_sim.effects.registry import VARIABLE
from herringbone_sim.effects.written import read_effects

EFFECTS = (
    "",
    "mean_stiffness@sp:factor=1.2",
    "thermal_stiffness:rate=0.001",
    "stiffness_harmonic@sp:order=2,cos=0.05,sin=0.03",
    "backlash_offset@rp:offset=4e-6",
    "thermal_backlash:rate=3e-8",
    "pin_position:offset=3e-6",
    "planet_phase:phase=0.2",
    "profile_error:order=3,cos=2e-6,sin=1e-6",
    "runout@rp:member=ring,amplitude=5e-6",
    "tooth_crack@sp:depth=0.3,member=sun,position=3.2",
    "tooth_spall@rp:height=4e-6,member=ring,position=5.3",
    "torque_ripple:amplitude=0.2,order=3",
    "stagger@all/all/L:phase=0.2",
    "tooth_friction:mu=0.08",
    "damping_law:share=0.4,power=0,depth=1e-5",
    "damping_law:share=0.4,power=0.5,depth=1e-5",
    "contact_nonlinearity:exponent=1.1",
    "ring_flexibility@rp:stiffness=3e9",
    "bearing_clearance:clearance=5e-6",
    "tooth_crack@sp:depth=0.3,member=sun; tooth_friction:mu=0.05",
    "ring_flexibility@rp:stiffness=3e9; tooth_friction:mu=0.08",
    "ring_flexibility@rp:stiffness=3e9; bearing_clearance:clearance=5e-6",
)
ORBIT = {"xi": 0.07, "delta_T": 90.0}
CYCLES, VALUES, LENGTH = 20, 64, 100


OIL = "thermal_damping@sp:rate=-0.004"
BY_LAWS = (
    OIL,
    "tooth_friction:mu=0.08",
    "damping_law:share=0.4,power=0,depth=1e-5",
    "damping_law:share=0.4,power=0.5,depth=1e-5",
    "contact_nonlinearity:exponent=1.1",
    "ring_flexibility@rp:stiffness=3e9",
)
FEW = 8
DRAG = "squeezed_oil:drag=2e4"
IN_LANES = (DRAG, f"{DRAG}; ring_flexibility@rp:stiffness=3e9", f"{DRAG}; tooth_friction:mu=0.08")


def gear(text: str, **values: object) -> Model:
    """The rig on the periodic orbit that loses contact, with effects."""
    return build_with(Parameters(**{**ORBIT, **values}), read_effects(text))


def load_examples() -> None:
    """Make the effects that docs/effects.md shows known by their names."""
    page = Path(__file__).parents[1] / "docs" / "effects.md"
    blocks = [
        text.split("```")[0] for text in page.read_text(encoding="utf-8").split("```python\n")[1:]
    ]
    folder = Path(tempfile.mkdtemp())
    files = []
    for text in blocks:
        if "EFFECT =" in text:
            files.append(folder / f"example_{len(files)}.py")
            files[-1].write_text(text)
    os.environ[VARIABLE] = os.pathsep.join(map(str, files))


def best(do: Callable[[], object], rounds: int) -> float:
    """Least processor time [s] of some rounds, after one that compiles."""
    do()
    found = []
    for _ in range(rounds):
        began = time.process_time()
        do()
        found.append(time.process_time() - began)
    return min(found)


def row(text: str, rounds: int) -> tuple[float, float, float, bool]:
    """Error, seconds a mesh cycle of the stepper, seconds of the lanes, and alike halves."""
    model = gear(text)
    stepper = Stepper(model)
    n = CYCLES * model.parameters.samples_per_cycle
    start = stepper.advance(stepper.start(), 3 * n).end
    fine = Stepper(gear(text, order=16, steps_per_cycle=48)).advance(start, n).end
    error = float(np.abs(stepper.advance(start, n).end.y - fine.y).max())
    one = best(lambda: stepper.advance(start, n), rounds) / CYCLES
    gears = [gear(text, delta_T=value) for value in np.linspace(0.0, 100.0, VALUES)]
    lanes = best(lambda: run_batch(gears, transient=LENGTH, cycles=LENGTH, points=1), rounds)
    return error, one, lanes, has_equal_halves(model)


def law_row(text: str, slots: bool, rounds: int) -> tuple[list[float], list[float]]:
    """Errors of state and tangents; seconds a mesh cycle, with a tangent, and in a batch."""
    actives = read_effects(text)
    at = (lambda model: model) if slots else (lambda model: by_laws(model, actives))
    exact, machine = Stepper(gear(text, order=16, steps_per_cycle=48)), stepper(at(gear(text)))
    y, _ = exact.advance_cycles(exact.start().y, np.zeros((0, exact.model.n_state)), 0, 60)

    def same(state: Array) -> Array:
        """A state of the exact gear as the other one orders it."""
        rest = np.zeros(machine.model.n_state - exact.model.layout.n_state)
        whole = np.concatenate([state[: exact.model.layout.n_state], rest])
        return machine.with_added_values(whole, exact.added_states(state))

    start, size = same(y), machine.model.n_state
    none, frame = np.zeros((0, size)), np.eye(size)
    after = exact.advance_cycles(y, np.zeros((0, y.size)), 60, CYCLES)[0]
    wrong = machine.advance_cycles(start, none, 60, CYCLES)[0] - same(after)
    wanted = [same(row) for row in exact.advance_cycles(y, np.eye(y.size), 60, 1)[1]]
    frames = np.array([same(row) for row in np.eye(y.size)])
    _, found = machine.advance_cycles(start, frames, 60, 1)
    times = [
        best(partial(machine.advance_cycles, start, tangents, 60, CYCLES), rounds) / CYCLES
        for tangents in (none, frame[:1])
    ]
    few = [at(gear(text, delta_T=value)) for value in np.linspace(0.0, 100.0, FEW)]
    batch = best(lambda: run_batch(few, transient=CYCLES, cycles=CYCLES, points=1), rounds)
    errors = [float(np.abs(wrong).max()), float(np.abs(found - np.array(wanted)).max())]
    return errors, [*times, batch / (2 * CYCLES * FEW)]


def lanes_row(text: str, exponents: bool, rounds: int) -> tuple[float, float, float]:
    """Seconds a mesh cycle and value one after another, and in lanes; difference of the ends."""
    lanes = [gear(text, delta_T=value) for value in np.linspace(60.0, 90.0, VALUES)]
    ends, times = [], []
    for models in ([replace(model, integrator=LawStepper) for model in lanes], lanes):
        run = partial(run_batch, models, None, CYCLES, CYCLES, 1, exponents)
        times.append(best(run, rounds) / (2 * CYCLES * VALUES))
        ends.append(run().end)
    return times[0], times[1], float(np.abs(ends[0] - ends[1]).max())


def print_effects(rounds: int) -> None:
    """A row for each effect, beside the gear without effects."""
    print("| effect | error | stepper | in lanes | halves |")
    print("| --- | --- | --- | --- | --- |")
    plain = None
    for text in EFFECTS:
        error, one, lanes, alike = row(text, rounds)
        plain = plain or (one, lanes)
        print(
            f"| {text or 'none'} | {error:.0e} | {one / plain[0]:.1f} | {lanes / plain[1]:.1f} "
            f"| {'alike' if alike else 'unlike'} |",
            flush=True,
        )
    if plain:
        per_cycle = 1e6 * plain[1] / (VALUES * 2 * LENGTH)
        print(
            f"\nWithout effects: {1e6 * plain[0]:.1f} us a mesh cycle, {per_cycle:.2f} in lanes.\n"
        )


def print_reference() -> None:
    """The error of each effect after 20 mesh cycles against its own law, by DOP853."""
    print("| effect | error against DOP853 | switches |")
    print("| --- | --- | --- |")
    for text in EFFECTS:
        model, actives = gear(text), read_effects(text)
        machine, n, first = Stepper(model), model.layout.n_state, 200
        none = np.zeros((0, model.n_state))
        start, _ = machine.advance_cycles(machine.start().y, none, 0, first)
        begin = replace(machine.start(), y=start, cycle=first)
        found = machine.advance(begin, CYCLES * model.parameters.samples_per_cycle)
        n_added = Reference(model, actives).n_added_states
        wanted = integrate(model, actives, in_si(model, start, n_added), first, CYCLES)
        error = float(np.abs(in_si(model, found.end.y, n_added)[:n] - wanted[:n]).max())
        print(f"| {text or 'none'} | {error:.0e} | {found.switches} |", flush=True)


def print_laws(rounds: int) -> None:
    """Two rows for each of some effects: in slots, and by its law."""
    load_examples()
    print("| effect | run by | error | of tangents | us a cycle | with a tangent | of 8 values |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for text in BY_LAWS:
        for slots in (True, False):
            errors, times = law_row(text, slots, rounds)
            shown = [*(f"{one:.0e}" for one in errors), *(f"{1e6 * one:.0f}" for one in times)]
            cells = [text, "slots" if slots else "law", *shown]
            print(f"| {' | '.join(cells)} |", flush=True)


def print_lanes(rounds: int) -> None:
    """What lanes gain for laws that are written for them, without and with a tangent."""
    print("\n| effect | tangent | one after another | in lanes | gain | difference |")
    print("| --- | --- | --- | --- | --- | --- |")
    for text in IN_LANES:
        for exponents in (False, True):
            singly, lanes, apart = lanes_row(text, exponents, rounds)
            print(
                f"| {text} | {'yes' if exponents else 'no'} | {1e6 * singly:.0f} "
                f"| {1e6 * lanes:.0f} | {singly / lanes:.1f} | {apart:.0e} |",
                flush=True,
            )


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.effects", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one round in the place of five")
    parser.add_argument("--laws", action="store_true", help="the other two tables alone")
    parser.add_argument(
        "--reference", action="store_true", help="errors against DOP853 alone (some ten minutes)"
    )
    args = parser.parse_args()
    rounds = 1 if args.quick else 5
    warnings.simplefilter("ignore", ParameterWarning)
    if args.reference:
        print_reference()
        return
    if not args.laws:
        print_effects(rounds)
    print_laws(rounds)
    print_lanes(rounds)


if __name__ == "__main__":
    main()
