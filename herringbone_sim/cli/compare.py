"""``compare``: what moves between a nominal gear and the one that a diagnosis found."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from herringbone_sim.cli.parameter_options import add_set_option, settings, tell_gear
from herringbone_sim.cli.sweep import WAYS
from herringbone_sim.cli.sweep_options import (
    add_sweep_options,
    chunk_from,
    observation_from,
    run_all,
)
from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.core.parameters import Parameters, meaning, to_mapping
from herringbone_sim.dynamics.flow import effect_cycles
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import AnalysisError, ParameterError
from herringbone_sim.recording.parameter_file import load_gear
from herringbone_sim.sweeps.compare import (
    BoundaryShift,
    GearSweeps,
    coexisting,
    match_boundaries,
    shares,
)
from herringbone_sim.sweeps.grid import Axis, Observation, Sweep, axis_from_text, with_sweep_steps
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.sweeps.store import Store, load_result, open_store
from herringbone_sim.views.figures.compare import compare_figure, starts_figure
from herringbone_sim.views.figures.style import save
from herringbone_sim.views.pages.compare import (
    Told,
    cells,
    compare_page,
    headline,
    way_words,
)
from herringbone_sim.views.pages.report import Picture
from herringbone_sim.views.tables.csv_file import write_csv

Gear = tuple[Parameters, tuple[Active, ...]]
HELD = ("fixed", "up", "down")
SCATTER = 0.3  # b_c, standard deviation of random initial displacements
SCALARS = ("period", "exponent", "exponent_error", "within", "transverse", "contact_loss")
APART = ("sun_separated", "ring_separated")
DESCRIPTION = """\
Run the same sweep with two gears, such as the nominal one and the augmented one that a diagnosis
wrote, and tell what moves: the boundaries between motions, and where contact is lost; the share
of each motion; where several motions coexist, because different starts end differently. Beside
the initial state, continuations and random starts are tried, left and right each on its own.

DIR then holds report.html, figures/ (PNG and SVG), boundaries.csv, values.csv, compare.json, and
the sweeps in nominal/ and augmented/. Repeat the command to go on with one that was cut off.
"""
EXAMPLES = """\
python -m herringbone_sim compare config/rig.yaml config/paper.yaml \\
    --over delta_T=0:100:40 --out compared
