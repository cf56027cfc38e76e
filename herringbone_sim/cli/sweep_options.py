"""Options of verbs that run sweeps, and functions that apply them, run and summarise."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

from herringbone_sim.analysis.periods import MIN_REPEATS
from herringbone_sim.cli.options import Count, Cycles, Scheduler, flattened, limits
from herringbone_sim.cli.parameter_options import (
    GearOptions,
    gear_from,
    print_gear_notes,
    unswept,
)
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.flow import forcing_cycles
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.diagram import period_shares
from herringbone_sim.sweeps.execute import run_stores
from herringbone_sim.sweeps.forcing import REPEATS, first_model, observation_of
from herringbone_sim.sweeps.grid import CHUNK, SMALL_CHUNK, Axis, Observation, with_sweep_steps
from herringbone_sim.sweeps.store import Result, Store

SEEN = Observation()
Gear = tuple[Parameters, tuple[Active, ...]]


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class SweepOptions:
    """Options of a sweep: what is observed at each value, and on which cores or cluster."""

    transient: Annotated[Cycles, "mesh cycles to discard at each value"] = SEEN.transient
    cycles: Annotated[
        Cycles | None,
        f"mesh cycles observed then [{SEEN.cycles}, or {REPEATS} periods of effects or "
        "control whose period is longer than a cycle]",
    ] = None
    no_exponents: Annotated[bool, "compute no Lyapunov exponents"] = False
    chunk: Annotated[
        Count | None,
        f"values computed and stored together (default: {CHUNK}; {SMALL_CHUNK} in a continuation, "
        "and for a gear that is integrated by the laws of its effects, which is slower)",
    ] = None
    workers: Annotated[Count | None, limits(gte=1), "cores of this machine (default: all)"] = None
    scheduler: Scheduler = None


def swept_gear(gear: GearOptions, axes: Sequence[Axis]) -> Gear:
    """Parameters of the gear to sweep, and its effects.

    The integration steps are those of a sweep unless ``--set`` names them.

    Raises:
        ParameterError: ``--set`` names an axis.
    """
    base, actives = gear_from(gear)
    return with_sweep_steps(base, unswept(gear.set, [axis.name for axis in axes])), actives


def observation_from(options: SweepOptions, mesh: str, forcing: int = 1) -> Observation:
    """Build the observation at each value of a sweep; print a line if it is too short for periods.

    Args:
        mesh: mesh whose section displacements are stored.
        forcing: period of control and effects in mesh cycles, see ``forcing.observation_of``.
    """
    exponents = not options.no_exponents
    result = observation_of(forcing, options.transient, options.cycles, exponents)
    if result.points < MIN_REPEATS * forcing:
        why = f"the forcing repeats after {forcing} mesh cycles, and " if forcing > 1 else ""
        print(
            f"{why}{result.points} mesh cycles are observed: no period is told from fewer than "
            f"{MIN_REPEATS * forcing} (--cycles)"
        )
    return replace(result, mesh=mesh)


def observation_of_gear(
    options: SweepOptions, gear: Gear, axes: Sequence[Axis], mesh: str
) -> Observation:
    """Build the observation for a gear, long enough for the period of its forcing; print notes.

    Args:
        gear: parameters and effects.
        axes: the gear is built at the first value of each, at the largest K; if that fails, the
            period of the forcing is ignored.
    """
    base, actives = gear
    try:
        model = first_model(base, actives, axes)
    except ParameterError:  # no gear at this value
        if actives:
            print(f"with effects: {effects_text(actives)}")
        return observation_from(options, mesh)
    print_gear_notes(model)
    return observation_from(options, mesh, forcing_cycles(model))


def run_all(stores: Sequence[Store], options: SweepOptions) -> None:
    """Compute the missing parts of sweeps; on Ctrl-C print how many are stored, and re-raise."""
    try:
        run_stores(stores, options.workers or os.cpu_count() or 1, options.scheduler)
    except KeyboardInterrupt:
        done = sum(store.sweep.n_parts - len(store.missing()) for store in stores)
        total = sum(store.sweep.n_parts for store in stores)
        print(
            f"interrupted: {done} of {total} parts are stored; the same command goes on from there"
        )
        raise


def print_shares(result: Result) -> None:
    """Print the fraction of the values with each period, and the five commonest failures."""
    period = result["period"]
    shares = period_shares(period) or "no periods"
    print(f"{result.sweep.start}: {period.size} values: {shares}")
    for failure in result.failures()[:5]:
        print(f"  {failure}")
