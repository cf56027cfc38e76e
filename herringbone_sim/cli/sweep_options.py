"""Options that ``sweep`` and ``map`` share, and what both say in the end."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.cli.parameter_options import gear_from, settings
from herringbone_sim.cli.workers import add_workers, workers_from
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.written import effects_text
from herringbone_sim.sweeps.execute import run_stores
from herringbone_sim.sweeps.grid import CHUNK, Observation, for_sweeps
from herringbone_sim.sweeps.store import Result, Store

CHAIN = 16
LEAST_SHARE = 5e-4  # of the values; rarer periods are not told


def add_sweep_options(parser: argparse.ArgumentParser) -> None:
    """Add how long to look, and on what to run."""
    add = parser.add_argument
    default = Observation()
    add(
        "--transient",
        type=int,
        default=default.transient,
        metavar="CYCLES",
        help="mesh cycles left out at each value [%(default)s]",
    )
    add(
        "--cycles",
        type=int,
        default=default.cycles,
        metavar="CYCLES",
        help="mesh cycles observed then [%(default)s]",
    )
    add("--no-exponents", action="store_true", help="leave the Lyapunov exponents out")
    add(
        "--chunk",
        type=int,
        metavar="N",
        help=f"values computed and stored together (default: {CHUNK}; {CHAIN} where one starts "
        "from the other)",
    )
    add_workers(parser, default=None)
    add(
        "--scheduler",
        metavar="ADDRESS",
        help="run on this Dask cluster instead, as tcp://HOST:8786",
    )


def chunk_from(args: argparse.Namespace, start: str = "fixed") -> int:
    """Values a part: as asked for, or as many as make a few seconds of work."""
    if args.chunk is not None:
        return int(args.chunk)
    return CHUNK if start == "fixed" else CHAIN


def swept_gear(args: argparse.Namespace) -> tuple[Parameters, str]:
    """The gear asked for, with the steps of a sweep where the user set no others; its effects."""
    base, actives = gear_from(args)
    return for_sweeps(base, settings(args.set)), effects_text(actives)


def observation_from(args: argparse.Namespace, mesh: str) -> Observation:
    """How each value is looked at; all cycles observed are section points, 100 at most."""
    points = min(args.cycles, Observation().points)
    chosen = Observation(args.transient, args.cycles, points, not args.no_exponents)
    return replace(chosen, mesh=mesh)


def run_all(stores: Sequence[Store], args: argparse.Namespace) -> None:
    """Run what is missing; an interruption says how to go on."""
    workers = workers_from(args)
    try:
        run_stores(stores, workers, args.scheduler)
    except KeyboardInterrupt:
        done = sum(store.sweep.n_parts - len(store.missing()) for store in stores)
        total = sum(store.sweep.n_parts for store in stores)
        print(
            f"interrupted: {done} of {total} parts are kept; the same command goes on from there"
        )
        raise


def tell(result: Result) -> None:
    """Print the shares of the periods, and how often which reason to fail was met."""
    if result.sweep.effects:
        print(f"with effects: {result.sweep.effects}")
    period = result["period"]
    values, counts = np.unique(period[np.isfinite(period)], return_counts=True)
    pairs = zip(values, counts / period.size, strict=True)
    shares = [
        f"{'aperiodic' if value == 0 else f'P{value:.0f}'} {share:.1%}"
        for value, share in pairs
        if share >= LEAST_SHARE
    ]
    print(f"{result.sweep.start}: {period.size} values: {', '.join(shares) or 'no periods'}")
    for failure in result.failures()[:5]:
        print(f"  {failure}")
