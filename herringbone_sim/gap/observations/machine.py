"""The gear as the engine takes it: observations with places, tolerances and a catalogue."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.diagnosis.products import Block
from herringbone_sim.diagnosis.search import Hypothesis
from herringbone_sim.gap.observations import curves, events, force_law, seats
from herringbone_sim.gap.observations.gear import Amplitudes, Gear

Array = NDArray[np.float64]


class GearMachine:
    """A gear's runs with all that may be wrong with them; see ``diagnosis.search.Machine``."""

    def __init__(self, gear: Gear) -> None:
        self.gear = gear
        self.places = curves.Places(gear)
        self.base = curves.tolerances(self.places)
        self.rows: Mapping[str, int] = {o: self.places.rows(o) for o in gear.functions}
        self.runs = len(gear.runs)

    @property
    def functions(self) -> Mapping[str, tuple[str, ...]]:
        return self.gear.functions

    def hypotheses(self) -> list[Hypothesis]:
        return list(curves.hypotheses(self.places))

    def proposals(self, amplitudes: Amplitudes) -> tuple[GearMachine, list[Hypothesis]]:
        """Events of teeth, rings and pins."""
        functions, on_bodies, seated = [], [], []
        found = events.proposals(self.gear, amplitudes)
        for _, own in found:
            functions += own
        for i, seat in enumerate(seats.proposals(self.gear, amplitudes)):
            label = f"seat {i} of {len(self.gear.law_functions)}"
            first, *rest = seat.functions(self.gear, label)
            functions.append(first)
            on_bodies += rest
            seated.append((seat, label))
        machine = GearMachine(self.gear.with_functions(functions, on_bodies))
        made = [events.place(machine.places, one) for one, _ in found]
        made += [seats.place(machine.places, seat, label) for seat, label in seated]
        return machine, made

    def linear(self, amplitudes: Amplitudes) -> tuple[str, ...]:
        return self.gear.linear(amplitudes)

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        return self.gear.blocks(amplitudes, wanted, observations)

    def inputs(self, observation: str, r: int) -> Array:
        return self.gear.inputs(observation, r)

    def cycles(self, observation: str, r: int) -> Array:
        g = self.gear.runs[r]
        phase = (g.some if observation == force_law.NAME else g.motion).phase
        return np.asarray((phase - phase[0]) / (2.0 * np.pi))
