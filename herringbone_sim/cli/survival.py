"""A simulation from rest keeps left and right alike; a real gear does not. At each value of a
parameter, count the random starts (left and right drawn independently) that reach the motion from
rest, another motion with left = right, or one in which they differ. Also give the growth rates of
perturbations of the motion from rest: if that of left-right differences is above 0, a real gear
leaves this motion.

DIR then holds survival.csv (exponents per tau, shares with 95 % intervals), survival.png and .svg.
Repeat the command to continue a run that was stopped.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from tqdm import tqdm

from herringbone_sim.arrays import Array
from herringbone_sim.cli.basins import cached_sections
from herringbone_sim.cli.options import (
    Count,
    Discarded,
    High,
    Low,
    Out,
    RandomStarts,
    Starts,
    Workers,
    flattened,
    limits,
)
from herringbone_sim.cli.parameter_options import GearOptions, gear_from, print_gear_notes
from herringbone_sim.core.model import Model
from herringbone_sim.core.sensitivity import need_tangents
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
EXAMPLES = """\
python -m herringbone_sim survival --over delta_T --from 60 --to 90 --values 7 \\
    --parameters config/paper.yaml --out survival
"""


@flattened
@dataclass(frozen=True, kw_only=True)
class Options(RandomStarts):
    """Options: values of the parameter, and the random starts at each."""

    over: Annotated[str, "NAME", "parameter, such as delta_T, xi, K"]
    low: Annotated[Low, "first value"]
    high: Annotated[High, "last value"]
    values: Annotated[Count, limits(gte=2), "number of values"] = 16
    starts: Starts = 64
    transient: Discarded = 3000


def run(
    *,
    gear: GearOptions = GearOptions(),
    options: Options,
    workers: Workers = 2,
    out: Out,
) -> int:
    """Simulate all values, print and write the table, draw the figure; exit code 0.

    Raises:
        AnalysisError: the first value is not less than the last.
        ParameterError: ``method: rk4``, which has no tangents.
    """
    low, high, name = options.low, options.high, options.over
    if not low < high:
        raise AnalysisError(f"--from must be less than --to, got {low:g} and {high:g}")
    p, actives = gear_from(gear)
    values = np.linspace(low, high, options.values)
    models = [build_with(p.changed({name: float(v)}), actives) for v in values]
    need_tangents(models[0])
    print_gear_notes(models[0])
    unfinished = out / "unfinished"
    with ThreadPoolExecutor(workers) as pool:
        pending = pool.map(lambda model: _survival(model, options, unfinished), models)
        results = list(tqdm(pending, total=len(models), unit="value", disable=None))
    rows = table(values, results)
    write_csv(out / "survival.csv", HEAD, rows)
    save(survival_figure(name, values, results), out, "survival")
    shutil.rmtree(unfinished)
    print(text(name, values, results))
    print(f"written: {out / 'survival.csv'}, {out / 'survival.png'}")
    return 0


def _survival(model: Model, options: Options, folder: Path) -> Survival:
    sections_of = cached_sections(folder, model, options.transient, POINTS)
    starts = random_starts(
        model, options.starts, np.random.default_rng(options.seed), options.reach
    )
    return survival(model, sections_of, starts, at=options.transient + POINTS - 1)


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
    """Aligned text table: motion from rest, fractions of the starts, exponents per tau."""
    head = ("from rest", "reached by", "alike", "differ", "chaotic", "within", "transverse")
    lines = [f"{name:>9s}  {head[0]:16s}" + "".join(f"{title:>11s}" for title in head[1:])]
    for value, result in zip(values, results, strict=True):
        shares = "".join(f"{share:11.0%}" for share in result.shares[:, 0])
        rates = f"{result.within[0]:+11.4f}{result.transverse[0]:+11.4f}"
        lines.append(f"{value:9.5g}  {result.motion:16s}{shares}{rates}")
    return "\n".join(lines)
