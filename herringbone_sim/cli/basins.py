"""``basins``: coexisting attractors of a gear and the share of starts that each attracts."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from herringbone_sim.arrays import Array
from herringbone_sim.cli.options import (
    add_number,
    add_out,
    add_random_starts,
    add_workers,
    workers_from,
)
from herringbone_sim.cli.parameter_options import (
    add_parameter_options,
    model_from,
    print_gear_notes,
)
from herringbone_sim.core.model import Model
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
from herringbone_sim.dynamics.portraits import portraits
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.array_cache import ArrayCache
from herringbone_sim.views.figures.basins import PORTRAITS, basins_figure
from herringbone_sim.views.figures.style import save
from herringbone_sim.views.tables.csv_file import write_csv

HEAD = (
    *("attractor", "motion", "starts", "share", "low", "high"),
    *("exponent_per_tau", "exponent_error", "starts_of_slice"),
)
DESCRIPTION = """\
Start a gear from many states and distinguish the motions in which they end: period, whether left
and right move alike, whether they are chaotic (by the largest exponent), and the share of starts
that each attracts, with its 95 % Wilson interval. A motion and its mirror image count as one.
Random starts have uniformly distributed relative displacements and velocities within --reach, left
and right drawn independently; the slice has all meshes at rest.

DIR then holds basins.csv, starts.csv, slice.csv, basins.png and .svg. Repeat the command to
continue a run that was stopped.
"""
EXAMPLES = """\
python -m herringbone_sim basins --set delta_T=70 --starts 100 --slice 24 \\
    --parameters config/paper.yaml --out basins
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_parameter_options(parser)
    add_random_starts(parser, starts=200, transient=4000)
    add_number(parser, "--points", 200, "mesh cycles observed then")
    add_number(parser, "--slice", 0, "a picture of N x N starts at rest; 0 for none")
    add_workers(parser)
    add_out(parser)


def run(args: argparse.Namespace) -> int:
    """Run the starts, print the shares, write tables and figure; exit code 0.

    Raises:
        AnalysisError: an option out of range.
    """
    _check(args)
    workers = workers_from(args)
    model = model_from(args)
    print_gear_notes(model)
    unfinished = args.out / "unfinished"
    sections_of = cached_sections(unfinished, model, args.transient, args.points, workers)
    starts = random_starts(model, args.starts, np.random.default_rng(args.seed), args.reach)
    shared = explore(sections_of, starts, symmetry(model), progress=_bar("starts"))
    plane = None
    if args.slice:
        attractors, bar = shared.attractors, _bar("slice")
        plane = explore_slice(model, sections_of, args.slice, args.reach, attractors, bar)
    all_attractors = (plane[1] if plane else shared).attractors
    shared = Basins(all_attractors, shared.labels)
    last = args.transient + args.points - 1
    motions = [identify_motion(model, attractor, at=last) for attractor in all_attractors]
    pairs = zip(motions, all_attractors, strict=True)
    names = [attractor.named(kind) for (kind, _), attractor in pairs]
    growths = [growth for _, growth in motions]
    rows = table(names, growths, shared, plane[1] if plane else None)
    write(args.out, rows, starts, shared, plane)
    drawn = portraits(model, all_attractors[:PORTRAITS], last)
    save(basins_figure(drawn, names, shared, plane), args.out, "basins")
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


def cached_sections(
    folder: Path, model: Model, transient: int, points: int, workers: int = 1
) -> Sections:
    """``gear_sections`` whose results are stored in a folder and read from it."""
    sections_of, cache = gear_sections(model, transient, points, workers), ArrayCache(folder)

    def cached(starts: Array) -> Array:
        effects = effects_text(model.effects)
        parts = ["sections", model.parameters, effects, transient, points, starts]
        arrays = cache.get(parts, lambda: {"sections": sections_of(starts)})
        return np.asarray(arrays["sections"])

    return cached


def table(
    names: Sequence[str], growths: Sequence[Growth], shared: Basins, plane: Basins | None
) -> list[tuple[Any, ...]]:
    """Rows of ``basins.csv``, one per attractor, columns as in ``HEAD``."""
    slice_counts = plane.counts if plane else np.zeros(len(names), dtype=int)
    shares, counts = shared.shares(), shared.counts
    return [
        (
            *(i + 1, name, int(counts[i]), *map(float, shares[i])),
            *(float(growth.exponents[0]), float(growth.errors[0]), int(slice_counts[i])),
        )
        for i, (name, growth) in enumerate(zip(names, growths, strict=True))
    ]


def text(rows: Sequence[tuple[Any, ...]], shared: Basins) -> str:
    """The rows as aligned text, with the number of failed runs."""
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
    """Write ``basins.csv``, ``starts.csv`` and ``slice.csv``; attractors count from 1, 0 = failed.

    Args:
        rows: of ``basins.csv``.
        starts: (n, n_state) random starts.
        shared: their basins.
        plane: axis (n,) of the slice and its basins, labels (n, n).
    """
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
