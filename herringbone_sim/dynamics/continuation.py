"""Pseudo-arclength continuation of a periodic orbit in a parameter, around folds.

A step predicts along the unit tangent of the curve by the arclength ds and corrects by Newton's
method in the plane normal to it (Keller 1977; Allgower and Georg, Introduction to Numerical
Continuation Methods, 2003).

The Poincaré map of a gear with backlash has a continuous first derivative, but where an orbit
grazes an edge of the backlash the second derivative is unbounded. Over a short enough step
tangents and multipliers still change little, so the step size is controlled by their change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.curve import BranchPoint, Curve, backwards
from herringbone_sim.dynamics.orbits import Multipliers, basis_of
from herringbone_sim.errors import AnalysisError

QUICK, SLOW = 3, 8  # Newton iterations up to which the step grows, from which it shrinks
STRAIGHT = 0.95  # smallest cosine between the tangents at both ends of a step
CALM = 0.15  # largest change of the largest multipliers over a step, see _multiplier_change
COLLAPSED = 1e-3  # smallest ratio by which a step may shrink half_and_side_differences


@dataclass(frozen=True)
class Branch:
    """Periodic orbits in order along a curve.

    Attributes:
        points: the orbits.
        ends: why the branch ends at its first and at its last orbit: ``range`` of the parameter,
            ``closed`` curve, ``halved`` (passed an orbit of half its period), ``mirrored`` (passed
            an orbit with equal left and right), ``start`` (the given orbit), the message of the
            last failed step, or ``N points`` where ``StepControl.points`` was reached.
    """

    points: tuple[BranchPoint, ...]
    ends: tuple[str, str]


@dataclass(frozen=True)
class StepControl:
    """Step-size limits of the pseudo-arclength continuation, and the point limit.

    Attributes:
        first, least, most: initial, smallest and largest arclength step.
        points: largest number of points per direction of a branch.
    """

    first: float = 1e-3
    least: float = 1e-8
    most: float = 0.01
    points: int = 2000


def follow(curve: Curve, start: BranchPoint, steps: StepControl | None = None) -> Branch:
    """Continue a branch from an orbit along its tangent, around folds, until it ends.

    It ends with the parameter range, or earlier: see ``Branch.ends``.
    """
    steps = steps or StepControl()
    points, ds = [start], steps.first
    while len(points) < steps.points:
        try:
            new, last = _step(curve, points[-1], ds)
        except AnalysisError as error:
            ds *= 0.5
            if ds < steps.least:
                return Branch(tuple(points), ("start", str(error)))
            continue
        end = "range" if last else _end_reached(curve, points, new)
        points.append(new)
        if end == "closed":
            return Branch((*points[:-1], start), ("closed", end))
        if end:
            return Branch(tuple(points), ("start", end))
        grown = 1.5 if new.iterations <= QUICK else 0.5 if new.iterations >= SLOW else 1.0
        ds = min(ds * grown, steps.most)
    return Branch(tuple(points), ("start", f"{steps.points} points"))


def follow_both(curve: Curve, start: BranchPoint, steps: StepControl | None = None) -> Branch:
    """Continue a branch from an orbit in both directions.

    Its points are ordered along the tangent of that orbit.
    """
    onward = follow(curve, start, steps)
    if onward.ends[1] == "closed":
        return onward
    back = follow(curve, backwards(start), steps)
    earlier = tuple(backwards(point) for point in reversed(back.points[1:]))
    return Branch(earlier + onward.points, (back.ends[1], onward.ends[1]))


def _step(curve: Curve, point: BranchPoint, ds: float) -> tuple[BranchPoint, bool]:
    """Orbit after a step of arclength ds, and whether it lies on an end of the parameter range.

    Raises:
        AnalysisError: no convergence, or tangent or multipliers changed too much; a shorter step
            may succeed.
    """
    guess = point.z + ds * point.tangent
    last = not 0.0 < guess[-1] < 1.0
    if last:
        border = 0.0 if guess[-1] <= 0.0 else 1.0
        guess = point.z + point.tangent * (border - point.z[-1]) / point.tangent[-1]
        new = curve.solve(guess, np.eye(len(guess))[-1], point.tangent)
    else:
        new = curve.solve(guess, point.tangent)
    if new.tangent @ point.tangent < STRAIGHT:
        raise AnalysisError("the branch turns within the shortest step")
    if _multiplier_change(point.multipliers, new.multipliers) > CALM:
        raise AnalysisError("the multipliers jump within the shortest step")
    for before, after in zip(
        half_and_side_differences(curve, point), half_and_side_differences(curve, new), strict=True
    ):
        if 0.0 < np.linalg.norm(after) < COLLAPSED * np.linalg.norm(before):
            raise AnalysisError(
                "every step falls onto an orbit of shorter period or more symmetry"
            )
    return new, last


def _multiplier_change(previous: Multipliers, following: Multipliers) -> float:
    """Larger change of the two largest moduli (within, transverse) from one orbit to the next.

    Relative to a modulus above 1, else absolute.
    """
    before = [float(np.abs(part[:1]).sum()) for part in (previous.within, previous.transverse)]
    after = [float(np.abs(part[:1]).sum()) for part in (following.within, following.transverse)]
    return max(abs(a - b) / max(a, b, 1.0) for a, b in zip(before, after, strict=True))


def _end_reached(curve: Curve, points: list[BranchPoint], new: BranchPoint) -> str:
    """Return ``closed``, ``halved`` or ``mirrored`` if the branch ends so, else an empty text."""
    start, last = points[0], points[-1]
    length = float(np.linalg.norm(new.z - last.z))
    near = max(np.linalg.norm(start.z - last.z), np.linalg.norm(start.z - new.z)) < 2 * length
    if len(points) > 10 and near and start.tangent @ last.tangent > STRAIGHT:
        return "closed"
    return next(
        (end for end in ("halved", "mirrored") if passes_simpler(curve, last, new, end)), ""
    )


def passes_simpler(curve: Curve, before: BranchPoint, after: BranchPoint, what: str) -> bool:
    """Tell whether a simpler orbit lies between two: of half the period, or with left = right.

    Args:
        what: ``halved`` (the two halves of the period swap) or ``mirrored`` (left and right swap).
    """
    k = ("halved", "mirrored").index(what)
    a, b = (half_and_side_differences(curve, point)[k] for point in (before, after))
    return float(np.sum(a * b)) < 0.0


def half_and_side_differences(curve: Curve, point: BranchPoint) -> tuple[Array, Array]:
    """Differences of the halves of the period, and of left and right, at each state of an orbit.

    Each (period, n). The first is zero for an odd period, the second on a curve of left-right
    symmetric orbits and for a gear whose sides can't be exchanged. They change sign where the
    branch passes an orbit of half the period (first), or a symmetric one (second).
    """
    points, mirror = point.orbit.points, curve.family.mirror
    half, odd = divmod(len(points), 2)
    halves = np.zeros_like(points) if odd else points - np.roll(points, half, axis=0)
    alike = mirror is None or curve.symmetric
    return halves, np.zeros_like(points) if alike else points - points[:, mirror]


def branch_off(
    curve: Curve, point: BranchPoint, mode: Array, times: int, ds: float
) -> tuple[Curve, BranchPoint]:
    """Find an orbit on the branch that crosses at an orbit, a step of arclength ds away from it.

    Args:
        mode: (n,) real eigenvector of the monodromy matrix whose multiplier is near 1 or -1.
        times: ratio of the new period to the old one: 2 for a multiplier of -1.

    Returns:
        The curve of the crossing branch, and the orbit.

    Raises:
        AnalysisError: Newton's method finds no orbit there.
    """
    points = np.tile(point.orbit.points, (times, 1))
    shift = [mode]
    for jacobian in np.tile(point.orbit.jacobians, (times, 1, 1))[:-1]:
        shift.append(jacobian @ shift[-1])
    basis = basis_of(points + np.array(shift), curve.family.mirror)
    new = Curve(curve.family, len(points), basis)
    z, aside = new.place(points, point.value), new.place(np.array(shift), curve.family.low)
    aside /= np.linalg.norm(aside)
    return new, new.solve(z + ds * aside, aside)