"""


def add_parser(subparsers: Any) -> None:
    """Register ``compare`` with the sub-parsers of the command line."""
    parser = add_verb(subparsers, "compare", DESCRIPTION, EXAMPLES)
    add = parser.add_argument
    add("nominal", type=Path, metavar="NOMINAL", help="parameter file of the one gear")
    add("augmented", type=Path, metavar="AUGMENTED", help="that of the other, with its effects")
    add("--over", required=True, metavar="NAME=LOW:HIGH:COUNT", help="values of a parameter")
    add_set_option(parser)
    ways = [name for name in WAYS if name not in ("ramp", "all")]
    add("--start", choices=ways, default="held", help="how to get to a value [%(default)s]")
    add("--starts", type=int, default=3, metavar="N", help="random starts at each value [3]")
    add("--mesh", metavar="NAME", help="mesh whose displacements are drawn (default: the first)")
    add("--out", type=Path, required=True, metavar="DIR", help="folder to fill")
    add_sweep_options(parser)
    parser.set_defaults(func=compare)


def compare(args: argparse.Namespace) -> int:
    """Run both sweeps, draw and tell; exit code 0.

    Raises:
        ParameterError: a file, an axis or a gear that there can't be.
        AnalysisError: a folder with other sweeps in it.
    """
    if args.starts < 0:
        raise AnalysisError(f"--starts must be 0 or more, got {args.starts}")
    axis = axis_from_text(args.over)
    gears = both_gears(args)
    forcing = {name: forcing_of(name, gear, axis) for name, gear in gears.items()}
    mesh = args.mesh or gears["nominal"][0].layout.meshes[0]
    look = observation_from(args, mesh, max(forcing.values()))
    stores = {name: open_stores(args, name, gear, axis, look) for name, gear in gears.items()}
    run_all([store for ways in stores.values() for store in ways.values()], args)
    sides = [
        GearSweeps(name, {way: load_result(store) for way, store in ways.items()}, forcing[name])
        for name, ways in stores.items()
    ]
    write(args, sides[0], sides[1], facts(args, gears, sides))
    return 0


def both_gears(args: argparse.Namespace) -> dict[str, Gear]:
    """Nominal and augmented gear with the steps of a sweep; of all planets if one of them is."""
    chosen = settings(args.set)
    found = {"nominal": load_gear(args.nominal), "augmented": load_gear(args.augmented)}
    whole = any(base.model == "full" for base, _ in found.values()) and "model" not in chosen
    more = {**chosen, **({"model": "full"} if whole else {})}
    return {
        name: (with_sweep_steps(base.changed(more), chosen), actives)
        for name, (base, actives) in found.items()
    }


def forcing_of(name: str, gear: Gear, axis: Axis) -> int:
    """Mesh cycles after which the effects of a gear repeat; prints what is special about it."""
    base, actives = gear
    try:
        model = build_with(base.changed({axis.name: axis.values[0]}), actives)
    except ParameterError as error:
        raise ParameterError(f"{name} gear at {axis.name} = {axis.values[0]:g}: {error}") from None
    print(f"{name}:")
    tell_gear(model)
    return effect_cycles(model)


def open_stores(
    args: argparse.Namespace, name: str, gear: Gear, axis: Axis, look: Observation
) -> dict[str, Store]:
    """Folders of the sweeps of a gear by the way to each value."""
    base, actives = gear
    effects, folder = effects_text(actives), args.out / name
    sweeps = {
        way: Sweep(base, (axis,), look, way, chunk_from(args, way, effects), effects)
        for way in WAYS[args.start]
    }
    for i in range(1, args.starts + 1):
        random = base.changed({"initial_noise": SCATTER, "seed": base.seed + i})
        sweeps[f"random {i}"] = Sweep(
            random, (axis,), look, "fixed", chunk_from(args, effects=effects), effects
        )
    return {
        way: open_store(folder / way.replace(" ", "_"), sweep) for way, sweep in sweeps.items()
    }


def facts(
    args: argparse.Namespace, gears: Mapping[str, Gear], sides: list[GearSweeps]
) -> list[str]:
    """Lines about both gears: files, effects, parameters that differ, how long they are run."""
    lines = [f"nominal: {args.nominal}; augmented: {args.augmented}"]
    for side in sides:
        effects = effects_text(gears[side.name][1])
        more = f"; P1 takes {side.forcing} mesh cycles" if side.forcing > 1 else ""
        lines.append(f"effects of the {side.name} gear: {effects or 'none'}{more}")
    one, other = (to_mapping(base) for base, _ in gears.values())
    apart = [f"{k}: {_short(v)} / {_short(other[k])}" for k, v in one.items() if v != other[k]]
    lines.append(f"parameters that differ: {'; '.join(apart) or 'none'}")
    sweep = next(iter(sides[0].results.values())).sweep
    look, axis = sweep.observation, sweep.axes[0]
    lines.append(
        f"{axis.name} = {axis.values[0]:g} to {axis.values[-1]:g}, {len(axis)} values, "
        f"{look.transient} mesh cycles left out, {look.cycles} observed at each, from "
        f"{len(sides[0].results)} starts"
    )
    return lines


def _short(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_short(one) for one in value)}]"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def write(
    args: argparse.Namespace, nominal: GearSweeps, augmented: GearSweeps, lines: list[str]
) -> None:
    """Page, figures and tables, and the same in short on the terminal."""
    axis, out = nominal.axis, args.out
    ways = [way for way in nominal.results if way in HELD]
    by_way = {way: match_boundaries(nominal, augmented, way) for way in ways}
    pictures = draw(out, nominal, augmented, ways[0])
    unit = meaning(axis.name).unit
    told = Told(
        name=axis.name if unit == "-" else f"{axis.name} [{unit}]",
        facts=lines,
        moves=by_way,
        shares=shares(nominal, augmented, ways[0]),
        coexisting={side.name: coexisting(side) for side in (nominal, augmented)},
        pictures=pictures,
    )
    (out / "report.html").write_text(compare_page(told), encoding="utf-8")
    write_tables(out, nominal, augmented, by_way)
    described = json.dumps(as_json(axis.name, told), indent=1)
    (out / "compare.json").write_text(described, encoding="utf-8")
    print("\n".join([*lines, *text(told)]))
    print(f"written: {out / 'report.html'}, {out / 'boundaries.csv'}, {out / 'values.csv'}")


def draw(out: Path, nominal: GearSweeps, augmented: GearSweeps, way: str) -> list[Picture]:
    """Both figures, as files and for the page."""
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
    """``boundaries.csv``, a line a boundary; ``values.csv``, a line a value of each sweep."""
    head = ["start", "kind", "before", "after"]
    rows = [
        (
            *(way, one.boundary.kind, one.boundary.before, one.boundary.after),
            *(b.value if b else None for b in (one.nominal, one.augmented)),
            *(one.shift, one.uncertainty),
        )
        for way, found in by_way.items()
        for one in found
    ]
    write_csv(out / "boundaries.csv", [*head, "nominal", "augmented", "shift", "error"], rows)
    names = (*SCALARS, *APART)
    values = (
        (side.name, way, value, name, *(float(found[column][i]) for column in names))
        for side in (nominal, augmented)
        for way, found in side.results.items()
        for i, (value, name) in enumerate(zip(side.axis.values, side.motions(way), strict=True))
    )
    write_csv(out / "values.csv", ["gear", "start", "value", "motion", *names], values)


def as_json(name: str, told: Told) -> dict[str, Any]:
    """What the page says, as plain values; null where there is none."""
    found = [
        {k: v for k, v in asdict(one).items()}
        | {"shift": one.shift if one.shift == one.shift else None, "error": one.uncertainty}
        for moved in told.moves.values()
        for one in moved
    ]
    return {
        "parameter": name,
        "facts": list(told.facts),
        "boundaries": found,
        "shares": {k: {"nominal": a, "augmented": b} for k, (a, b) in told.shares.items()},
        "coexisting": {k: [asdict(one) for one in v] for k, v in told.coexisting.items()},
    }


def text(told: Told) -> list[str]:
    """The page in short: boundaries, shares, coexisting motions."""
    lines = []
    for way, found in told.moves.items():
        lines.append(f"{way_words(way)}: {headline(found)}")
        lines += [_line(one) for one in found]
    pairs = told.shares.items()
    shared = ", ".join(f"{name} {a:.1%} / {b:.1%}" for name, (a, b) in pairs)
    lines.append(f"share of the values, nominal / augmented: {shared}")
    for gear, stretches in told.coexisting.items():
        spans = [f"{one.low:g} to {one.high:g} {' and '.join(one.motions)}" for one in stretches]
        lines.append(f"coexisting motions, {gear}: {'; '.join(spans) or 'none for long'}")
    return lines


def _line(move: BoundaryShift) -> str:
    name, nominal, augmented, shift = cells(move)
    return f"  {move.boundary.kind:8s}{name:32s}{nominal:>10s}{augmented:>10s}   {shift}"
