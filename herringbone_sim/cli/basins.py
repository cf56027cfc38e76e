"""``basins``: which motions attract the starts, and how many each."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from herringbone_sim.cli.parameter_options import add_parameter_options, model_from, tell_gear
from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.cli.workers import add_workers, workers_from
from herringbone_sim.core.model import Model
from herringbone_sim.dynamics.attractors import Attractor
from herringbone_sim.dynamics.basins import (
    Basins,
    Sections,
    explore,
    explore_slice,
    gear_sections,
    random_starts,
)
from herringbone_sim.dynamics.exponent_methods import identify_motion
from herringbone_sim.dynamics.flow import symmetry
from herringbone_sim.dynamics.growth import Growth
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.array_cache import ArrayCache
from herringbone_sim.views.figures.basins import basins_figure
from herringbone_sim.views.figures.style import save
from herringbone_sim.views.tables.csv_file import write_csv

Array = NDArray[np.float64]

HEAD = (
    *("attractor", "motion", "starts", "share", "low", "high"),
    *("exponent_per_tau", "exponent_error", "starts_of_slice"),
)
DESCRIPTION = """\
Start a gear from many states and tell the motions apart in which they end: their periods, whether
left and right move alike, whether they are chaotic (by the largest exponent), and the share of
starts that each attracts, with the 95 % interval of Wilson. A motion and its mirror image count
as one. Random starts have every relative displacement and velocity even within the reach, left
and right each on its own; the slice has all meshes at rest.

DIR then holds basins.csv, starts.csv, slice.csv, basins.png and .svg. A run that was stopped goes
on where it was when started again.
"""
EXAMPLES = """\
python -m herringbone_sim basins --set delta_T=70 --starts 100 --slice 24 \\
    --parameters config/paper.yaml --out basins
