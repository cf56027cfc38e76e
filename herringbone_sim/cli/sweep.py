"""``sweep``: bifurcation diagrams over a parameter, and grids of more of them."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from herringbone_sim.cli.parameter_options import add_parameter_options
from herringbone_sim.cli.sweep_options import (
    add_sweep_options,
    chunk_from,
    looked_at,
    run_all,
    swept_gear,
    tell,
)
from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.sweeps.diagram import Diagram, diagram_of
from herringbone_sim.sweeps.grid import STARTS, Sweep, axis_from_text
from herringbone_sim.sweeps.store import FILE, Store, load_result, load_store, open_store
from herringbone_sim.views.figures.diagram import write_diagram

WAYS = {
    "fixed": ("fixed",),
    "up": ("up",),
    "down": ("down",),
    "both": ("up", "down"),
    "held": ("fixed", "up", "down"),
    "ramp": ("ramp_up", "ramp_down"),
    "all": ("fixed", "up", "down", "ramp_up", "ramp_down"),
}
DESCRIPTION = """\
Motion over the values of a parameter: period, Lyapunov exponents, contact and section points of
each, and a bifurcation diagram. A value is reached

  fixed  from the initial state of the gear, each by itself
  up     from where the value below it ended: a continuation, which keeps to its motion
  down   from where the value above it ended
  both   up and down: where they differ, there is hysteresis
  held   fixed, up and down
  ramp   while the parameter moves a little every mesh cycle, --cycles of them from one value to
         the next, up and down, through the same change that the node makes
  all    all of these

Repeat the command to go on with a sweep that was cut off; the diagram shows every way that DIR
holds. Several --over make a grid, without a diagram. A folder DIR/START a way holds sweep.json
and Parquet tables (parts/).
"""
EXAMPLES = """\
python -m herringbone_sim sweep --over delta_T=0:100:200 \\
    --parameters config/paper.yaml --out diagram
python -m herringbone_sim sweep --over K=0:0.6:40 --set xi=0.085 --start both --out over_K
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``sweep``."""
    parser = add_verb(subparsers, "sweep", DESCRIPTION, EXAMPLES)
    add_parameter_options(parser)
    parser.add_argument(
        "--over",
        action="append",
        required=True,
        metavar="NAME=LOW:HIGH:COUNT",
        help="values of a parameter, or NAME=VALUE,VALUE,...; continuations follow the first",
    )
    parser.add_argument(
        "--start", choices=tuple(WAYS), default="fixed", help="how to get to a value [%(default)s]"
    )
    parser.add_argument(
        "--mesh", metavar="NAME", help="mesh whose displacements are drawn (default: the first)"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to fill")
    add_sweep_options(parser)
    parser.set_defaults(func=sweep)


def sweep(args: argparse.Namespace) -> int:
    """Run, draw and tell; exit code 0."""
    base, effects = swept_gear(args)
    axes = tuple(axis_from_text(text) for text in args.over)
    look = looked_at(args, (base, effects), axes, args.mesh or base.layout.meshes[0])
    stores = [
        open_store(
            args.out / way, Sweep(base, axes, look, way, chunk_from(args, way, effects), effects)
        )
        for way in WAYS[args.start]
    ]
    run_all(stores, args)
    for store in stores:
        tell(load_result(store))
    if len(axes) == 1:
        diagram = diagram_of([load_result(store) for store in _alike(args.out, stores[0])])
        _tell_hysteresis(diagram)
        paths = write_diagram(args.out, diagram)
        print(f"written: {', '.join(map(str, paths))}")
    return 0


def _alike(folder: Path, asked: Store) -> list[Store]:
    """Sweeps in a folder, of this run or an earlier one, that differ in their start alone."""
    there = [folder / way for way in STARTS if (folder / way / FILE).exists()]
    stores = [load_store(path) for path in there]
    return [
        s
        for s in stores
        if s.kernel == asked.kernel
        and replace(asked.sweep, start=s.sweep.start, chunk=s.sweep.chunk) == s.sweep
    ]


def _tell_hysteresis(diagram: Diagram) -> None:
    if len(diagram.branches) > 1:
        apart = int(diagram.hysteresis().sum())
        print(f"different motions by different ways at {apart} of {len(diagram.axis)} values")
