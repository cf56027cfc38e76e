"""Bifurcation diagrams over one parameter, from sweeps that reach a value in different ways."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.grid import Axis
from herringbone_sim.sweeps.store import Result

SAME = 0.01  # b_c: largest distance of section points of the same orbit
LEAST_SHARE = 5e-4  # of the values: periods with less are not listed


@dataclass(frozen=True)
class Branch:
    """Motions found by one sweep over the parameter.

    Attributes:
        start: ``fixed``, ``up``, ``down``, ``ramp_up`` or ``ramp_down``, see ``Sweep.start``.
        values: (n,) of the parameter.
        point_values: (n, m) parameter value at each section point, which changes within a ramp.
        points: (n, m) displacements of one mesh at phase 0, b_c.
        period: (n,) mesh cycles; 0 aperiodic; NaN failed, or a ramp.
        exponent, within, transverse: (n,) Lyapunov exponents per tau, see ``observe``.
        asymmetry: (n,) RMS of left minus right displacements, b_c.
        reasons: n texts, empty where nothing failed.
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
    """Bifurcation diagram: branches over the same values of a parameter.

    Attributes:
        axis: the parameter.
        mesh: the mesh whose displacements are the points.
        branches: in the order given; ``hysteresis`` compares all with the first that is no ramp.
    """

    axis: Axis
    mesh: str
    branches: tuple[Branch, ...]

    @property
    def compared(self) -> list[Branch]:
        """Branches that ``hysteresis`` compares: those that are no ramps."""
        return [branch for branch in self.branches if not branch.start.startswith("ramp")]

    def hysteresis(self) -> Flags:
        """(n,) whether any branch ends in another motion than the first one, without ramps."""
        branches = self.compared
        apart = np.zeros(len(self.axis), dtype=bool)
        for branch in branches[1:]:
            apart |= differ(branches[0], branch)
        return apart


def diagram_of(results: Sequence[Result]) -> Diagram:
    """Bifurcation diagram from sweeps over one axis that differ in how they start.

    Raises:
        AnalysisError: no sweep, more than one axis, different values, or no section points stored.
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


def period_shares(period: Array) -> str:
    """Fraction of the values by period, as text ``P1 60.0%, aperiodic 38.5%``, largest first.

    Failed values count in the total, but are not listed; nor are periods below ``LEAST_SHARE``.

    Args:
        period: of any number of values, in any shape: mesh cycles; 0 aperiodic; NaN failed.
    """
    values, counts = np.unique(period[np.isfinite(period)], return_counts=True)
    pairs = sorted(zip(counts / period.size, values, strict=True), reverse=True)
    return ", ".join(
        f"{'aperiodic' if value == 0 else f'P{value:.0f}'} {share:.1%}"
        for share, value in pairs
        if share >= LEAST_SHARE
    )


def differ(a: Branch, b: Branch) -> Flags:
    """(n,) whether two branches end in different motions at a value; False where either failed.

    Motions differ if their periods differ, if only one of them has equal left and right, or if the
    section points of two periodic motions differ by more than 0.01 b_c. Two aperiodic motions are
    not distinguished by their points.
    """
    known = np.isfinite(a.period) & np.isfinite(b.period)
    periods = a.period != b.period
    sides = (a.asymmetry > SAME) != (b.asymmetry > SAME)
    apart: Flags = known & (periods | sides | _orbits_apart(a, b))
    return apart


def _orbits_apart(first: Branch, second: Branch) -> Flags:
    """(n,) whether the sorted section points of equal periods differ by more than ``SAME``."""
    apart = np.zeros(len(first.values), dtype=bool)
    for i in np.flatnonzero((first.period > 0) & (first.period == second.period)):
        p = int(first.period[i])
        a, b = np.sort(first.points[i, -p:]), np.sort(second.points[i, -p:])
        apart[i] = np.abs(a - b).max() > SAME
    return apart


def _branch(result: Result) -> Branch:
    """Branch of a diagram from the result of one sweep."""
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
    """(n, count) parameter value at each section point; a ramp changes it every mesh cycle."""
    sweep = result.sweep
    ends = np.repeat(values[:, None], count, axis=1)
    if not sweep.ramped:
        return ends
    before = np.roll(values, -1 if sweep.downwards else 1)
    first = -1 if sweep.downwards else 0
    before[first] = values[first]
    failed = np.array([bool(reason) for reason in result.reasons])
    alone = np.roll(failed, -1 if sweep.downwards else 1)  # the chain began anew, held
    before[alone] = values[alone]
    cycles = sweep.observation.cycles
    share = np.arange(cycles - count + 1, cycles + 1) / cycles
    moved: Array = before[:, None] + (values - before)[:, None] * share
    return moved
