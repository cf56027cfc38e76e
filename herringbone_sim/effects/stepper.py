"""Runs of a gear with effects: the stepper for some, a change of them, samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.core import integrate
from herringbone_sim.core.integrate import State, Stepper
from herringbone_sim.core.model import Model
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.assemble import assemble
from herringbone_sim.effects.channels import distort
from herringbone_sim.effects.effect import Active
from herringbone_sim.errors import DivergenceError


def stepper(model: Model, actives: Sequence[Active]) -> Stepper:
    """The stepper of the gear of a model with effects; ParameterError as ``assemble``."""
    return integrate.stepper(assemble(model, actives))


def change(old: Stepper, new: Stepper, state: State) -> State:
    """State with which a run goes on after a change of live parameters or effects.

    Displacements and rates are kept, see ``core.integrate.change``. An effect that stays where it
    was, of whatever size, keeps its own states; those of a new one are at rest. Tangents begin
    anew, as many as there were.
    """
    n = old.model.layout.n_state
    moved = integrate.change(old.model, new.model, replace(state, y=state.y[:n]))
    fresh = new.start(len(state.tangents))
    y = new.with_own(np.concatenate([moved.y, fresh.y[n:]]), old.own(state.y))
    return replace(moved, y=y, tangents=fresh.tangents, growth=fresh.growth)


def simulate(
    model: Model, actives: Sequence[Active], cycles: int, state: State | None = None
) -> tuple[TimeSeries, State]:
    """Samples of whole mesh cycles of a gear with effects, and the state after them.

    Sensor effects are in the samples, see ``channels.distort`` for them alone.

    Raises:
        DivergenceError: the motion left the range of any gear.
    """
    machine = stepper(model, actives)
    block = machine.advance(state or machine.start(), cycles * model.parameters.samples_per_cycle)
    if block.diverged:
        raise DivergenceError(
            f"the motion diverged at t = {block.rows[-1, 0]:.6g} s with "
            f"{', '.join(one.effect.id for one in actives)} and {model.parameters}"
        )
    series = TimeSeries(block.rows[:, 0].copy(), block.rows, model.layout.channels)
    return distort(series, tuple(actives)), block.end
