"""``survival``: whether a real gear would show the motion from rest, over a parameter."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from herringbone_sim.cli.basins import kept_sections
from herringbone_sim.cli.parameter_options import add_parameter_options, gear_from, tell_gear
from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.cli.workers import add_workers, workers_from
from herringbone_sim.core.model import Model
from herringbone_sim.dynamics.basins import random_starts
from herringbone_sim.dynamics.survival import Survival, survival
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.errors import AnalysisError
from herringbone_sim.views.figures.style import save
from herringbone_sim.views.figures.survival import survival_figure
from herringbone_sim.views.tables.csv_file import write_csv

Array = NDArray[np.float64]

POINTS = 150
FATES = ("from_rest", "other_alike", "differ", "differ_chaotic")
HEAD = (
    *("value", "motion", "starts"),
    *(f"{fate}{end}" for fate in FATES for end in ("", "_low", "_high")),
    *("within", "within_error", "transverse", "transverse_error"),
)
DESCRIPTION = """\
A simulation from rest keeps left and right alike; a real gear does not. Over a parameter, tell how
many random starts, left and right each on its own, reach the motion that the gear has from rest,
how many another one in which left and right are alike, and how many one in which they differ; and
how fast perturbations of the motion from rest grow or decay: above 0 for those that part left and
right, no real gear can stay on it.

DIR then holds survival.csv (exponents per tau, shares with 95 % intervals), survival.png and .svg.
A run that was stopped goes on where it was when started again.
"""
EXAMPLES = """\
python -m herringbone_sim survival --over delta_T --from 60 --to 90 --values 7 \\
    --parameters config/paper.yaml --out survival
"""


def add_parser(subparsers: Any) -> None:
    """Register ``survival`` with the sub-parsers of the command line."""
    parser = add_verb(subparsers, "survival", DESCRIPTION, EXAMPLES)
    add_parameter_options(parser)
    add = parser.add_argument
    add("--over", required=True, metavar="NAME", help="parameter, such as delta_T, xi, K")
    add("--from", dest="low", type=float, required=True, metavar="LOW", help="first value")
    add("--to", dest="high", type=float, required=True, metavar="HIGH", help="last value")
    add("--values", type=int, default=16, metavar="N", help="values between them [16]")
    add("--starts", type=int, default=64, metavar="N", help="random starts at each [64]")
    add("--reach", type=float, default=1.0, metavar="B", help="of x in b_c, v in b_c omega_n [1]")
    add("--transient", type=int, default=3000, metavar="N", help="cycles left out first [3000]")
    add("--seed", type=int, default=0, metavar="N", help="of the random starts [0]")
    add_workers(parser)
    add("--out", type=Path, required=True, metavar="DIR", help="folder to write to")
    parser.set_defaults(func=run)


def run(args: argparse.Namespace) -> int:
    """Run all values, print and write the table, draw the figure."""
    if args.values < 2 or not args.low < args.high or args.starts < 1 or args.transient < 0:
        raise AnalysisError(
            "--values must be 2 or more, --from less than --to, --starts 1 or more and "
            f"--transient 0 or more, got {args.values}, {args.low} to {args.high}, {args.starts} "
            f"and {args.transient}"
        )
    (p, actives), workers = gear_from(args), workers_from(args)
    values = np.linspace(args.low, args.high, args.values)
    models = [build_with(p.changed({args.over: float(v)}), actives) for v in values]
    tell_gear(models[0])
    with ThreadPoolExecutor(workers) as pool:
        told = pool.map(lambda one: _at(one, args), models)
        found = list(tqdm(told, total=len(models), unit="value", disable=None))
    rows = table(values, found)
    write_csv(args.out / "survival.csv", HEAD, rows)
    save(survival_figure(args.over, values, found), args.out, "survival")
    shutil.rmtree(args.out / "unfinished")
    print(text(args.over, values, found))
    print(f"written: {args.out / 'survival.csv'}, {args.out / 'survival.png'}")
    return 0


def _at(model: Model, args: argparse.Namespace) -> Survival:
    sections_of = kept_sections(args.out / "unfinished", model, args.transient, POINTS)
    starts = random_starts(model, args.starts, np.random.default_rng(args.seed), args.reach)
    return survival(model, sections_of, starts, at=args.transient + POINTS - 1)


def table(values: Array, found: Sequence[Survival]) -> list[tuple[Any, ...]]:
    """A row a value, as ``HEAD``."""
    return [
        (
            *(f"{value:.9g}", one.motion, one.starts),
            *(f"{share:.6g}" for share in one.shares.ravel()),
            *(f"{number:.6g}" for number in (*one.within, *one.transverse)),
        )
        for value, one in zip(values, found, strict=True)
    ]


def text(name: str, values: Array, found: Sequence[Survival]) -> str:
    """The table to be read."""
    head = ("from rest", "reached by", "alike", "differ", "chaotic", "within", "transverse")
    lines = [f"{name:>9s}  {head[0]:16s}" + "".join(f"{one:>11s}" for one in head[1:])]
    for value, one in zip(values, found, strict=True):
        shares = "".join(f"{share:11.0%}" for share in one.shares[:, 0])
        rates = f"{one.within[0]:+11.4f}{one.transverse[0]:+11.4f}"
        lines.append(f"{value:9.5g}  {one.motion:16s}{shares}{rates}")
    return "\n".join(lines)
