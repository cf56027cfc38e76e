"""Bifurcations and grazings on a branch of periodic orbits, located by bisection along the curve.

========================  =====================================================================
flip                      a multiplier passes -1: the period doubles
fold                      a multiplier passes +1 and the branch turns back
crossing                  a multiplier passes +1 and the branch goes on: another branch crosses it
Neimark-Sacker            a complex pair passes the unit circle
transverse                a multiplier of an antisymmetric perturbation passes the unit circle
grazing                   a mesh touches an edge of its backlash: contact appears or is lost
========================  =====================================================================

The force of the gear is continuous in the displacement, so the multipliers are continuous in the
parameter, and a grazing alone changes no stability. Beyond a grazing they change as the square
root of the distance from it, so a fold or flip may follow at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.continuation import Branch
from herringbone_sim.dynamics.curve import BranchPoint, Curve
from herringbone_sim.dynamics.orbits import Complex
from herringbone_sim.errors import AnalysisError

PARTS = ("within", "transverse")
NARROW = 1e-10  # arclength at which the bisection for a boundary ends
NEAR = 1e-3  # arclength on both sides of a grazing over which stability is compared

COUNTS = tuple(f"{part} {sort}" for part in PARTS for sort in ("+1", "-1", "complex"))

Signature = dict[str, int]
Watch = Callable[[float, Array], Mapping[str, int]]


@dataclass(frozen=True)
class Boundary:
    """Point of a branch at which the orbit changes its stability or its contacts.

    Attributes:
        kind: a name from the table above.
        value: value of the parameter.
        width: uncertainty of ``value``, the width of the last interval of the bisection.
        period: of the branch, in forcing periods.
        detail: the backlash edge that is touched, or ``multiplier +1``, ``-1`` or ``complex`` of a
            transverse one; empty for other kinds.
        before, after: number of multipliers outside the unit circle (within, transverse) on both
            sides, in the order of the branch; for a grazing at an arclength of 1e-3 on either
            side.
        index: of the last branch point before the boundary.
        point: the orbit at the boundary.
        multiplier: the multiplier on the unit circle; NaN for a grazing.
    """

    kind: str
    value: float
    width: float
    period: int
    detail: str
    before: tuple[int, int]
    after: tuple[int, int]
    index: int
    point: BranchPoint
    multiplier: complex

    @property
    def changes_stability(self) -> bool:
        """Whether the orbit is stable on exactly one side of the boundary."""
        return (self.before == (0, 0)) != (self.after == (0, 0))


def find_boundaries(curve: Curve, branch: Branch, watch: Watch | None = None) -> list[Boundary]:
    """Locate all boundaries of a branch, in the order of its points.

    Args:
        watch: maps (parameter value, states (period, n) of an orbit) to the number of crossings
            of each backlash edge, by name; if None, grazings are not looked for.
    """
    boundaries = []
    counts = [signature(point, watch) for point in branch.points]
    for i, (a, b) in enumerate(pairwise(branch.points)):
        changed = [key for key in counts[i] if counts[i][key] != counts[i + 1][key]]
        borders = [key for key in changed if key not in COUNTS]
        at_step = [
            boundary for key in borders for boundary in _along(curve, key, (a, b), watch, i)
        ]
        # Multipliers have a kink at a grazing: bisect for their crossings on each side of it.
        stops = [a, *(boundary.point for boundary in at_step), b]
        stops.sort(key=lambda point: float((point.z - a.z) @ (b.z - a.z)))
        for part in pairwise(stops):
            at_step += [
                boundary for key in COUNTS for boundary in _along(curve, key, part, None, i)
            ]
        at_step.sort(key=lambda boundary: float((boundary.point.z - a.z) @ (b.z - a.z)))
        boundaries += _merged(at_step)
    return boundaries


def _merged(boundaries: list[Boundary]) -> list[Boundary]:
    """Merge grazings of several edges by the same orbit; the order does not change."""
    merged: list[Boundary] = []
    for boundary in boundaries:
        last = merged[-1] if merged else boundary
        apart = float(np.abs(boundary.point.z - last.point.z).max()) > 10 * NARROW
        if boundary is last or apart or boundary.kind != "grazing" or last.kind != "grazing":
            merged.append(boundary)
        else:
            merged[-1] = replace(last, detail=f"{last.detail}, {boundary.detail}")
    return merged


def _along(
    curve: Curve, key: str, step: tuple[BranchPoint, BranchPoint], watch: Watch | None, index: int
) -> Iterator[Boundary]:
    """Yield the boundaries between two orbits at which the count ``key`` changes.

    Where two multipliers outside the unit circle only become real or complex there is none.

    Args:
        key: a name in ``signature``.
        step: two successive orbits of a branch, or two between them.
        watch: as in ``find_boundaries``; needed only if ``key`` is a backlash edge.
        index: number of the last orbit of the branch before the boundaries.
    """

    def count(point: BranchPoint) -> int:
        return signature(point, watch)[key]

    low, last = step
    while count(low) != count(last):
        before, low = bisect(curve, low, last, count)
        named = _classified(curve, key, (step[0], before, low, last), index)
        if named:
            yield named


def signature(point: BranchPoint, watch: Watch | None) -> Signature:
    """Count multipliers outside the unit circle by type, and crossings of backlash edges, by name.

    Between two orbits whose counts differ lies a boundary, unless two real multipliers only became
    complex or the reverse. See ``find_boundaries`` for ``watch``.
    """
    counts = {}
    for part in PARTS:
        values: Complex = getattr(point.multipliers, part)
        outside = values[np.abs(values) > 1.0]
        real = outside.real[np.abs(outside.imag) == 0.0]
        counts[f"{part} +1"] = int((real > 0).sum())
        counts[f"{part} -1"] = int((real < 0).sum())
        counts[f"{part} complex"] = len(outside) - len(real)
    return counts | (dict(watch(point.value, point.orbit.points)) if watch else {})


def bisect(
    curve: Curve,
    a: BranchPoint,
    b: BranchPoint,
    count: Callable[[BranchPoint], int],
    narrow: float = NARROW,
) -> tuple[BranchPoint, BranchPoint]:
    """Bisect between orbits a and b of a branch to the change of ``count`` from its value at a.

    Returns:
        The orbits just before and just after the change. Their distance is at most ``narrow`` in
        arclength, more only if Newton's method finds no orbit between them.
    """
    start = count(a)
    while (length := float(np.linalg.norm(b.z - a.z))) > narrow:
        try:
            middle = curve.solve(0.5 * (a.z + b.z), (b.z - a.z) / length, a.tangent)
        except AnalysisError:
            break
        if max(np.linalg.norm(middle.z - end.z) for end in (a, b)) > 0.99 * length:
            break
        if count(middle) == start:
            a = middle
        else:
            b = middle
    return a, b


def _classified(
    curve: Curve,
    key: str,
    around: tuple[BranchPoint, BranchPoint, BranchPoint, BranchPoint],
    index: int,
) -> Boundary | None:
    """Boundary between the inner two of four orbits along a branch; the outer two end a step.

    None where no multiplier passed the unit circle: a pair outside it only became real or complex.
    """
    first, before, after, last = around
    where: Any = {
        "value": after.value,
        "width": abs(after.value - before.value),
        "period": after.orbit.period,
        "before": before.multipliers.unstable,
        "after": after.multipliers.unstable,
        "index": index,
        "point": after,
    }
    if key not in COUNTS:
        where["before"] = _aside(curve, before, -NEAR).multipliers.unstable
        where["after"] = _aside(curve, after, NEAR).multipliers.unstable
        return Boundary("grazing", detail=key, multiplier=complex("nan"), **where)
    if where["before"] == where["after"]:
        return None
    part, sort = key.split()
    values: Complex = getattr(after.multipliers, part)
    where["multiplier"] = complex(values[np.argmin(np.abs(np.abs(values) - 1.0))])
    if part == "transverse":
        return Boundary("transverse", detail=f"multiplier {sort}", **where)
    turns = first.tangent[-1] * last.tangent[-1] < 0
    kind = {"+1": "fold" if turns else "crossing", "-1": "flip"}.get(sort, "Neimark-Sacker")
    return Boundary(kind, detail="", **where)


def _aside(curve: Curve, point: BranchPoint, ds: float) -> BranchPoint:
    """Orbit at the arclength ``ds`` from a point; the point itself if Newton's method fails."""
    try:
        return curve.solve(point.z + ds * point.tangent, point.tangent)
    except AnalysisError:
        return point


def critical_mode(curve: Curve, boundary: Boundary) -> Array:
    """Return the eigenvector of the monodromy matrix for the multiplier that passes +1 or -1.

    It is real, of unit length, (n,).
    """
    product = np.eye(len(curve.basis))
    for jacobian in boundary.point.orbit.jacobians:
        product = jacobian @ product
    values, vectors = np.linalg.eig(product)
    vector = vectors[:, np.argmin(np.abs(values - boundary.multiplier))].real
    mode: Array = vector / np.linalg.norm(vector)
    return mode
