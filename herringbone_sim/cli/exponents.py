"""``exponents``: what every method says of one motion."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from herringbone_sim.cli.parameter_options import (
    add_parameter_options,
    model_from,
    settings,
    tell_gear,
)
from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.dynamics.exponent_methods import ExponentComparison, compare_exponents
from herringbone_sim.dynamics.growth import Growth
from herringbone_sim.dynamics.spectrum import kaplan_yorke
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.exponents import exponents_figure
from herringbone_sim.views.figures.style import PARAMETER_SYMBOLS, save
from herringbone_sim.views.tables.csv_file import write_csv

Row = tuple[str, str, float, float]
LEAST = 300
STEPS = 5
HEAD = ("method", "quantity", "value", "error")
DESCRIPTION = """\
Tell whether the motion of a gear is chaotic, by every method at once:

  tangent flow      the whole Lyapunov spectrum, with its convergence; its sum is checked
  two trajectories  the largest exponent, over the distance of the two
  left and right    largest exponents of perturbations that keep left and right alike, and of those
                    that part them: above 0 a symmetric motion does not last in a real gear
  recorded series   the largest exponent from the section alone, as from a recording
  0-1 test          near 0 for regular motion, near 1 for chaos; needs no phase space

Exponents are per unit of the dimensionless time tau, errors are standard errors.

DIR then holds exponents.csv, convergence.csv, exponents.png and .svg.
"""
EXAMPLES = """\
python -m herringbone_sim exponents --set delta_T=20 \\
    --parameters config/paper.yaml --out chaos
"""


def add_parser(subparsers: Any) -> None:
    """Register ``exponents`` with the sub-parsers of the command line."""
    parser = add_verb(subparsers, "exponents", DESCRIPTION, EXAMPLES)
    add_parameter_options(parser)
    add = parser.add_argument
    add("--cycles", type=int, default=2000, metavar="N", help="mesh cycles averaged over [2000]")
    add(
        "--transient",
        type=int,
        default=1000,
        metavar="N",
        help="mesh cycles left out first [1000]",
    )
    add("--seed", type=int, default=0, metavar="N", help="of the 0-1 test's frequencies [0]")
    add("--out", type=Path, required=True, metavar="DIR", help="folder to write to")
    parser.set_defaults(func=run)


def run(args: argparse.Namespace) -> int:
    """Print the table and write it with its figure."""
    if args.cycles < LEAST or args.transient < 0:
        raise AnalysisError(
            f"--cycles must be {LEAST} or more and --transient 0 or more, "
            f"got {args.cycles} and {args.transient}"
        )
    model = model_from(args)
    make_folder(args.out)
    tell_gear(model)
    with tqdm(total=STEPS, unit="method", disable=None) as bar:

        def step(name: str) -> None:
            bar.set_description(name)
            bar.update()

        found = compare_exponents(model, args.cycles, args.transient, args.seed, step)
    rows = table(found)
    title = ",  ".join(
        f"{PARAMETER_SYMBOLS.get(name, name)} = {value}"
        for name, value in settings(args.set).items()
    )
    write(args.out, rows, found, title)
    print(text(rows))
    print(f"\n{found.motion}")
    print(f"written: {args.out / 'exponents.csv'}, {args.out / 'exponents.png'}")
    return 0


def table(found: ExponentComparison) -> list[Row]:
    """All results, one a row."""
    spectrum, symmetric = found.spectrum, found.symmetric
    name, growth = "tangent flow", spectrum
    if symmetric is not None:
        name, growth = "left and right alike", symmetric.within
    series, rate = found.series, 1.0 / spectrum.period
    rows = _rows("tangent flow", "exponent", spectrum)
    rows += [
        ("tangent flow", "sum", float(spectrum.exponents.sum()), np.nan),
        ("damping", "sum", found.divergence, np.nan),
        (name, "Kaplan-Yorke dimension", kaplan_yorke(growth.exponents), np.nan),
    ]
    rows += [
        ("two trajectories", f"exponent 1 at {distance:.0e}", float(value), float(error))
        for distance, (value, error) in zip(found.distances, found.two_trajectories, strict=True)
    ]
    if symmetric is not None:
        rows += _rows("left and right alike", "exponent", symmetric.within)
        rows += _rows("left and right part", "exponent", symmetric.transverse)
    half = (series.high - series.low) / (2.0 * 1.645)  # of a 90 % interval
    rows.append(("recorded series", "exponent 1", series.value * rate, half * rate))
    return [*rows, ("0-1 test", "K", found.zero_one.K, np.nan)]


def _rows(method: str, name: str, growth: Growth) -> list[Row]:
    pairs = zip(growth.exponents, growth.errors, strict=True)
    return [(method, f"{name} {i}", float(v), float(e)) for i, (v, e) in enumerate(pairs, 1)]


def text(rows: Sequence[Row]) -> str:
    """The table to be read; what could not be had is left out."""
    lines = [f"{HEAD[0]:22s}{HEAD[1]:26s}{HEAD[2]:>10s}{HEAD[3]:>10s}"]
    for method, name, value, error in rows:
        if np.isfinite(value):
            shown = f"{error:10.5f}" if np.isfinite(error) else ""
            lines.append(f"{method:22s}{name:26s}{value:+10.5f}{shown}".rstrip())
    return "\n".join(lines)


def write(folder: Path, rows: Sequence[Row], found: ExponentComparison, title: str) -> None:
    """``exponents.csv``, ``convergence.csv`` and the figure."""
    running = found.spectrum.running
    names = [f"exponent_{j}" for j in range(1, running.shape[1] + 1)]
    write_csv(folder / "exponents.csv", HEAD, rows)
    data = np.column_stack([np.arange(1, len(running) + 1), running])
    head = ",".join(["period", *names])
    formats = ["%d"] + ["%.9g"] * len(names)
    path = folder / "convergence.csv"
    np.savetxt(path, data, fmt=formats, delimiter=",", header=head, comments="")
    save(exponents_figure(found, title), folder, "exponents")
