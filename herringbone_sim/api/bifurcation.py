"""Bifurcation diagrams of a gear in Python."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.api.gear import Gear, any_gear
from herringbone_sim.api.shown import NotebookResult, Picture, data_frame
from herringbone_sim.core.parameters import Parameters, meaning
from herringbone_sim.dynamics.flow import forcing_cycles
from herringbone_sim.effects.effect import Active
from herringbone_sim.errors import ParameterError, shown
from herringbone_sim.recording.parameter_file import gear_parts
from herringbone_sim.sweeps.diagram import Diagram, diagram_of, period_shares
from herringbone_sim.sweeps.execute import run_stores
from herringbone_sim.sweeps.forcing import first_model, observation_of
from herringbone_sim.sweeps.grid import STARTS, Axis, Sweep, with_sweep_steps
from herringbone_sim.sweeps.store import load_result, open_store
from herringbone_sim.views.figures.diagram import diagram_figure


@dataclass(frozen=True, repr=False)
class Bifurcation(NotebookResult):
    """Motions over a parameter, for one or more ways of reaching each value.

    Attributes:
        diagram: a branch with values, section points, periods and exponents for each way.
    """

    diagram: Diagram

    @property
    def values(self) -> Any:
        """(n,) values of the parameter."""
        return self.diagram.branches[0].values

    @property
    def period(self) -> Any:
        """(n,) period in mesh cycles by the first way; 0 aperiodic, NaN failed."""
        return self.diagram.branches[0].period

    @property
    def exponent(self) -> Any:
        """(n,) largest Lyapunov exponent per unit of dimensionless time, by the first way."""
        return self.diagram.branches[0].exponent

    def title(self) -> str:
        axis = self.diagram.axis
        ends = f"{axis.values[0]:g} to {axis.values[-1]:g}"
        return f"bifurcation over {axis.name}, {len(axis)} values from {ends}"

    def facts(self) -> list[tuple[str, str]]:
        facts = [
            (branch.start, period_shares(branch.period) or "no periods")
            for branch in self.diagram.branches
        ]
        if len(self.diagram.compared) > 1:
            apart = int(self.diagram.hysteresis().sum())
            facts.append(("different motions by different ways", f"{apart} values"))
        return facts

    def plot(self) -> Picture:
        """Picture of the section points over the parameter, above the largest exponents if known.

        Its ``figure`` is the Matplotlib figure. Grey: values at which different starts end in
        different motions.
        """
        return Picture(diagram_figure(self.diagram))

    def to_pandas(self) -> Any:
        """``pandas.DataFrame`` with a row per value and way."""
        names = ("values", "period", "exponent", "within", "transverse", "asymmetry")
        columns = {
            name: np.concatenate([getattr(branch, name) for branch in self.diagram.branches])
            for name in names
        }
        starts = np.repeat([branch.start for branch in self.diagram.branches], len(self.values))
        axis = columns.pop("values")
        return data_frame({self.diagram.axis.name: axis, "start": starts, **columns})


def _is_number(name: str) -> bool:
    """Whether a parameter is one number, no text and no list; ParameterError if unknown."""
    meaning(name)  # raises if unknown
    return isinstance(getattr(Parameters, name), (int, float))


def _forcing(base: Parameters, actives: Sequence[Active], axis: Axis) -> int:
    """Return the forcing period [mesh cycles] at the first value; 1 if no gear can have it."""
    try:
        return forcing_cycles(first_model(base, actives, (axis,)))
    except ParameterError:
        return 1


@any_gear()
def bifurcation(
    gear: Gear = None,
    start: str | Sequence[str] = "fixed",
    transient: int = 300,
    cycles: int | None = None,
    effects: str | None = None,
    folder: Path | str | None = None,
    **values: Any,
) -> Bifurcation:
    """Compute a bifurcation diagram with largest exponents over one parameter, on all cores.

    Args:
        gear: parameters, a parameter file, or None for Tables 1 and 2 of the paper.
        start: how a value is reached, one or more of ``fixed`` (from the initial state), ``up``,
            ``down`` (from the final state of the value before), ``ramp_up``, ``ramp_down`` (one
            motion while the parameter changes every mesh cycle).
        transient: mesh cycles discarded at each value.
        cycles: mesh cycles observed then; None for 100, or ten periods of effects or control that
            repeat after more than one, up to 100 mesh cycles.
        effects: text that replaces the effects of the file, see ``simulate``; None to use those.
        folder: where results are stored, and read from when the call is repeated; None for none.
        values: one parameter with a sequence of values, as ``delta_T=np.linspace(0, 100, 400)``;
            others with one value each, which is a sequence for parameters such as ``k_factor``.

    Raises:
        ParameterError: not exactly one sequence, a value out of range, or no such start.
        AnalysisError: ``folder`` holds another sweep, or can't be written.
    """
    swept = {
        name: given for name, given in values.items() if np.ndim(given) == 1 and _is_number(name)
    }
    if len(swept) != 1:
        raise ParameterError(
            "a bifurcation diagram goes over one parameter that is a number, got sequences for "
            f"{list(swept)}: write delta_T=np.linspace(0, 100, 400)"
        )
    (name, along), starts = *swept.items(), (start,) if isinstance(start, str) else tuple(start)
    if not starts or not set(starts) <= set(STARTS):
        raise ParameterError(f"start must be of {', '.join(STARTS)}, got {start!r}")
    parameters, actives = gear_parts(gear, effects)
    others = {key: given for key, given in values.items() if key not in swept}
    base = with_sweep_steps(parameters.changed(others), others)
    try:
        numbers = tuple(float(value) for value in along)
    except (TypeError, ValueError):
        raise ParameterError(f"{name} must be numbers, got {shown(list(along))}") from None
    axis = Axis(name, numbers)
    look = observation_of(_forcing(base, actives, axis), transient, cycles)
    look = replace(look, mesh=base.layout.meshes[0])
    with tempfile.TemporaryDirectory() as unkept:
        stores = []
        for way in starts:
            sweep = Sweep.of_gear(base, actives, (axis,), look, way)
            stores.append(open_store(Path(folder or unkept) / way, sweep))
        run_stores(stores)
        return Bifurcation(diagram_of([load_result(store) for store in stores]))
