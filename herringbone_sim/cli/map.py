"""``map``: period, largest exponent and loss of contact over two parameters, as pictures."""

from __future__ import annotations

import argparse
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
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.grid import Sweep, axis_from_text
from herringbone_sim.sweeps.store import load_result, open_store
from herringbone_sim.views.figures.maps import write_maps

KINDS = {
    "delta_T-K": ("delta_T=0:100", "K=0:0.6"),
    "delta_T-xi": ("delta_T=0:100", "xi=0.02:0.2"),
    "Omega-T_1": ("Omega=0.2:2", "T_1=10:2000"),
}
DESCRIPTION = """\
Period, largest Lyapunov exponent and loss of contact over two parameters: a table (Parquet) and
pictures (PNG, SVG). Values that no gear can have, or whose motion diverges, stay white; the
reasons are counted. Repeat the command to go on with a map that was cut off.
"""
EXAMPLES = """\
python -m herringbone_sim map --kind delta_T-K --size 40 \\
    --parameters config/paper.yaml --out map
python -m herringbone_sim map --over delta_T=0:100:40 --over xi=0.02:0.2:40 \\
    --set K=0.3 --out map_xi
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``map``."""
    parser = add_verb(subparsers, "map", DESCRIPTION, EXAMPLES)
    add_parameter_options(parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--over",
        action="append",
        metavar="NAME=LOW:HIGH:COUNT",
        help="values of a parameter, given twice: to the right, then upwards",
    )
    shown = ", ".join(f"{kind} ({' x '.join(axes)})" for kind, axes in KINDS.items())
    what.add_argument("--kind", choices=tuple(KINDS), help=f"ready-made axes: {shown}")
    parser.add_argument(
        "--size", type=int, default=200, metavar="N", help="values an axis of --kind [%(default)s]"
    )
    parser.add_argument(
        "--start",
        choices=("fixed", "up", "down"),
        default="fixed",
        help="each value from the initial state, or from where its neighbour on the first axis "
        "ended, which keeps to a motion as long as there is one; one core [%(default)s]",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to fill")
    add_sweep_options(parser)
    parser.set_defaults(func=draw_map)


def draw_map(args: argparse.Namespace) -> int:
    """Run, draw and tell; exit code 0.

    Raises:
        ParameterError: not two axes of two values or more.
    """
    texts = args.over or [f"{axis}:{args.size}" for axis in KINDS[args.kind]]
    if len(texts) != 2:
        raise ParameterError(f"a map has two axes, got {len(texts)}: give --over twice")
    axes = tuple(axis_from_text(text) for text in texts)
    if min(map(len, axes)) < 2:
        sizes = " x ".join(str(len(axis)) for axis in axes)
        raise ParameterError(
            f"a map needs two values or more on each axis, got {sizes}: raise --size or give more"
        )
    base, effects = swept_gear(args)
    look, chunk = (
        looked_at(args, (base, effects), axes, mesh=""),
        chunk_from(args, effects=effects),
    )
    asked = Sweep(base, axes, look, args.start, chunk, effects)
    store = open_store(args.out, asked)
    run_all([store], args)
    result = load_result(store)
    tell(result)
    print("written:", *(str(path) for path in write_maps(args.out, result)), sep="\n  ")
    return 0
