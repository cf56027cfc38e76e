"""A step of a paused loop: a number of mesh cycles, and what became of them."""

from __future__ import annotations

import math
from concurrent.futures import Future
from dataclasses import dataclass

from herringbone_sim.core.integrate import State
from herringbone_sim.core.model import Model


@dataclass(frozen=True)
class Stepped:
    """What came of a step.

    Attributes:
        cycles: mesh cycles advanced; whole unless the step was cut short.
        t_s: simulation time [s] reached.
        cut: what ended it before its end; empty when nothing did.
    """

    cycles: float
    t_s: float
    cut: str = ""


class Step:
    """A step under way; its loop counts the samples left, and ends it between two blocks.

    Args:
        cycles: mesh cycles wanted, at least 1.
        model, state: in force as it begins.
    """

    def __init__(self, cycles: int, model: Model, state: State) -> None:
        self.cycles = cycles
        self.left = cycles * model.parameters.samples_per_cycle
        self.cut = ""
        self.ended: Future[Stepped] = Future()
        self._began = turns(model, state)

    def changed(self, old: Model, new: Model) -> None:
        """Count on in the samples of another model."""
        ratio = new.parameters.samples_per_cycle / old.parameters.samples_per_cycle
        self.left = math.ceil(self.left * ratio)

    def done(self, model: Model, state: State) -> float:
        """Mesh cycles advanced so far."""
        return turns(model, state) - self._began

    def end(self, model: Model, state: State) -> None:
        """Tell whoever waits what came of it."""
        self.ended.set_result(Stepped(self.done(model, state), state.t, self.cut))


def turns(model: Model, state: State) -> float:
    """Mesh cycles of a state since t = 0."""
    return state.cycle + state.index / model.parameters.steps
