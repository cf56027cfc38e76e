"""``orbits``: periodic orbits over a parameter, stable or not, with their boundaries named."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from herringbone_sim.analysis.periods import find_period
from herringbone_sim.cli.parameter_options import add_parameter_options, parameters_from
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.boundaries import Boundary
from herringbone_sim.dynamics.cascade import Followed, Options, explore
from herringbone_sim.dynamics.continuation import Family
from herringbone_sim.dynamics.flow import GearFlow, settle
from herringbone_sim.dynamics.gear_family import SWEPT, Gears, gear_family
from herringbone_sim.dynamics.orbits import (
    Array,
    closest_return,
    find_orbit,
    iterate,
    least_period,
)
from herringbone_sim.dynamics.turning import section
from herringbone_sim.errors import AnalysisError, ParameterError
from herringbone_sim.views.figures import save
from herringbone_sim.views.orbit_figures import orbit_figure, stability_of

WINDOW, RETURNS = 160, 2000  # mesh cycles in which a period, a near return, is looked for
MAX_PERIOD = 64
NONE = complex("nan")
DESCRIPTION = """\
Follow a periodic orbit over a parameter by pseudo-arclength continuation, through its folds and
where it is unstable, and the orbits of twice the period that leave it. Every boundary is located
and named:

  flip            a multiplier passes -1: the period doubles
  fold            a multiplier passes +1 and the branch turns back
  crossing        a multiplier passes +1 and the branch goes on
  Neimark-Sacker  a complex pair passes the unit circle
  transverse      left and right part, while the motion within symmetry stays what it is
  grazing         a mesh touches a border of its backlash; contact appears or is lost
"""
EPILOG = """\
examples:
  python -m herringbone_sim orbits --parameters config/paper.yaml --over delta_T --from 60 --to 100
      --start 85 72 --out orbits/delta_T
  python -m herringbone_sim orbits --parameters config/paper.yaml --over xi --from 0.1 --to 0.2
      --start 0.14 --out orbits/xi

DIR then holds orbits.png and .svg, branches.csv (one line an orbit), sections.csv (its states at
phase 0) and boundaries.csv."""


def add_parser(subparsers: Any) -> None:
    """Register ``orbits`` with the sub-parsers of the command line."""
    parser = subparsers.add_parser(
        "orbits",
        help="follow periodic orbits over a parameter and name their boundaries",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_parameter_options(parser)
    add = parser.add_argument
    add("--over", required=True, choices=SWEPT, metavar="NAME", help=", ".join(SWEPT))
    add("--from", dest="low", type=float, required=True, metavar="LOW", help="end of the range")
    add("--to", dest="high", type=float, required=True, metavar="HIGH", help="its other end")
    add(
        "--start",
        type=_start,
        nargs="+",
        required=True,
        metavar="VALUE[:N]",
        help="where an orbit is found: the motion there, which must be periodic, or with :N an "
        "orbit of N mesh cycles near it, stable or not",
    )
    add("--max-period", type=int, default=4, metavar="N", help="of doubled orbits (default: 4)")
    add("--asymmetric", action="store_true", help="follow orbits whose left and right differ too")
    add("--settle", type=int, default=1000, metavar="CYCLES", help="before --start is looked at")
    add("--mesh", metavar="NAME", help="that the figure shows (default: the first)")
    add("--out", type=Path, required=True, metavar="DIR", help="folder to write to")
    parser.set_defaults(func=run)


def run(args: argparse.Namespace) -> int:
    """Follow the orbits of ``args`` and write them; errors of the package when it can't be."""
    p = parameters_from(args)
    family, watch = gear_family(p, args.over, args.low, args.high)
    mesh = _mesh(args.mesh, p)
    starts = [(v, find_start(Gears(p, args.over), family, v, n, args)) for v, n in args.start]
    options = Options(max_period=args.max_period, asymmetric=args.asymmetric)

    with tqdm(desc="branches", unit="", disable=None) as bar:
        found = explore(family, starts, watch, options, lambda _: bar.update())
    _write(args.out, found, p)
    save(orbit_figure(found, args.over, mesh, p.layout.meshes[mesh]), args.out, "orbits")
    print(summary(found, args.over))
    print(f"written: {args.out / 'orbits.png'}")
    return 0


def _mesh(name: str | None, p: Parameters) -> int:
    meshes = p.layout.meshes
    if name is not None and name not in meshes:
        raise ParameterError(f"--mesh must be one of {', '.join(meshes)}, got {name!r}")
    return meshes.index(name) if name else 0


def _start(text: str) -> tuple[float, int | None]:
    """Value and period of ``85`` or ``85:2``."""
    value, _, period = text.partition(":")
    if period and not 1 <= int(period) <= MAX_PERIOD:
        raise argparse.ArgumentTypeError(f"the period must lie in 1 .. {MAX_PERIOD}, got {period}")
    return float(value), int(period) if period else None


