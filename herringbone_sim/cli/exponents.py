"""Tell whether the motion of a gear is chaotic, by every method at once:

  tangent flow      the whole Lyapunov spectrum, with its convergence; its sum
                    is checked
  two trajectories  the largest exponent, over the distance of the two
  left and right    largest exponents of perturbations that keep left and right
                    alike, and of those that part them: above 0 a symmetric
                    motion does not last in a real gear
  recorded series   the largest exponent from the section alone, as from a
                    recording
  0-1 test          near 0 for regular motion, near 1 for chaos; needs no phase
                    space

Exponents are per unit of the dimensionless time tau, errors are standard errors.

DIR then holds exponents.csv, convergence.csv, exponents.png and .svg.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np

from herringbone_sim.cli.options import Count, Discarded, Out, limits, progress
from herringbone_sim.cli.parameter_options import (
    GearOptions,
    model_from,
    print_gear_notes,
    settings,
)
from herringbone_sim.core.sensitivity import need_tangents
from herringbone_sim.dynamics.exponent_methods import ExponentComparison, compare_exponents
from herringbone_sim.dynamics.growth import Growth
from herringbone_sim.dynamics.spectrum import kaplan_yorke
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.exponents import exponents_figure
from herringbone_sim.views.figures.style import PARAMETER_SYMBOLS, save
from herringbone_sim.views.tables.csv_file import write_csv

Row = tuple[str, str, float, float]
LEAST = 300  # smallest --cycles
STEPS = 5  # steps of the progress bar, one per method
HEAD = ("method", "quantity", "value", "error")
EXAMPLES = """\
python -m herringbone_sim exponents --set delta_T=20 \\
    --parameters config/paper.yaml --out chaos
"""


def run(
    *,
    gear: GearOptions = GearOptions(),
    cycles: Annotated[Count, limits(gte=LEAST), "mesh cycles averaged over"] = 2000,
    transient: Discarded = 1000,
    seed: Annotated[Count, "of the frequencies of the 0-1 test"] = 0,
    out: Out,
) -> int:
    """Compute Lyapunov exponents and the 0-1 test of a gear's motion by all methods.

    Prints their table and the kind of the motion, and writes table, convergence and figure to
    ``out``.

    Returns:
        Exit code 0.
    """
    model = model_from(gear)
    need_tangents(model)
    make_folder(out)
    print_gear_notes(model)
    with progress(STEPS, "method") as step:
        comparison = compare_exponents(model, cycles, transient, seed, step)
    rows = table(comparison)
    title = ",  ".join(
        f"{PARAMETER_SYMBOLS.get(name, name)} = {value}"
        for name, value in settings(gear.set).items()
    )
    write(out, rows, comparison, title)
    print(text(rows))
    print(f"\n{comparison.motion}")
    print(f"written: {out / 'exponents.csv'}, {out / 'exponents.png'}")
    return 0


def table(comparison: ExponentComparison) -> list[Row]:
    """Rows (method, quantity, value, standard error), exponents per tau; NaN: error unknown."""
    spectrum, symmetric = comparison.spectrum, comparison.symmetric
    name, growth = "tangent flow", spectrum
    if symmetric is not None:
        name, growth = "left and right alike", symmetric.within
    series, rate = comparison.series, 1.0 / spectrum.period
    rows = _rows("tangent flow", "exponent", spectrum)
    rows += [
        ("tangent flow", "sum", float(spectrum.exponents.sum()), np.nan),
        ("damping", "sum", comparison.divergence, np.nan),
        (name, "Kaplan-Yorke dimension", kaplan_yorke(growth.exponents), np.nan),
    ]
    pairs = zip(comparison.distances, comparison.two_trajectories, strict=True)
    rows += [
        ("two trajectories", f"exponent 1 at {distance:.0e}", float(value), float(error))
        for distance, (value, error) in pairs
    ]
    if symmetric is not None:
        rows += _rows("left and right alike", "exponent", symmetric.within)
        rows += _rows("left and right part", "exponent", symmetric.transverse)
    half = (series.high - series.low) / (2.0 * 1.645)  # of a 90 % interval
    rows.append(("recorded series", "exponent 1", series.value * rate, half * rate))
    return [*rows, ("0-1 test", "K", comparison.zero_one.K, np.nan)]


def _rows(method: str, name: str, growth: Growth) -> list[Row]:
    pairs = zip(growth.exponents, growth.errors, strict=True)
    return [(method, f"{name} {i}", float(v), float(e)) for i, (v, e) in enumerate(pairs, 1)]


def text(rows: Sequence[Row]) -> str:
    """Aligned text table of the rows, without those whose value is unknown."""
    lines = [f"{HEAD[0]:22s}{HEAD[1]:26s}{HEAD[2]:>10s}{HEAD[3]:>10s}"]
    for method, name, value, error in rows:
        if np.isfinite(value):
            error_text = f"{error:10.5f}" if np.isfinite(error) else ""
            lines.append(f"{method:22s}{name:26s}{value:+10.5f}{error_text}".rstrip())
    return "\n".join(lines)


def write(folder: Path, rows: Sequence[Row], comparison: ExponentComparison, title: str) -> None:
    """Write ``exponents.csv``, ``convergence.csv`` and the figure into a folder."""
    running = comparison.spectrum.running
    names = [f"exponent_{j}" for j in range(1, running.shape[1] + 1)]
    write_csv(folder / "exponents.csv", HEAD, rows)
    periods = ([n, *row] for n, row in enumerate(running.tolist(), 1))
    write_csv(folder / "convergence.csv", ["period", *names], periods)
    save(exponents_figure(comparison, title), folder, "exponents")