"""


def add_parser(subparsers: Any) -> None:
    """Register ``basins`` with the sub-parsers of the command line."""
    parser = add_verb(subparsers, "basins", DESCRIPTION, EXAMPLES)
    add_parameter_options(parser)
    add = parser.add_argument
    add("--starts", type=int, default=200, metavar="N", help="random starts [200]")
    add("--slice", type=int, default=0, metavar="N", help="a picture of N x N starts [none]")
    add("--reach", type=float, default=1.0, metavar="B", help="of x in b_c, v in b_c omega_n [1]")
    add("--transient", type=int, default=4000, metavar="N", help="cycles left out first [4000]")
    add("--points", type=int, default=200, metavar="N", help="cycles looked at then [200]")
    add("--seed", type=int, default=0, metavar="N", help="of the random starts [0]")
    add_workers(parser)
    add("--out", type=Path, required=True, metavar="DIR", help="folder to write to")
    parser.set_defaults(func=run)


def run(args: argparse.Namespace) -> int:
    """Run the starts, print the shares, write tables and figure."""
    _check(args)
    workers = workers_from(args)
    model = model_from(args)
    tell_gear(model)
    unfinished = args.out / "unfinished"
    sections_of = kept_sections(unfinished, model, args.transient, args.points, workers)
    starts = random_starts(model, args.starts, np.random.default_rng(args.seed), args.reach)
    shared = explore(sections_of, starts, symmetry(model), progress=_bar("starts"))
    plane = None
    if args.slice:
        attractors, bar = shared.attractors, _bar("slice")
        plane = explore_slice(model, sections_of, args.slice, args.reach, attractors, bar)
    all_attractors = (plane[1] if plane else shared).attractors
    shared = Basins(all_attractors, shared.labels)
    last = args.transient + args.points - 1
    known = [identify_motion(model, one, at=last) for one in all_attractors]
    names = [named(kind, one) for (kind, _), one in zip(known, all_attractors, strict=True)]
    rows = table(names, [growth for _, growth in known], shared, plane[1] if plane else None)
    write(args.out, rows, starts, shared, plane)
    save(basins_figure(model, names, shared, plane, last), args.out, "basins")
    shutil.rmtree(unfinished)
    print(text(rows, shared))
    print(f"written: {args.out / 'basins.csv'}, {args.out / 'basins.png'}")
    return 0


def _check(args: argparse.Namespace) -> None:
    if args.starts < 1 or args.slice < 0 or args.slice == 1 or args.transient < 0:
        raise AnalysisError(
            "--starts must be 1 or more, --slice 0 or 2 and more, --transient 0 or more, "
            f"got {args.starts}, {args.slice}, {args.transient}"
        )
    if args.points < 50 or not 0.0 < args.reach < 1e3:
        raise AnalysisError(
            f"--points must be 50 or more to tell motions apart and --reach lie in 0 .. 1000, "
            f"got {args.points} and {args.reach}"
        )


def _bar(name: str) -> Callable[[Iterable[int]], Iterable[int]]:
    return lambda chunks: tqdm(chunks, desc=name, unit="chunk", disable=None)


def kept_sections(
    folder: Path, model: Model, transient: int, points: int, workers: int = 1
) -> Sections:
    """``gear_sections`` that are kept in a folder, and found there."""
    sections_of, kept = gear_sections(model, transient, points, workers), ArrayCache(folder)

    def remembering(starts: Array) -> Array:
        effects = effects_text(model.effects)
        parts = ["sections", model.parameters, effects, transient, points, starts]
        found: Array = kept.get(parts, lambda: {"sections": sections_of(starts)})["sections"]
        return found

    return remembering


def named(kind: str, attractor: Attractor) -> str:
    """Label of an attractor: kind of motion and, if any, symmetry, as ``P2, left = right``."""
    return f"{kind}, {attractor.symmetry}" if attractor.symmetry else kind


def table(
    names: Sequence[str], growths: Sequence[Growth], shared: Basins, plane: Basins | None
) -> list[tuple[Any, ...]]:
    """A row an attractor."""
    of_slice = plane.counts if plane else np.zeros(len(names), dtype=int)
    shares, counts = shared.shares(), shared.counts
    return [
        (
            *(i + 1, name, int(counts[i]), *map(float, shares[i])),
            *(float(growth.exponents[0]), float(growth.errors[0]), int(of_slice[i])),
        )
        for i, (name, growth) in enumerate(zip(names, growths, strict=True))
    ]


def text(rows: Sequence[tuple[Any, ...]], shared: Basins) -> str:
    """The table to be read."""
    lines = [f"{'':3s}{'motion':42s}{'starts':>7s}{'share':>8s}{'95 %':>16s}{'exponent':>12s}"]
    for number, name, count, share, low, high, value, error, _ in rows:
        span = f"{low:.1%} .. {high:.1%}"
        lines.append(f"{number:<3d}{name:42s}{count:7d}{share:8.1%}{span:>16s}{value:+12.4f}")
        lines[-1] += f" +- {error:.4f}"
    failed = [f"   failed{shared.failed:43d}"] if shared.failed else []
    return "\n".join([*lines, *failed])


def write(
    folder: Path,
    rows: Sequence[tuple[Any, ...]],
    starts: Array,
    shared: Basins,
    plane: tuple[Array, Basins] | None,
) -> None:
    """``basins.csv``, ``starts.csv`` and ``slice.csv``; attractors count from 1, 0 = failed."""
    write_csv(folder / "basins.csv", HEAD, rows)
    states = ",".join(["attractor", *(f"y_{i}" for i in range(starts.shape[1]))])
    _save(folder / "starts.csv", np.column_stack([shared.labels + 1, starts]), states)
    if plane:
        axis, basins = plane
        difference, common = np.meshgrid(axis, axis, indexing="ij")
        columns = [basins.labels.ravel() + 1, common.ravel(), difference.ravel()]
        _save(folder / "slice.csv", np.column_stack(columns), "attractor,shared,difference")


def _save(path: Path, data: Array, head: str) -> None:
    formats = ["%d"] + ["%.12g"] * (data.shape[1] - 1)
    np.savetxt(path, data, fmt=formats, delimiter=",", header=head, comments="")
