"""Run the same sweep with two gears, such as the nominal one and the augmented one that a
diagnosis wrote, and compare: the boundaries between motions and of contact loss; the share of each
motion; the values at which several motions coexist. Starts are the initial state, continuations,
and random states with left and right drawn independently.

DIR then holds report.html, figures/ (PNG and SVG), boundaries.csv, values.csv, compare.json, and
the sweeps in nominal/ and augmented/. Repeat the command to continue one that was interrupted.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from herringbone_sim.cli.options import Count, Mesh, Out, flattened
from herringbone_sim.cli.parameter_options import Changes, print_gear_notes, unswept
from herringbone_sim.cli.sweep import WAYS
from herringbone_sim.cli.sweep_options import Gear, SweepOptions, observation_from, run_all
from herringbone_sim.core.parameters import meaning, to_mapping
from herringbone_sim.dynamics.flow import effect_cycles, forcing_cycles
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import load_gear
from herringbone_sim.sweeps.compare import (
    BoundaryShift,
    GearSweeps,
    coexisting,
    match_boundaries,
    shares,
)
from herringbone_sim.sweeps.forcing import first_model
from herringbone_sim.sweeps.grid import Axis, Observation, Sweep, axis_from_text, with_sweep_steps
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.sweeps.store import Store, load_result, open_store
from herringbone_sim.views.figures.compare import compare_figure, starts_figure
from herringbone_sim.views.figures.style import save
from herringbone_sim.views.pages.compare import (
    Comparison,
    cells,
    compare_page,
    headline,
    way_words,
)
from herringbone_sim.views.pages.html import write_page
from herringbone_sim.views.picture import Picture
from herringbone_sim.views.tables.csv_file import write_csv

MATCHED = ("fixed", "up", "down")  # ways whose boundaries are matched
SCATTER = 0.3  # standard deviation of random initial displacements [b_c]
SCALARS = ("period", "exponent", "exponent_error", "within", "transverse", "contact_loss")
SEPARATED = ("sun_separated", "ring_separated")
EXAMPLES = """\
python -m herringbone_sim compare config/rig.yaml config/paper.yaml \\
    --over delta_T=0:100:40 --out compared
"""


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of the sweeps of both gears."""

    over: Annotated[str, "NAME=LOW:HIGH:COUNT", "values of a parameter"]
    set: Changes = ()
    start: Annotated[Literal["fixed", "up", "down", "both", "held"], "how to get to a value"] = (
        "held"
    )
    starts: Annotated[Count, "random initial states at each value"] = 3
    mesh: Mesh = None
    out: Out


def run(
    nominal: Annotated[Path, "NOMINAL", "parameter file of the one gear"],
    augmented: Annotated[Path, "AUGMENTED", "that of the other, with its effects"],
    /,
    *,
    options: Options,
    sweep: SweepOptions = SweepOptions(),
) -> int:
    """Run both sweeps, write page, figures and tables, print a summary; exit code 0.

    Raises:
        ParameterError: a wrong file or axis, or a gear that can't be built.
        AnalysisError: the folder holds other sweeps.
    """
    axis = axis_from_text(options.over)
    files = {"nominal": nominal, "augmented": augmented}
    gears = both_gears(files, unswept(options.set, (axis.name,)))
    forcing = {name: forcing_of(name, gear, axis) for name, gear in gears.items()}
    mesh = options.mesh or gears["nominal"][0].layout.meshes[0]
    observation = observation_from(sweep, mesh, max(p for p, _ in forcing.values()))
    stores = {
        name: open_stores(
            options.out / name, ways_of(gear, axis, observation, options, sweep.chunk)
        )
        for name, gear in gears.items()
    }
    run_all([store for ways in stores.values() for store in ways.values()], sweep)
    sides = []
    for name, ways in stores.items():
        results = {way: load_result(store) for way, store in ways.items()}
        sides.append(GearSweeps(name, results, forcing[name][1]))
    write(options.out, sides[0], sides[1], facts(files, gears, sides))
    return 0


