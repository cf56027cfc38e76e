"""Options that ``sweep`` and ``map`` share, and what both say in the end."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.analysis.periods import MIN_REPEATS
from herringbone_sim.cli.parameter_options import gear_from, settings, tell_gear
from herringbone_sim.cli.workers import add_workers, workers_from
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.flow import effect_cycles
from herringbone_sim.effects.assemble import build_with, in_slots
from herringbone_sim.effects.written import effects_text, read_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.execute import run_stores
from herringbone_sim.sweeps.grid import CHUNK, Axis, Observation, with_sweep_steps
from herringbone_sim.sweeps.store import Result, Store

CHAIN = 16
SINGLE = 16  # of gears whose values run one after another
LEAST_SHARE = 5e-4  # of the values; rarer periods are not told
REPEATS = 2 * MIN_REPEATS  # periods of the effects looked at: twice one is told too
LATEST = 100  # mesh cycles of a period of the effects beyond which so many take too long


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
        metavar="CYCLES",
        help=f"mesh cycles observed then [{default.cycles}, or {REPEATS} periods of effects that "
        "repeat later than each cycle]",
    )
    add("--no-exponents", action="store_true", help="leave the Lyapunov exponents out")
    add(
        "--chunk",
        type=int,
        metavar="N",
        help=f"values computed and stored together (default: {CHUNK}; {CHAIN} where one starts "
        f"from the other; {SINGLE} with an effect that no slot holds)",
    )
    add_workers(parser, default=None)
    add(
        "--scheduler",
        metavar="ADDRESS",
        help="run on this Dask cluster instead, as tcp://HOST:8786",
    )


def chunk_from(args: argparse.Namespace, start: str = "fixed", effects: str = "") -> int:
    """Values a part: as asked for, or as many as make a few seconds of work."""
    if args.chunk is not None:
        return int(args.chunk)
    if start != "fixed":
        return CHAIN
    return CHUNK if in_slots(read_effects(effects)) else SINGLE


def swept_gear(args: argparse.Namespace) -> tuple[Parameters, str]:
    """The gear asked for, with the steps of a sweep where the user set no others; its effects."""
    base, actives = gear_from(args)
    return with_sweep_steps(base, settings(args.set)), effects_text(actives)


def observation_from(args: argparse.Namespace, mesh: str, forcing: int = 1) -> Observation:
    """How each value is looked at; all cycles observed are section points, 100 at most.

    Args:
        forcing: mesh cycles after which effects repeat: there are ten times as many points then.
    """
    most = max(Observation().points, REPEATS * forcing if forcing <= LATEST else 0)
    cycles = most if args.cycles is None else args.cycles
    chosen = Observation(args.transient, cycles, min(cycles, most), not args.no_exponents)
    if chosen.points < MIN_REPEATS * forcing:
        print(
            f"the effects repeat after {forcing} mesh cycles, and {chosen.points} are looked at: "
            f"no period is told from fewer than {MIN_REPEATS * forcing} (--cycles)"
        )
    return replace(chosen, mesh=mesh)


def looked_at(
    args: argparse.Namespace, gear: tuple[Parameters, str], axes: Sequence[Axis], mesh: str
) -> Observation:
    """How the values of a gear with effects are looked at; prints what is special about it."""
    base, effects = gear
    try:
        p = base.changed({axis.name: axis.values[0] for axis in axes})
        model = build_with(p, read_effects(effects))
    except ParameterError:  # no gear there
        if effects:
            print(f"with effects: {effects}")
        return observation_from(args, mesh)
    tell_gear(model)
    return observation_from(args, mesh, effect_cycles(model))


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
