"""Memory over many mesh cycles, in blocks as the node takes them: does it grow?

    python benchmarks/memory.py [--seconds 60] [--model full]

An hour of the machine's own time is 18 million mesh cycles.
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path

from herringbone_sim.core.integrate import State, Stepper, warm_up
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters, ParameterWarning

BLOCK_CYCLES = 256
REPORTS = 6


def resident_kib() -> int:
    """Resident set size of this process [KiB], as Linux tells it."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    (line,) = [one for one in status.splitlines() if one.startswith("VmRSS:")]
    return int(line.split()[1])


def settle(stepper: Stepper, state: State, seconds: float) -> State:
    """Advance by so much simulated time, a block at a time, and drop the samples."""
    n = BLOCK_CYCLES * stepper.model.parameters.samples_per_cycle
    end = state.t + seconds
    while state.t < end:
        state = stepper.advance(state, n).end
    return state


def main() -> None:
    """Print the resident memory along the run and its growth after the first tenth."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="simulated time")
    parser.add_argument("--model", choices=("reduced", "full"), default="reduced")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ParameterWarning)
    model = build(Parameters(model=options.model, delta_T=20.0))
    warm_up(model)
    stepper = Stepper(model)
    start = time.perf_counter()
    print(f"start: {resident_kib()} KiB")
    state = settle(stepper, stepper.start(tangents=1), options.seconds / 10.0)
    first = resident_kib()
    for _ in range(REPORTS):
        state = settle(stepper, state, 0.9 * options.seconds / REPORTS)
        print(f"t = {state.t:9.2f} s, {state.cycle:9d} cycles: {resident_kib()} KiB")
    wall = time.perf_counter() - start
    print(
        f"growth after the first tenth: {resident_kib() - first} KiB, in {wall:.0f} s of wall time"
    )


if __name__ == "__main__":
    main()