def find_start(
    gears: Gears, family: Family, value: float, period: int | None, args: argparse.Namespace
) -> Array:
    """States (period, n) of the orbit at a value of the parameter.

    Raises:
        AnalysisError: the motion is not periodic, or there is no orbit of that period near.
    """
    name = f"{args.over} = {value:g}"
    if not family.low <= value <= family.high:
        raise ParameterError(f"--start must lie in {family.low:g} .. {family.high:g}, got {name}")
    flow = gears(value)
    states = _periodic(flow, settle(flow, flow.start(), args.settle), period, name)
    orbit = find_orbit(flow, states, mirror=family.mirror)
    if not orbit.found:
        raise AnalysisError(
            f"no orbit of {orbit.period} cycles at {name}: {orbit.reason}; give another --start"
        )
    return orbit.points[: least_period(orbit.points)]


def _periodic(flow: GearFlow, y: Array, period: int | None, name: str) -> Array:
    """States (period, n) of a motion that is periodic, or that nearly closes."""
    if period:
        return closest_return(flow, y, period, RETURNS)
    states = iterate(flow, y, WINDOW)
    found = find_period(states).value
    if not found:
        raise AnalysisError(
            f"the motion at {name} is not periodic: give another --start, or --start VALUE:N to "
            f"look for an unstable orbit of N cycles near it"
        )
    return states[-found:]


def summary(found: Sequence[Followed], name: str) -> str:
    """Table of the branches, then of the boundaries by value."""
    rows = [["branch", "period", "left/right", "range", "points", "ends", "origin"]]
    for i, one in enumerate(found, start=1):
        values = [point.value for point in one.branch.points]
        sides = "alike" if one.symmetric else "differ"
        span = f"{min(values):.7g} .. {max(values):.7g}"
        ends = ", ".join(one.branch.ends)
        rows.append([str(i), f"P{one.period}", sides, span, str(len(values)), ends, one.origin])
    table = [[name, "kind", "branch", "period", "along the branch", "detail"]]
    table += [_row(number, b) for number, b in _ordered(found)]
    return f"{_aligned(rows)}\n\n{_aligned(table)}"


def _ordered(found: Sequence[Followed]) -> list[tuple[int, Boundary]]:
    numbered = [(i, b) for i, one in enumerate(found, start=1) for b in one.boundaries]
    return sorted(numbered, key=lambda pair: pair[1].value)


def _row(number: int, boundary: Boundary) -> list[str]:
    before, after = _words(boundary.before), _words(boundary.after)
    change = f"{before} -> {after}" if before != after else before
    value, kind = f"{boundary.value:.7g}", boundary.kind
    return [value, kind, str(number), f"P{boundary.period}", change, boundary.detail]


def _words(unstable: tuple[int, int]) -> str:
    within, transverse = unstable
    parts = [f"{within} within"] * bool(within) + [f"{transverse} transverse"] * bool(transverse)
    return "+".join(parts) or "stable"


def _aligned(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)


def _write(folder: Path, found: Sequence[Followed], p: Parameters) -> None:
    """The three tables; AnalysisError where the folder can't be written."""
    columns = [f"{a}_{m}" for a in "xv" for m in p.layout.meshes]
    head = ["branch", "index", "value"]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _table(folder / "branches.csv", [*head, *ORBIT_COLUMNS], _orbit_rows(found))
        _table(folder / "sections.csv", [*head, "cycle", *columns], _section_rows(found))
        _table(folder / "boundaries.csv", BOUNDARY_COLUMNS, _boundary_rows(found))
    except OSError as error:
        raise AnalysisError(
            f"--out must be a folder that can be written, got {folder} ({error.strerror})"
        ) from None


ORBIT_COLUMNS = [
    "period",
    "stability",
    "unstable_within",
    "unstable_transverse",
    "within_re",
    "within_im",
    "transverse_re",
    "transverse_im",
]
BOUNDARY_COLUMNS = [
    "value",
    "kind",
    "branch",
    "period",
    "detail",
    "within_before",
    "transverse_before",
    "within_after",
    "transverse_after",
    "changes_stability",
    "multiplier_re",
    "multiplier_im",
]


def _table(path: Path, head: Sequence[str], rows: Iterator[Sequence[object]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(head)
        table.writerows(rows)


def _orbit_rows(found: Sequence[Followed]) -> Iterator[Sequence[object]]:
    for i, one in enumerate(found, start=1):
        for j, point in enumerate(one.branch.points):
            mu = point.multipliers
            largest = [
                part[0] if len(part) else complex("nan") for part in (mu.within, mu.transverse)
            ]
            parts = [f"{x:.12g}" for value in largest for x in (value.real, value.imag)]
            stability = stability_of(point)
            yield [i, j, f"{point.value:.12g}", one.period, stability, *mu.unstable, *parts]


def _section_rows(found: Sequence[Followed]) -> Iterator[Sequence[object]]:
    for i, one in enumerate(found, start=1):
        for j, point in enumerate(one.branch.points):
            flow = one.curve.family.flow_at(point.value)
            for cycle, both in enumerate(np.hstack(section(flow, point.orbit.points))):
                yield [i, j, f"{point.value:.12g}", cycle, *(f"{x:.12g}" for x in both)]


def _boundary_rows(found: Sequence[Followed]) -> Iterator[Sequence[object]]:
    for number, b in _ordered(found):
        where = [f"{b.value:.12g}", b.kind, number, b.period, b.detail]
        mu = [f"{b.multiplier.real:.9g}", f"{b.multiplier.imag:.9g}"]
        yield [*where, *b.before, *b.after, b.changes_stability, *mu]
