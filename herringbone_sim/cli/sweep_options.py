"""Options of verbs that run sweeps, the observation that they ask for, and their summary."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.analysis.periods import MIN_REPEATS
from herringbone_sim.cli.options import add_number, add_workers, workers_from
from herringbone_sim.cli.parameter_options import gear_from, print_gear_notes, settings
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.flow import effect_cycles
from herringbone_sim.effects.assemble import build_with, in_slots
from herringbone_sim.effects.written import effects_text, read_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.execute import run_stores
from herringbone_sim.sweeps.grid import CHUNK, Axis, Observation, with_sweep_steps
from herringbone_sim.sweeps.store import Result, Store

CHAIN = 16  # values of a part of a continuation
SINGLE = 16  # values of a part of a gear that is not integrated in lanes
LEAST_SHARE = 5e-4  # of the values; rarer periods are not printed
REPEATS = 2 * MIN_REPEATS  # periods of the effects to observe: a period of two is found too
LONGEST = 100  # mesh cycles of a period of the effects up to which so many are observed


def add_sweep_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the observation, and of threads or a cluster."""
    add = parser.add_argument
    default = Observation()
    text = "mesh cycles to discard at each value"
    add_number(parser, "--transient", default.transient, text, "CYCLES")
    add(
        "--cycles",
        type=int,
        metavar="CYCLES",
        help=f"mesh cycles observed then [{default.cycles}, or {REPEATS} periods of effects whose "
        "period is longer than a cycle]",
    )
    add("--no-exponents", action="store_true", help="compute no Lyapunov exponents")
    add(
        "--chunk",
        type=int,
        metavar="N",
        help=f"values computed and stored together (default: {CHUNK}; {CHAIN} in a continuation; "
        f"{SINGLE} with an effect that no slot holds)",
    )
    add_workers(parser, default=None, scheduler=True)


def chunk_from(args: argparse.Namespace, start: str = "fixed", effects: str = "") -> int:
    """Values of a part of a sweep: ``--chunk``, or as many as take a few seconds."""
    if args.chunk is not None:
        return int(args.chunk)
    if start != "fixed":
        return CHAIN
    return CHUNK if in_slots(read_effects(effects)) else SINGLE


def swept_gear(args: argparse.Namespace) -> tuple[Parameters, str]:
    """Parameters, with the steps of a sweep unless the user set others, and effects."""
    base, actives = gear_from(args)
    return with_sweep_steps(base, settings(args.set)), effects_text(actives)


def observation_from(args: argparse.Namespace, mesh: str, forcing: int = 1) -> Observation:
    """How long each value is observed; prints a line where that is too short to find a period.

    Args:
        mesh: mesh whose section displacements are stored.
        forcing: period of the effects in mesh cycles; the observation spans several of it.
    """
    points = max(Observation().points, REPEATS * forcing if forcing <= LONGEST else 0)
    cycles = points if args.cycles is None else args.cycles
    result = Observation(args.transient, cycles, min(cycles, points), not args.no_exponents)
    if result.points < MIN_REPEATS * forcing:
        print(
            f"the effects repeat after {forcing} mesh cycles, and {result.points} are observed: "
            f"no period is told from fewer than {MIN_REPEATS * forcing} (--cycles)"
        )
    return replace(result, mesh=mesh)


def observation_of_gear(
    args: argparse.Namespace, gear: tuple[Parameters, str], axes: Sequence[Axis], mesh: str
) -> Observation:
    """``observation_from`` with the period of a gear's effects; prints the notes on the gear."""
    base, effects = gear
    try:
        p = base.changed({axis.name: axis.values[0] for axis in axes})
        model = build_with(p, read_effects(effects))
    except ParameterError:  # no gear there
        if effects:
            print(f"with effects: {effects}")
        return observation_from(args, mesh)
    print_gear_notes(model)
    return observation_from(args, mesh, effect_cycles(model))


def run_all(stores: Sequence[Store], args: argparse.Namespace) -> None:
    """Run the missing parts of some sweeps; on Ctrl-C print how many parts are stored."""
    workers = workers_from(args)
    try:
        run_stores(stores, workers, args.scheduler)
    except KeyboardInterrupt:
        done = sum(store.sweep.n_parts - len(store.missing()) for store in stores)
        total = sum(store.sweep.n_parts for store in stores)
        print(
            f"interrupted: {done} of {total} parts are stored; the same command goes on from there"
        )
        raise


def print_shares(result: Result) -> None:
    """Print the share of the values with each period, and the commonest failures."""
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
