"""The boundaries of a branch of periodic orbits, named and located by bisection on the curve.

========================  =====================================================================
flip                      a multiplier passes -1: the period doubles
fold                      a multiplier passes +1 and the branch turns back
crossing                  a multiplier passes +1 and the branch goes on: another one crosses it
Neimark-Sacker            a complex pair passes the unit circle
transverse                a multiplier of perturbations that part left and right passes the circle
grazing                   a mesh touches a border of its backlash: contact appears or is lost
========================  =====================================================================

The force of a gear is continuous, so multipliers are too: grazing alone changes no stability, but
they move with the square root of the distance behind it, and a fold or flip may follow at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from herringbone_sim.dynamics.continuation import Branch
from herringbone_sim.dynamics.curve import BranchPoint, Curve
from herringbone_sim.dynamics.orbits import Array, Complex
from herringbone_sim.errors import AnalysisError

PARTS = ("within", "transverse")
NARROW = 1e-10  # length of the interval on the curve that holds a boundary
NEAR = 1e-3  # arclength on both sides of a grazing over which stability is compared

COUNTS = tuple(f"{part} {sort}" for part in PARTS for sort in ("+1", "-1", "complex"))

Signature = dict[str, int]
Watch = Callable[[float, Array], Mapping[str, int]]


@dataclass(frozen=True)
class Boundary:
    """A place on a branch where what the orbit is changes.

    Attributes:
        kind: see the table above.
        value: of the parameter.
        width: of the interval of the parameter that it was narrowed down to.
        period: of the branch, in periods of the forcing.
        detail: the border that is touched, or where a transverse multiplier passes.
        before, after: multipliers outside the unit circle (within, transverse) in the order of
            the branch; over an arclength of a thousandth to both sides where it is a grazing.
        index: of the point of the branch before it.
        point: the orbit there.
        multiplier: the one on the unit circle; NaN where it is a grazing.
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
        """Whether the orbit is stable on one side only."""
        return (self.before == (0, 0)) != (self.after == (0, 0))


def find_boundaries(curve: Curve, branch: Branch, watch: Watch | None = None) -> list[Boundary]:
    """All boundaries of a branch, in its order.

    Args:
        watch: (value, points) -> how often the orbit passes each border, by name; without it no
            grazing is looked for.
    """
    found = []
    counts = [signature(point, watch) for point in branch.points]
    for i, (a, b) in enumerate(pairwise(branch.points)):
        changed = [key for key in counts[i] if counts[i][key] != counts[i + 1][key]]
        borders = [key for key in changed if key not in COUNTS]
        at_step = [one for key in borders for one in _along(curve, key, (a, b), watch, i)]
        # Multipliers turn sharply at a grazing: their crossings are looked for on each side of it.
        stops = [a, *(one.point for one in at_step), b]
        stops.sort(key=lambda point: float((point.z - a.z) @ (b.z - a.z)))
        for part in pairwise(stops):
            at_step += [one for key in COUNTS for one in _along(curve, key, part, None, i)]
        at_step.sort(key=lambda one: float((one.point.z - a.z) @ (b.z - a.z)))
        found += _merged(at_step)
    return found


def _merged(found: list[Boundary]) -> list[Boundary]:
    """Boundaries in order, grazings of several borders by one and the same orbit as one."""
    merged: list[Boundary] = []
    for one in found:
        last = merged[-1] if merged else one
        apart = float(np.abs(one.point.z - last.point.z).max()) > 10 * NARROW
        if one is last or apart or one.kind != "grazing" or last.kind != "grazing":
            merged.append(one)
        else:
            merged[-1] = replace(last, detail=f"{last.detail}, {one.detail}")
    return merged


def _along(
    curve: Curve, key: str, step: tuple[BranchPoint, BranchPoint], watch: Watch | None, index: int
) -> Iterator[Boundary]:
    """The boundaries within a step at which one count changes."""

    def count(point: BranchPoint) -> int:
        return signature(point, watch)[key]

    low, last = step
    while count(low) != count(last):
        before, low = bisect(curve, low, last, count)
        named = _named(curve, key, (step[0], before, low, last), index)
        if named:
            yield named


def signature(point: BranchPoint, watch: Watch | None) -> Signature:
    """Counts that change at boundaries: multipliers outside the circle, passes of borders."""
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
    """The interval of the curve, from a towards b, in which a count first leaves its value at a.

    It stays wider than ``narrow`` where no orbit in between is found.
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


def _named(
    curve: Curve,
    key: str,
    around: tuple[BranchPoint, BranchPoint, BranchPoint, BranchPoint],
    index: int,
) -> Boundary | None:
    """The boundary between the inner two orbits; None where multipliers met off the circle."""
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
    try:
        return curve.solve(point.z + ds * point.tangent, point.tangent)
    except AnalysisError:
        return point


def mode_of(curve: Curve, boundary: Boundary) -> Array:
    """Real eigenvector (n,) of the multiplier that passes +1 or -1 at a boundary."""
    product = np.eye(len(curve.basis))
    for jacobian in boundary.point.orbit.jacobians:
        product = jacobian @ product
    values, vectors = np.linalg.eig(product)
    found = vectors[:, np.argmin(np.abs(values - boundary.multiplier))].real
    mode: Array = found / np.linalg.norm(found)
    return mode
