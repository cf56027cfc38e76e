"""Periodic orbits of a gear over a parameter, in Python."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

from herringbone_sim.api.gear import Gear, any_gear
from herringbone_sim.api.shown import NotebookResult, Picture, data_frame
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.cascade import CascadeOptions, Followed, trace_cascade
from herringbone_sim.dynamics.gear_family import GearCache, gear_family
from herringbone_sim.dynamics.starts import find_start
from herringbone_sim.recording.parameter_file import gear_parts
from herringbone_sim.views.figures.orbits import orbit_figure, stability_of


@dataclass(frozen=True, repr=False)
class Orbits(NotebookResult):
    """Branches of periodic orbits, stable or not, with the boundaries on them.

    Attributes:
        over: name of the parameter.
        branches: orbits and boundaries of each branch.
        parameters: of the gear.
    """

    over: str
    branches: tuple[Followed, ...]
    parameters: Parameters

    def title(self) -> str:
        return f"{len(self.branches)} branches of periodic orbits over {self.over}"

    def facts(self) -> list[tuple[str, str]]:
        return [
            (
                f"P{followed.period}",
                ", ".join(f"{b.kind} at {b.value:.6g}" for b in followed.boundaries),
            )
            for followed in self.branches
        ]

    def plot(self, mesh: int = 0) -> Picture:
        """Figure of the branches over the parameter, above their largest multipliers.

        Args:
            mesh: index of the mesh whose displacement at phase 0 is shown.
        """
        name = self.parameters.layout.meshes[mesh]
        return Picture(orbit_figure(self.branches, self.over, mesh, name))

    def to_pandas(self) -> Any:
        """``pandas.DataFrame`` with a row per orbit: branch, value, period and stability."""
        rows = [
            (number, point.value, followed.period, stability_of(point))
            for number, followed in enumerate(self.branches, start=1)
            for point in followed.branch.points
        ]
        names = ("branch", self.over, "period", "stability")
        return data_frame(rows, names)

    def boundaries(self) -> Any:
        """``pandas.DataFrame`` with a row per boundary, by value: kind, branch and period."""
        rows = [
            (b.value, b.kind, number, b.period)
            for number, followed in enumerate(self.branches, start=1)
            for b in followed.boundaries
        ]
        names = (self.over, "kind", "branch", "period")
        return data_frame(sorted(rows), names)


@any_gear()
def orbits(
    gear: Gear = None,
    over: str = "delta_T",
    between: tuple[float, float] = (55.0, 90.0),
    start: float | Sequence[float | tuple[float, int]] = (85.0,),
    max_period: int = 4,
    effects: str | None = None,
    **changes: Any,
) -> Orbits:
    """Follow periodic orbits over a parameter through folds and doublings, with all boundaries.

    Args:
        gear: parameters, a parameter file, or None for Tables 1 and 2 of the paper.
        over: parameter that is varied.
        between: range of the parameter.
        start: value or values at which the motion is periodic, or (value, N) for an orbit of N
            forcing periods near the motion there, stable or not.
        max_period: largest period that is followed at period doublings [forcing periods].
        effects: text that replaces the effects of the file, see ``simulate``; None to use those.
        changes: other parameters by name.

    Raises:
        ParameterError: a value out of range, or a start outside of the range of the parameter.
        AnalysisError: no orbit at a start.
    """
    parameters, actives = gear_parts(gear, effects)
    parameters = parameters.changed(changes)
    family, watch = gear_family(parameters, over, *between, actives)
    gears = GearCache(parameters, over, actives)
    entries: Any = (start,) if isinstance(start, Real) else start
    pairs = [(e, None) if isinstance(e, Real) else tuple(e) for e in entries]
    starts = [(value, find_start(gears, family, value, period)) for value, period in pairs]
    branches = trace_cascade(family, starts, watch, CascadeOptions(max_period=max_period))
    return Orbits(over, tuple(branches), parameters)
