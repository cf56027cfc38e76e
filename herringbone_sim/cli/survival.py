"""``survival``: share of random starts that reach the motion from rest, over a parameter."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from tqdm import tqdm

from herringbone_sim.arrays import Array
from herringbone_sim.cli.basins import cached_sections
from herringbone_sim.cli.options import (
    add_number,
    add_out,
    add_random_starts,
    add_workers,
    workers_from,
)
from herringbone_sim.cli.parameter_options import (
    add_parameter_options,
    gear_from,
    print_gear_notes,
)
from herringbone_sim.core.model import Model
from herringbone_sim.dynamics.basins import random_starts
from herringbone_sim.dynamics.survival import Survival, survival
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.errors import AnalysisError
from herringbone_sim.views.figures.style import save
from herringbone_sim.views.figures.survival import survival_figure
from herringbone_sim.views.tables.csv_file import write_csv

POINTS = 150  # mesh cycles observed after the transient
FATES = ("from_rest", "other_alike", "differ", "differ_chaotic")
HEAD = (
    *("value", "motion", "starts"),
    *(f"{fate}{end}" for fate in FATES for end in ("", "_low", "_high")),
    *("within", "within_error", "transverse", "transverse_error"),
)
DESCRIPTION = """\
A simulation from rest keeps left and right alike; a real gear does not. At each value of a
parameter, count the random starts (left and right drawn independently) that reach the motion from
rest, another motion with left = right, or one in which they differ. Also give the growth rates of
perturbations of the motion from rest: if that of left-right differences is above 0, a real gear
leaves this motion.

DIR then holds survival.csv (exponents per tau, shares with 95 % intervals), survival.png and .svg.
Repeat the command to continue a run that was stopped.
"""
EXAMPLES = """\
python -m herringbone_sim survival --over delta_T --from 60 --to 90 --values 7 \\
    --parameters config/paper.yaml --out survival
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_parameter_options(parser)
    add = parser.add_argument
    add("--over", required=True, metavar="NAME", help="parameter, such as delta_T, xi, K")
    add("--from", dest="low", type=float, required=True, metavar="LOW", help="first value")
    add("--to", dest="high", type=float, required=True, metavar="HIGH", help="last value")
    add_number(parser, "--values", 16, "number of values")
    add_random_starts(parser, starts=64, transient=3000)
    add_workers(parser)
    add_out(parser)


def run(args: argparse.Namespace) -> int:
    """Run all values, print and write the table, draw the figure; exit code 0.

    Raises:
        AnalysisError: an option out of range.
    """
    if args.values < 2 or not args.low < args.high or args.starts < 1 or args.transient < 0:
        raise AnalysisError(
            "--values must be 2 or more, --from less than --to, --starts 1 or more and "
            f"--transient 0 or more, got {args.values}, {args.low} to {args.high}, {args.starts} "
            f"and {args.transient}"
        )
    (p, actives), workers = gear_from(args), workers_from(args)
    values = np.linspace(args.low, args.high, args.values)
    models = [build_with(p.changed({args.over: float(v)}), actives) for v in values]
    print_gear_notes(models[0])
    with ThreadPoolExecutor(workers) as pool:
        pending = pool.map(lambda model: _survival(model, args), models)
        results = list(tqdm(pending, total=len(models), unit="value", disable=None))
    rows = table(values, results)
    write_csv(args.out / "survival.csv", HEAD, rows)
    save(survival_figure(args.over, values, results), args.out, "survival")
    shutil.rmtree(args.out / "unfinished")
    print(text(args.over, values, results))
    print(f"written: {args.out / 'survival.csv'}, {args.out / 'survival.png'}")
    return 0


def _survival(model: Model, args: argparse.Namespace) -> Survival:
    sections_of = cached_sections(args.out / "unfinished", model, args.transient, POINTS)
    starts = random_starts(model, args.starts, np.random.default_rng(args.seed), args.reach)
    return survival(model, sections_of, starts, at=args.transient + POINTS - 1)


def table(values: Array, results: Sequence[Survival]) -> list[tuple[Any, ...]]:
    """Rows of ``survival.csv``, one per value, columns as in ``HEAD``."""
    return [
        (
            *(f"{value:.9g}", result.motion, result.starts),
            *(f"{share:.6g}" for share in result.shares.ravel()),
            *(f"{number:.6g}" for number in (*result.within, *result.transverse)),
        )
        for value, result in zip(values, results, strict=True)
    ]


def text(name: str, values: Array, results: Sequence[Survival]) -> str:
    """Table as aligned text: motion from rest, shares of the starts, exponents per tau."""
    head = ("from rest", "reached by", "alike", "differ", "chaotic", "within", "transverse")
    lines = [f"{name:>9s}  {head[0]:16s}" + "".join(f"{title:>11s}" for title in head[1:])]
    for value, result in zip(values, results, strict=True):
        shares = "".join(f"{share:11.0%}" for share in result.shares[:, 0])
        rates = f"{result.within[0]:+11.4f}{result.transverse[0]:+11.4f}"
        lines.append(f"{value:9.5g}  {result.motion:16s}{shares}{rates}")
    return "\n".join(lines)
