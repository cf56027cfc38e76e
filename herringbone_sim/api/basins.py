"""Coexisting motions of a gear and their basins of attraction, in Python."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.api.gear import Gear, any_gear, model_of
from herringbone_sim.api.shown import NotebookResult, Picture, data_frame
from herringbone_sim.core.model import Model
from herringbone_sim.dynamics.basins import Basins, explore, gear_sections, random_starts
from herringbone_sim.dynamics.exponent_methods import identify_motion
from herringbone_sim.dynamics.flow import symmetry
from herringbone_sim.dynamics.portraits import portraits
from herringbone_sim.views.figures.basins import PORTRAITS, basins_figure


@dataclass(frozen=True, repr=False)
class Attractors(NotebookResult):
    """Motions of a gear and the fraction of random initial states that leads to each.

    Attributes:
        model: of the gear.
        names: of the motions, in descending order of that fraction.
        basins: attractors, and the attractor of each initial state.
        last: mesh cycles from the initial state to the last point of each attractor.
    """

    model: Model
    names: tuple[str, ...]
    basins: Basins
    last: int

    def title(self) -> str:
        return f"{len(self.names)} motions of {self.basins.labels.size} random starts"

    def facts(self) -> list[tuple[str, str]]:
        return [
            (name, f"{share:.1%} [{low:.1%}, {high:.1%}]")
            for name, (share, low, high) in zip(self.names, self.basins.shares(), strict=True)
        ]

    def plot(self) -> Picture:
        """Figure with the fractions above a phase portrait of each motion."""
        drawn = self.basins.attractors[:PORTRAITS]
        motions = portraits(self.model, drawn, self.last)
        return Picture(basins_figure(motions, self.names, self.basins))

    def to_pandas(self) -> Any:
        """``pandas.DataFrame`` with a row per motion: fraction, its 95 % interval, number."""
        share, low, high = self.basins.shares().T
        columns = {"motion": self.names, "share": share, "low": low, "high": high}
        return data_frame({**columns, "starts": self.basins.counts})


@any_gear()
def basins(
    gear: Gear = None,
    starts: int = 200,
    transient: int = 4000,
    points: int = 200,
    seed: int = 0,
    effects: str | None = None,
    **changes: Any,
) -> Attractors:
    """Find the coexisting motions of a gear, and the fraction of random initial states for each.

    Args:
        gear: parameters, a parameter file, or None for Tables 1 and 2 of the paper.
        starts: number of initial states; displacements are within b_c, velocities b_c omega_n.
        transient: mesh cycles discarded first.
        points: mesh cycles observed then.
        seed: of the initial states.
        effects: text that replaces the effects of the file, see ``simulate``; None to use those.
        changes: parameters by name.

    Raises:
        ParameterError: a value out of range, or no such effect.
    """
    model, last = model_of(gear, effects, changes), transient + points - 1
    sections_of = gear_sections(model, transient, points, os.cpu_count() or 1)
    drawn = random_starts(model, starts, np.random.default_rng(seed))
    result = explore(sections_of, drawn, symmetry(model))
    names = (
        attractor.named(identify_motion(model, attractor, at=last)[0])
        for attractor in result.attractors
    )
    return Attractors(model, tuple(names), result, last)
