"""Start a gear from many states and distinguish the motions in which they end: period, whether
left and right move alike, whether they are chaotic (by the largest exponent), and the share of
starts that each attracts, with its 95 % Wilson interval. A motion and its mirror image count as
one. Random starts have uniformly distributed relative displacements and velocities within --reach,
left and right drawn independently; the slice has all meshes at rest.

DIR then holds basins.csv, starts.csv, slice.csv, basins.png and .svg. Repeat the command to
continue a run that was stopped.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from tqdm import tqdm

from herringbone_sim.arrays import Array
from herringbone_sim.cli.options import (
    Count,
    Discarded,
    Out,
    RandomStarts,
    Starts,
    Workers,
    flattened,
    limits,
)
from herringbone_sim.cli.parameter_options import GearOptions, model_from, print_gear_notes
from herringbone_sim.core.model import Model
from herringbone_sim.core.sensitivity import need_tangents
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

LEAST = 50  # fewest mesh cycles that distinguish motions
HEAD = (
    *("attractor", "motion", "starts", "share", "low", "high"),
    *("exponent_per_tau", "exponent_error", "starts_of_slice"),
)
EXAMPLES = """\
python -m herringbone_sim basins --set delta_T=70 --starts 100 --slice 24 \\
    --parameters config/paper.yaml --out basins
"""


@flattened
@dataclass(frozen=True, kw_only=True)
class Options(RandomStarts):
    """Options: random starts, slice, and length of the runs."""

    starts: Starts = 200
    transient: Discarded = 4000
    points: Annotated[Count, limits(gte=LEAST), "mesh cycles observed then"] = 200
    slice: Annotated[Count, "a picture of N x N starts at rest; 0 for none"] = 0


def run(
    *,
    gear: GearOptions = GearOptions(),
    options: Options = Options(),
    workers: Workers = 2,
    out: Out,
) -> int:
    """Find the attractors that random starts, and a slice if asked for, lead to.

    Prints the share of the random starts that each attracts, and writes tables and figure to
    ``out``. Computed sections are kept there, in ``unfinished``, until the end.

    Returns:
        Exit code 0.

    Raises:
        AnalysisError: a slice of one value.
        ParameterError: ``method: rk4``, which has no tangents.
    """
    if options.slice == 1:
        raise AnalysisError("--slice must be 0 or 2 and more, got 1")
    model = model_from(gear)
    need_tangents(model)
    print_gear_notes(model)
    unfinished = out / "unfinished"
    transient, points, reach = options.transient, options.points, options.reach
    sections_of = cached_sections(unfinished, model, transient, points, workers)
    starts = random_starts(model, options.starts, np.random.default_rng(options.seed), reach)
    shared = explore(sections_of, starts, symmetry(model), progress=_bar("starts"))
    plane = None
    if options.slice:
        attractors, bar = shared.attractors, _bar("slice")
        plane = explore_slice(model, sections_of, options.slice, reach, attractors, bar)
    all_attractors = (plane[1] if plane else shared).attractors
    shared = Basins(all_attractors, shared.labels)
    last = transient + points - 1
    motions = [identify_motion(model, attractor, at=last) for attractor in all_attractors]
    pairs = zip(motions, all_attractors, strict=True)
    names = [attractor.named(kind) for (kind, _), attractor in pairs]
    growths = [growth for _, growth in motions]
    rows = table(names, growths, shared, plane[1] if plane else None)
    write(out, rows, starts, shared, plane)
    drawn = portraits(model, all_attractors[:PORTRAITS], last)
    save(basins_figure(drawn, names, shared, plane), out, "basins")
    shutil.rmtree(unfinished)
    print(text(rows, shared))
    print(f"written: {out / 'basins.csv'}, {out / 'basins.png'}")
    return 0


def _bar(name: str) -> Callable[[Iterable[int]], Iterable[int]]:
    return lambda chunks: tqdm(chunks, desc=name, unit="chunk", disable=None)


def cached_sections(
    folder: Path, model: Model, transient: int, points: int, workers: int = 1
) -> Sections:
    """Return ``gear_sections`` of a model with the results cached in a folder."""
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
    """Aligned text table of the rows, with the number of failed runs."""
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
        rows: rows of ``basins.csv``.
        starts: (n, n_state) random starts.
        shared: attractors that the random starts lead to.
        plane: axis (n,) of the slice, and attractors of its (n, n) starts; None: no slice.
    """
    write_csv(folder / "basins.csv", HEAD, rows)
    states = ",".join(["attractor", *(f"y_{i}" for i in range(starts.shape[1]))])
    _save(folder / "starts.csv", np.column_stack([shared.labels + 1, starts]), states)
    (folder / "slice.csv").unlink(missing_ok=True)
    if plane:
        axis, basins = plane
        difference, common = np.meshgrid(axis, axis, indexing="ij")
        columns = [basins.labels.ravel() + 1, common.ravel(), difference.ravel()]
        _save(folder / "slice.csv", np.column_stack(columns), "attractor,shared,difference")


def _save(path: Path, data: Array, head: str) -> None:
    formats = ["%d"] + ["%.12g"] * (data.shape[1] - 1)
    np.savetxt(path, data, fmt=formats, delimiter=",", header=head, comments="")
