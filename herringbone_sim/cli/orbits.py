"""``orbits``: periodic orbits over a parameter, stable or not, with their boundaries named."""

from __future__ import annotations

import argparse

from tqdm import tqdm

from herringbone_sim.cli.options import add_mesh, add_number, add_out
from herringbone_sim.cli.parameter_options import (
    add_parameter_options,
    gear_from,
    print_gear_notes,
)
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.cascade import CascadeOptions, trace_cascade
from herringbone_sim.dynamics.flow import GearFlow
from herringbone_sim.dynamics.gear_family import SWEPT, GearCache, gear_family
from herringbone_sim.dynamics.starts import find_start
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.orbits import orbit_figure
from herringbone_sim.views.figures.style import save
from herringbone_sim.views.tables.orbits import summary, write_orbits

MAX_PERIOD = 64
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

DIR then holds orbits.png and .svg, branches.csv (one line an orbit), sections.csv (its states at
phase 0) and boundaries.csv.
"""
EXAMPLES = """\
python -m herringbone_sim orbits --over delta_T --from 70 --to 90 --start 85 72 \\
    --parameters config/paper.yaml --out orbits
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
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
        help="value at which an orbit is sought: the motion there, which must be periodic, or "
        "with :N an orbit of N periods of the forcing near it, stable or not",
    )
    add_number(parser, "--max-period", 4, "largest period of doubled orbits")
    add("--asymmetric", action="store_true", help="follow orbits whose left and right differ too")
    text = "mesh cycles to discard before an orbit is sought at --start"
    add_number(parser, "--settle", 1000, text, "CYCLES")
    add_mesh(parser)
    add_out(parser)


def run(args: argparse.Namespace) -> int:
    """Follow the orbits, write tables and figure, print a summary; exit code 0.

    Raises:
        ParameterError: a gear that can't be built, no such mesh, or a start out of range.
        AnalysisError: no orbit at a start.
    """
    p, actives = gear_from(args)
    family, watch = gear_family(p, args.over, args.low, args.high, actives)
    mesh, gears = _mesh(args.mesh, p), GearCache(p, args.over, actives)
    _print_notes(gears(args.low))
    starts = [(v, find_start(gears, family, v, n, args.settle)) for v, n in args.start]
    make_folder(args.out)
    options = CascadeOptions(max_period=args.max_period, asymmetric=args.asymmetric)

    with tqdm(desc="branches", unit="", disable=None) as bar:
        branches = trace_cascade(family, starts, watch, options, lambda _: bar.update())
    write_orbits(args.out, branches, p)
    save(orbit_figure(branches, args.over, mesh, p.layout.meshes[mesh]), args.out, "orbits")
    print(summary(branches, args.over))
    if len(branches) == options.branches:
        print(f"stopped at {len(branches)} branches: lower --max-period, or the range")
    print(f"written: {args.out / 'orbits.png'}")
    return 0


def _print_notes(flow: GearFlow) -> None:
    print_gear_notes(flow.model)
    if flow.cycles > 1:
        print(f"the forcing repeats after {flow.cycles} mesh cycles: P1 takes as many")


def _mesh(name: str | None, p: Parameters) -> int:
    meshes = p.layout.meshes
    if name is not None and name not in meshes:
        raise ParameterError(f"--mesh must be one of {', '.join(meshes)}, got {name!r}")
    return meshes.index(name) if name else 0


def _start(text: str) -> tuple[float, int | None]:
    """Value and period of a text such as ``85`` or ``85:2``; None without a period."""
    value, _, period = text.partition(":")
    n = int(period) if period else None
    if n is not None and not 1 <= n <= MAX_PERIOD:
        raise argparse.ArgumentTypeError(f"the period must lie in 1 .. {MAX_PERIOD}, got {n}")
    return float(value), n
