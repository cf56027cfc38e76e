"""``control``: amplitude, phase and torque that make a gear run periodically; robustness."""

from __future__ import annotations

import argparse
from typing import Any

from tqdm import tqdm

from herringbone_sim.cli.control_parts import FULL, PARTS, QUICK
from herringbone_sim.cli.options import add_out, add_workers, workers_from
from herringbone_sim.cli.parameter_options import (
    add_parameter_options,
    gear_from,
    print_gear_notes,
    settings,
)
from herringbone_sim.control.runs import MotionRunner
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.grid import with_sweep_steps

DESCRIPTION = """\
Study the control K cos(order Omega tau + phase) beyond the paper: the least K that reaches a
period at each temperature rise, and from which starts (amplitude); the effect of phase and
frequency (shape); torques on the bodies that realise it (realisation); whether the controlled
motion persists when left and right differ (robustness). Tables and figures go to DIR. Finished
runs are stored in DIR/data: repeat the command to continue one that was stopped.

K is varied in every part, delta_T in amplitude and robustness, the phase in shape and
realisation, the order in shape. All other parameters are those of the gear.
"""
EXAMPLES = """\
python -m herringbone_sim control --quick --set xi=0.085 \\
    --parameters config/paper.yaml --out control
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_parameter_options(parser)
    add = parser.add_argument
    add_out(parser)
    add("--only", default=",".join(PARTS), metavar="PARTS", help=f"of {', '.join(PARTS)} [all]")
    add("--quick", action="store_true", help="coarse grids and short runs")
    add_workers(parser)


def run(args: argparse.Namespace) -> int:
    """Run the parts of ``--only``, print their summaries; exit code 0.

    Raises:
        AnalysisError: no such part, no threads, or the model ``full``.
        ParameterError: a gear that can't be built.
    """
    chosen = [part.strip() for part in args.only.split(",")]
    if unknown := set(chosen) - set(PARTS):
        raise AnalysisError(f"--only takes {', '.join(PARTS)}, got {', '.join(sorted(unknown))}")
    workers = workers_from(args)
    base, actives = gear_from(args)
    base = with_sweep_steps(base, settings(args.set))
    if base.model != "reduced":
        raise AnalysisError("control needs model: reduced, got full: its K is that of Eq. (22)")
    print_gear_notes(build_with(base, actives))
    for part in chosen:
        with tqdm(desc=part, unit="run", total=0, disable=None) as bar:
            runner = MotionRunner(args.out / "data", workers, _planner(bar), bar.update, actives)
            lines = PARTS[part](runner, base, QUICK if args.quick else FULL, args.out)
        print("\n".join([part, *(f"  {line}" for line in lines)]))
    print(f"written: {args.out}")
    return 0


def _planner(bar: Any) -> Any:
    """Function that adds a number of runs to the total of a progress bar."""

    def planned(runs: int) -> None:
        bar.total += runs
        bar.refresh()

    return planned