def both_gears(files: Mapping[str, Path], changes: dict[str, Any]) -> dict[str, Gear]:
    """Load both gears with the parameter changes and the integration steps of a sweep.

    Both get the model ``full`` if one of them has it and ``changes`` names no model.
    """
    gears = {name: load_gear(file) for name, file in files.items()}
    full = any(base.model == "full" for base, _ in gears.values()) and "model" not in changes
    every = {**changes, **({"model": "full"} if full else {})}
    return {
        name: (with_sweep_steps(base.changed(every), changes), actives)
        for name, (base, actives) in gears.items()
    }


def forcing_of(name: str, gear: Gear, axis: Axis) -> tuple[int, int]:
    """Return the periods of a gear's forcing and of its effects [mesh cycles]; print notes.

    Raises:
        ParameterError: the gear can't be built at the first value of the axis.
    """
    base, actives = gear
    try:
        model = first_model(base, actives, (axis,))
    except ParameterError as error:
        raise ParameterError(f"{name} gear at {axis.name} = {axis.values[0]:g}: {error}") from None
    print(f"{name}:")
    print_gear_notes(model)
    return forcing_cycles(model), effect_cycles(model)


def ways_of(
    gear: Gear, axis: Axis, observation: Observation, options: Options, chunk: int | None
) -> dict[str, Sweep]:
    """Sweeps of a gear by way to reach a value: those of ``start``, and ``random 1``, ..."""
    base, actives = gear
    gears = {way: (base, way) for way in WAYS[options.start]}
    for i in range(1, options.starts + 1):
        random = base.changed({"initial_noise": SCATTER, "seed": base.seed + i})
        gears[f"random {i}"] = random, "fixed"
    return {
        name: Sweep.of_gear(parameters, actives, (axis,), observation, start, chunk)
        for name, (parameters, start) in gears.items()
    }


def open_stores(folder: Path, sweeps: Mapping[str, Sweep]) -> dict[str, Store]:
    """Open a store for each sweep, in a subfolder named after its way (spaces become ``_``)."""
    return {
        way: open_store(folder / way.replace(" ", "_"), sweep) for way, sweep in sweeps.items()
    }


def facts(
    files: Mapping[str, Path], gears: Mapping[str, Gear], sides: list[GearSweeps]
) -> list[str]:
    """Text lines on both gears: files, effects, differing parameters, length of the runs."""
    lines = ["; ".join(f"{name}: {file}" for name, file in files.items())]
    for side in sides:
        effects = effects_text(gears[side.name][1])
        more = f"; P1 takes {side.forcing} mesh cycles" if side.forcing > 1 else ""
        lines.append(f"effects of the {side.name} gear: {effects or 'none'}{more}")
    first, second = (to_mapping(base) for base, _ in gears.values())
    unequal = [
        f"{name}: {_short(value)} / {_short(second[name])}"
        for name, value in first.items()
        if value != second[name]
    ]
    lines.append(f"parameters that differ: {'; '.join(unequal) or 'none'}")
    sweep = next(iter(sides[0].results.values())).sweep
    observation, axis = sweep.observation, sweep.axes[0]
    lines.append(
        f"{axis.name} = {axis.values[0]:g} to {axis.values[-1]:g}, {len(axis)} values, "
        f"{observation.transient} mesh cycles left out, "
        f"{observation.cycles} observed at each, from {len(sides[0].results)} starts"
    )
    return lines


def _short(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_short(element) for element in value)}]"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def write(out: Path, nominal: GearSweeps, augmented: GearSweeps, lines: list[str]) -> None:
    """Write page, figures and tables of the comparison; print a summary.

    Args:
        lines: text lines of ``facts``.
    """
    axis = nominal.axis
    ways = [way for way in nominal.results if way in MATCHED]
    by_way = {way: match_boundaries(nominal, augmented, way) for way in ways}
    unit = meaning(axis.name).unit
    comparison = Comparison(
        name=axis.name if unit == "-" else f"{axis.name} [{unit}]",
        facts=lines,
        moves=by_way,
        shares=shares(nominal, augmented, ways[0]),
        coexisting={side.name: coexisting(side) for side in (nominal, augmented)},
        pictures=draw(out, nominal, augmented, ways[0]),
    )
    page = write_page(out / "report.html", compare_page(comparison))
    write_tables(out, nominal, augmented, by_way)
    described = json.dumps(as_json(axis.name, comparison), indent=1)
    (out / "compare.json").write_text(described, encoding="utf-8")
    print("\n".join([*lines, *text(comparison)]))
    print(f"written: {page}, {out / 'boundaries.csv'}, {out / 'values.csv'}")


