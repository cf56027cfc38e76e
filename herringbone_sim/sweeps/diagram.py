"""Bifurcation diagrams over one parameter, by several ways of getting to each value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.grid import Axis
from herringbone_sim.sweeps.store import Result

Array = NDArray[np.float64]

SAME = 0.01  # b_c: section points of one orbit come back closer than this, those of two do not


@dataclass(frozen=True)
class Branch:
    """The motions met by one way of getting to each value.

    Attributes:
        start: ``fixed``, ``up``, ``down``, ``ramp_up`` or ``ramp_down``.
        values: (n,) of the parameter.
        point_values: (n, m) value at each section point: it moves within a ramp.
        points: (n, m) section displacements of one mesh, b_c.
        period: (n,) mesh cycles; 0 aperiodic; NaN failed, or moving all the time.
        exponent, within, transverse: (n,) per tau, see ``observe``.
        asymmetry: (n,) RMS of left less right, b_c.
        reasons: n texts, empty where all went well.
    """

    start: str
    values: Array
    point_values: Array
    points: Array
    period: Array
    exponent: Array
    within: Array
    transverse: Array
    asymmetry: Array
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Diagram:
    """Branches over the same values.

    Attributes:
        axis: the parameter.
        mesh: whose displacements the points are.
        branches: in the order in which they were given.
    """

    axis: Axis
    mesh: str
    branches: tuple[Branch, ...]

    def branch(self, start: str) -> Branch | None:
        return next((one for one in self.branches if one.start == start), None)

    def hysteresis(self) -> NDArray[np.bool_]:
        """Where (n,) two of the branches, ramps left out, end in different motions."""
        held = [one for one in self.branches if not one.start.startswith("ramp")]
        apart = np.zeros(len(self.axis), dtype=bool)
        for one in held[1:]:
            apart |= differ(held[0], one)
        return apart


def diagram_of(results: Sequence[Result]) -> Diagram:
    """Diagram of sweeps over one axis that differ in how they start.

    Raises:
        AnalysisError: no sweep, more than one axis, different values, or no points kept.
    """
    sweeps = [result.sweep for result in results]
    axes = {sweep.axes for sweep in sweeps}
    meshes = {sweep.observation.mesh for sweep in sweeps}
    if len(axes) != 1 or len(meshes) != 1 or "" in meshes or len(sweeps[0].axes) != 1:
        raise AnalysisError(
            "a bifurcation diagram needs sweeps over the same values of one parameter with the "
            f"points of one mesh, got axes {sorted({s.names for s in sweeps})} and meshes "
            f"{sorted(meshes)}: run them with the same --over and --mesh"
        )
    (axis,) = sweeps[0].axes
    return Diagram(axis, sweeps[0].observation.mesh, tuple(map(_branch, results)))


def differ(one: Branch, other: Branch) -> NDArray[np.bool_]:
    """Where (n,) two branches end in different motions; false where either failed.

    Motions differ when their periods do, when one keeps left and right alike and the other does
    not, or when the section points of two periodic motions lie further apart than 0.01 b_c. Two
    aperiodic motions are not told apart by their points.
    """
    known = np.isfinite(one.period) & np.isfinite(other.period)
    periods = one.period != other.period
    sides = (one.asymmetry > SAME) != (other.asymmetry > SAME)
    apart: NDArray[np.bool_] = known & (periods | sides | _orbits_apart(one, other))
    return apart


def _orbits_apart(one: Branch, other: Branch) -> NDArray[np.bool_]:
    apart = np.zeros(len(one.values), dtype=bool)
    for i in np.flatnonzero((one.period > 0) & (one.period == other.period)):
        p = int(one.period[i])
        a, b = np.sort(one.points[i, -p:]), np.sort(other.points[i, -p:])
        apart[i] = np.abs(a - b).max() > SAME
    return apart


def _branch(result: Result) -> Branch:
    values = np.array(result.sweep.axes[0].values)
    points = result["points"]
    return Branch(
        result.sweep.start,
        values,
        _point_values(result, values, points.shape[1]),
        points,
        result["period"],
        result["exponent"],
        result["within"],
        result["transverse"],
        result["asymmetry"],
        tuple(str(reason) for reason in result.reasons),
    )


def _point_values(result: Result, values: Array, count: int) -> Array:
    """Value of the parameter (n, count) at each point; a ramp comes from the value before."""
    sweep = result.sweep
    ends = np.repeat(values[:, None], count, axis=1)
    if not sweep.ramped:
        return ends
    before = np.roll(values, -1 if sweep.downwards else 1)
    first = -1 if sweep.downwards else 0
    before[first] = values[first]
    cycles = sweep.observation.cycles
    share = np.arange(cycles - count + 1, cycles + 1) / cycles
    moved: Array = before[:, None] + (values - before)[:, None] * share
    return moved
