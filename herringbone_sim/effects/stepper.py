"""Simulate a gear with effects, and continue a run after a change of its effects."""

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


def stepper(model: Model, actives: Sequence[Active]) -> Stepper:
    """Return the stepper of a model with effects; ParameterError as ``assemble``."""
    return integrate.stepper(assemble(model, actives))


def change(old: Stepper, new: Stepper, state: State) -> State:
    """Return the state that continues a run after a change of live parameters or effects.

    Displacements and velocities do not change, see ``core.integrate.change``. An effect that stays
    at its place keeps its states even if its size changes; states of a new effect are at rest.
    Tangents, as many as before, and their growth are initialised again.
    """
    n = old.model.layout.n_state
    moved = integrate.change(old.model, new.model, replace(state, y=state.y[:n]))
    fresh = new.start(len(state.tangents))
    y = new.with_added_values(np.concatenate([moved.y, fresh.y[n:]]), old.added_states(state.y))
    return replace(moved, y=y, tangents=fresh.tangents, growth=fresh.growth)


def simulate(
    model: Model, actives: Sequence[Active], cycles: int, state: State | None = None
) -> tuple[TimeSeries, State]:
    """Return samples of whole mesh cycles of a gear with effects, and the state after them.

    Sensor effects are applied to the samples; ``channels.distort`` applies them to any series.

    Args:
        actives: effects, which replace those of the model.
        state: start state; None: the initial state of the parameters.

    Raises:
        DivergenceError: the state left the range of any physical motion.
        ParameterError: as ``assemble``, or a channel that the gear lacks.
    """
    series, end = integrate.simulate(assemble(model, actives), cycles, state)
    return distort(series, tuple(actives)), end
