"""A step of a paused loop by a number of mesh cycles, and its result."""

from __future__ import annotations

import math
from concurrent.futures import Future
from dataclasses import dataclass

from herringbone_sim.core.integrate import State
from herringbone_sim.core.model import Model


@dataclass(frozen=True)
class Stepped:
    """Result of a step.

    Attributes:
        cycles: mesh cycles advanced; a whole number unless the step ended early.
        t_s: simulation time reached [s].
        cut: why the step ended early; empty if it did not.
    """

    cycles: float
    t_s: float
    cut: str = ""


class Step:
    """A step under way; the loop counts the remaining samples, and ends it between two blocks.

    Args:
        cycles: mesh cycles to advance, at least 1.
        model, state: model and state at the beginning.

    Attributes:
        left: number of samples still to be computed.
        cut: why it is to end early; empty if it is not.
        ended: future with the result.
    """

    def __init__(self, cycles: int, model: Model, state: State) -> None:
        self.cycles = cycles
        self.left = cycles * model.parameters.samples_per_cycle
        self.cut = ""
        self.ended: Future[Stepped] = Future()
        self.begin(model, state)

    def begin(self, model: Model, state: State) -> None:
        """Count the mesh cycles from this state on."""
        self._began = turns(model, state)

    def changed(self, old: Model, new: Model) -> None:
        """Convert ``left`` to the samples per mesh cycle of another model."""
        ratio = new.parameters.samples_per_cycle / old.parameters.samples_per_cycle
        self.left = math.ceil(self.left * ratio)

    def done(self, model: Model, state: State) -> float:
        """Mesh cycles advanced so far."""
        return turns(model, state) - self._began

    def end(self, model: Model, state: State) -> None:
        """Set the result, for which the caller of ``Loop.step`` waits."""
        self.ended.set_result(Stepped(self.done(model, state), state.t, self.cut))


def turns(model: Model, state: State) -> float:
    """Mesh cycles from t = 0 to a state, with the fraction of the current one."""
    return state.cycle + state.index / model.parameters.steps
