"""``control``: what it takes to make a gear run periodically, and what that is worth."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tqdm import tqdm

from herringbone_sim.cli.control_parts import FULL, PARTS, QUICK
from herringbone_sim.cli.parameter_options import (
    add_parameter_options,
    gear_from,
    settings,
    tell_gear,
)
from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.cli.workers import add_workers, workers_from
from herringbone_sim.control.runs import Runs
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.grid import with_sweep_steps

DESCRIPTION = """\
Ask of the control K cos(order Omega tau + phase) what its paper did not: the least K that reaches
a period at each temperature rise, and from which starts (amplitude); what its phase and frequency
do (shape); which torque on which body can realise it, and how large (realisation); whether the
controlled motion bears unlike halves (robustness). Tables and figures go to DIR. What is done is
kept in DIR/data: a run that was stopped goes on where it was when started again.

K is varied in every part, delta_T in amplitude and robustness, the phase in shape and
realisation, the order in shape. All else is that of the gear.
"""
EXAMPLES = """\
python -m herringbone_sim control --quick --set xi=0.085 \\
    --parameters config/paper.yaml --out control
"""


def add_parser(subparsers: Any) -> None:
    """Register ``control`` with the sub-parsers of the command line."""
    parser = add_verb(subparsers, "control", DESCRIPTION, EXAMPLES)
    add_parameter_options(parser)
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder to write to; made if new")
    add("--only", default=",".join(PARTS), metavar="PARTS", help=f"of {', '.join(PARTS)} [all]")
    add("--quick", action="store_true", help="coarse and short, to see what comes")
    add_workers(parser)
    parser.set_defaults(func=run)


def run(args: argparse.Namespace) -> int:
    """Run the parts that were asked for; write and print what they found.

    Raises:
        AnalysisError: no such part, no threads, or the model of all planets.
        ParameterError: no gear can be like this.
    """
    chosen = [part.strip() for part in args.only.split(",")]
    if unknown := set(chosen) - set(PARTS):
        raise AnalysisError(f"--only takes {', '.join(PARTS)}, got {', '.join(sorted(unknown))}")
    workers = workers_from(args)
    base, actives = gear_from(args)
    base = with_sweep_steps(base, settings(args.set))
    if base.model != "reduced":
        raise AnalysisError("control needs model: reduced, got full: its K is that of Eq. (22)")
    tell_gear(build_with(base, actives))
    for part in chosen:
        with tqdm(desc=part, unit="run", total=0, disable=None) as bar:
            runs = Runs(args.out / "data", workers, _planner(bar), bar.update, actives)
            lines = PARTS[part](runs, base, QUICK if args.quick else FULL, args.out)
        print("\n".join([part, *(f"  {line}" for line in lines)]))
    print(f"written: {args.out}")
    return 0


def _planner(bar: Any) -> Any:
    """Runs become known as their part goes on: grids first, then bisections."""

    def planned(runs: int) -> None:
        bar.total += runs
        bar.refresh()

    return planned