def draw(out: Path, nominal: GearSweeps, augmented: GearSweeps, way: str) -> list[Picture]:
    """Write the figures of one way to reach a value and of all ways; return them with captions."""
    folder = make_folder(out / "figures")
    over, _ = save(compare_figure(nominal, augmented, way), folder, "compare")
    starts, _ = save(starts_figure(nominal, augmented), folder, "starts")
    return [
        Picture(
            over,
            f"Both gears over one another, {way_words(way)}: section points, largest exponent, "
            "time without contact",
        ),
        Picture(starts, "The motion at each value by every way to it; white: no gear, or failed"),
    ]


def write_tables(
    out: Path,
    nominal: GearSweeps,
    augmented: GearSweeps,
    by_way: Mapping[str, list[BoundaryShift]],
) -> None:
    """Write ``boundaries.csv``, a row per boundary, and ``values.csv``, a row per simulation."""
    head = ["start", "kind", "before", "after"]
    rows = [
        (
            *(way, move.boundary.kind, move.boundary.before, move.boundary.after),
            *(b.value if b else None for b in (move.nominal, move.augmented)),
            *(move.shift, move.uncertainty),
        )
        for way, moves in by_way.items()
        for move in moves
    ]
    write_csv(out / "boundaries.csv", [*head, "nominal", "augmented", "shift", "error"], rows)
    names = (*SCALARS, *SEPARATED)
    values = (
        (side.name, way, value, name, *(float(result[column][i]) for column in names))
        for side in (nominal, augmented)
        for way, result in side.results.items()
        for i, (value, name) in enumerate(zip(side.axis.values, side.motions(way), strict=True))
    )
    write_csv(out / "values.csv", ["gear", "start", "value", "motion", *names], values)


def as_json(name: str, comparison: Comparison) -> dict[str, Any]:
    """Content of ``compare.json`` as plain values; None for the shift of an unmatched boundary."""
    boundaries = [
        asdict(move)
        | {"shift": None if math.isnan(move.shift) else move.shift, "error": move.uncertainty}
        for moves in comparison.moves.values()
        for move in moves
    ]
    return {
        "parameter": name,
        "facts": list(comparison.facts),
        "boundaries": boundaries,
        "shares": {k: {"nominal": a, "augmented": b} for k, (a, b) in comparison.shares.items()},
        "coexisting": {k: [asdict(s) for s in v] for k, v in comparison.coexisting.items()},
    }


def text(comparison: Comparison) -> list[str]:
    """Text lines for the terminal: boundaries, fractions of each motion, coexisting motions."""
    lines = []
    for way, moves in comparison.moves.items():
        lines.append(f"{way_words(way)}: {headline(moves)}")
        lines += [_line(move) for move in moves]
    percentages = [f"{name} {a:.1%} / {b:.1%}" for name, (a, b) in comparison.shares.items()]
    lines.append(f"share of the values, nominal / augmented: {', '.join(percentages)}")
    for gear, stretches in comparison.coexisting.items():
        spans = [f"{s.low:g} to {s.high:g} {' and '.join(s.motions)}" for s in stretches]
        lines.append(f"coexisting motions, {gear}: {'; '.join(spans) or 'none for long'}")
    return lines


def _line(move: BoundaryShift) -> str:
    name, nominal, augmented, shift = cells(move)
    return f"  {move.boundary.kind:8s}{name:32s}{nominal:>10s}{augmented:>10s}   {shift}"
