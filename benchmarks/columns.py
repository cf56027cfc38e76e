"""What a column, a derivative by a parameter, costs: ``python -m benchmarks.columns``.

Processor time a mesh cycle of the motion, and what a tangent vector and a column add to it, in the
stepper and in lanes (64 values of one gear, both halves integrated). Compilation is not counted.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from benchmarks.effects import best, gear
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.parameters import ParameterWarning
from herringbone_sim.core.sensitivity import Direction, Directions
from herringbone_sim.effects.sensitivity import directions

NAMES = ("delta_T", "xi", "T_1", "k_factor[0]", "e_m", "mean_stiffness@rp:factor")
EFFECTS = ("", "tooth_friction:mu=0.08", "contact_nonlinearity:exponent=1.1")
CYCLES, VALUES, ROUNDS = 20, 64, 5


def row(text: str, kind: str) -> tuple[list[float], list[float]]:
    """Microseconds a mesh cycle of motion, tangent vector and column; of stepper and lanes."""
    model, wanted = directions(gear(text, model=kind), NAMES)
    n = CYCLES * model.parameters.samples_per_cycle
    y = Stepper(model).advance(Stepper(model).start(), n).end.y
    times = []
    for tangents, along in ((0, []), (1, []), (0, wanted)):
        stepper = Stepper(model, along)
        start = replace(stepper.start(tangents), y=y, cycle=CYCLES)
        times.append(best(lambda s=stepper, b=start: s.advance(b, n), ROUNDS) / CYCLES)
    starts, lanes = np.tile(y, (VALUES, 1)), []
    for along, tangent in (([], False), ([], True), (wanted, False)):

        def run(along: list[Direction] = along, tangent: bool = tangent) -> None:
            gears = [Directions(model, along) if along else model for _ in range(VALUES)]
            run_batch(gears, starts, 0, CYCLES, 1, tangent)

        went = best(run, ROUNDS)
        lanes.append(went / VALUES / CYCLES)
    return apart(times), apart(lanes)


def apart(times: list[float]) -> list[float]:
    """Motion, one tangent vector, one column, in microseconds."""
    motion, tangent, columns = (1e6 * one for one in times)
    return [motion, tangent - motion, (columns - motion) / len(NAMES)]


def main() -> None:
    """Print a row for each gear."""
    warnings.simplefilter("ignore", ParameterWarning)
    print("| gear | motion, tangent, column [us] | in lanes |")
    print("| --- | --- | --- |")
    for text in EFFECTS:
        for kind in ("reduced", "full"):
            cells = [", ".join(f"{one:.1f}" for one in part) for part in row(text, kind)]
            print(f"| {kind} {text} | {cells[0]} | {cells[1]} |", flush=True)


if __name__ == "__main__":
    main()
