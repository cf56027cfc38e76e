"""``map``: period, largest exponent and loss of contact over two parameters, as pictures."""

from __future__ import annotations

import argparse

from herringbone_sim.cli.options import add_number, add_out
from herringbone_sim.cli.parameter_options import add_parameter_options
from herringbone_sim.cli.sweep_options import (
    add_sweep_options,
    chunk_from,
    observation_of_gear,
    print_shares,
    run_all,
    swept_gear,
)
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
pictures (PNG, SVG). Values at which no gear can be built or the motion diverges stay white; the
reasons are counted. Repeat the command to continue a map that was interrupted.
"""
EXAMPLES = """\
python -m herringbone_sim map --kind delta_T-K --size 40 \\
    --parameters config/paper.yaml --out map
python -m herringbone_sim map --over delta_T=0:100:40 --over xi=0.02:0.2:40 \\
    --set K=0.3 --out map_xi
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_parameter_options(parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--over",
        action="append",
        metavar="NAME=LOW:HIGH:COUNT",
        help="values of a parameter, given twice: to the right, then upwards",
    )
    listed = ", ".join(f"{kind} ({' x '.join(axes)})" for kind, axes in KINDS.items())
    what.add_argument("--kind", choices=tuple(KINDS), help=f"ready-made axes: {listed}")
    add_number(parser, "--size", 200, "values along each axis of --kind")
    parser.add_argument(
        "--start",
        choices=("fixed", "up", "down"),
        default="fixed",
        help="each value from the initial state, or by continuation from the final state of its "
        "neighbour on the first axis, on one core [%(default)s]",
    )
    add_out(parser)
    add_sweep_options(parser)


def run(args: argparse.Namespace) -> int:
    """Run the map, print a summary, draw the pictures; exit code 0.

    Raises:
        ParameterError: there are not exactly two axes with two values or more.
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
    observation = observation_of_gear(args, (base, effects), axes, mesh="")
    chunk = chunk_from(args, effects=effects)
    store = open_store(args.out, Sweep(base, axes, observation, args.start, chunk, effects))
    run_all([store], args)
    result = load_result(store)
    print_shares(result)
    print("written:", *(str(path) for path in write_maps(args.out, result)), sep="\n  ")
    return 0
