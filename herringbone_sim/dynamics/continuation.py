"""A periodic orbit followed through a parameter, round its folds: pseudo-arclength continuation.

A step goes ds along the tangent of the curve, and Newton's method brings it back across (Keller
1977; Allgower and Georg, Introduction to Numerical Continuation Methods, 2003).

The map of a gear with backlash is continuous with its first derivative, but where an orbit grazes
a border the second derivative has no bound. Tangents and multipliers then still change little over
a step that is short enough, which is what the step is controlled by.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.dynamics.curve import BranchPoint, Curve, backwards
from herringbone_sim.dynamics.orbits import Array, Multipliers, basis_of
from herringbone_sim.errors import AnalysisError

QUICK, SLOW = 3, 8  # Newton steps that let the next step grow, and that make it shorter
STRAIGHT = 0.95  # least cosine between the tangents at both ends of a step
CALM = 0.15  # most change of the largest multipliers over a step, as a share of them or of 1
COLLAPSED = 1e-3  # least share of an orbit's doubling, or asymmetry, that a step must keep


@dataclass(frozen=True)
class Branch:
    """Orbits in order along a curve.

    Attributes:
        points: of the branch.
        ends: why it ends where it does, first and last: ``range``, ``closed`` (back at its
            start), ``halved`` or ``mirrored`` (passed an orbit of half its period, or one whose
            left and right are alike), ``start``, or why no further step succeeds.
    """

    points: tuple[BranchPoint, ...]
    ends: tuple[str, str]


@dataclass(frozen=True)
class Steps:
    """Step-size limits of the pseudo-arclength continuation, and the point limit.

    Attributes:
        first, least, most: initial, smallest and largest arclength step.
        points: largest number of points per direction of a branch.
    """

    first: float = 1e-3
    least: float = 1e-8
    most: float = 0.01
    points: int = 2000


def follow(curve: Curve, start: BranchPoint, steps: Steps | None = None) -> Branch:
    """The branch from an orbit on, along its tangent, up to an end of the range."""
    steps = steps or Steps()
    points, ds = [start], steps.first
    while len(points) < steps.points:
        try:
            new, last = _step(curve, points[-1], ds)
        except AnalysisError as error:
            ds *= 0.5
            if ds < steps.least:
                return Branch(tuple(points), ("start", str(error)))
            continue
        end = "range" if last else _met(curve, points, new)
        points.append(new)
        if end == "closed":
            return Branch((*points[:-1], start), ("closed", end))
        if end:
            return Branch(tuple(points), ("start", end))
        grown = 1.5 if new.iterations <= QUICK else 0.5 if new.iterations >= SLOW else 1.0
        ds = min(ds * grown, steps.most)
    return Branch(tuple(points), ("start", f"{steps.points} points"))


def follow_both(curve: Curve, start: BranchPoint, steps: Steps | None = None) -> Branch:
    """The whole branch through an orbit, in the direction of its tangent."""
    onward = follow(curve, start, steps)
    if onward.ends[1] == "closed":
        return onward
    back = follow(curve, backwards(start), steps)
    earlier = tuple(backwards(point) for point in reversed(back.points[1:]))
    return Branch(earlier + onward.points, (back.ends[1], onward.ends[1]))


def _step(curve: Curve, point: BranchPoint, ds: float) -> tuple[BranchPoint, bool]:
    """The next orbit, and whether it is on a border of the range; AnalysisError."""
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
    if _unrest(point.multipliers, new.multipliers) > CALM:
        raise AnalysisError("the multipliers jump within the shortest step")
    for before, after in zip(differences(curve, point), differences(curve, new), strict=True):
        if 0.0 < np.linalg.norm(after) < COLLAPSED * np.linalg.norm(before):
            raise AnalysisError(
                "every step falls onto an orbit of shorter period or more symmetry"
            )
    return new, last


def _unrest(one: Multipliers, other: Multipliers) -> float:
    """Largest relative change of a largest modulus; of one inside the circle its plain change."""
    before = [float(np.abs(part[:1]).sum()) for part in (one.within, one.transverse)]
    after = [float(np.abs(part[:1]).sum()) for part in (other.within, other.transverse)]
    return max(abs(a - b) / max(a, b, 1.0) for a, b in zip(before, after, strict=True))


def _met(curve: Curve, points: list[BranchPoint], new: BranchPoint) -> str:
    """Whether the last step came back to the start, or passed an orbit that is simpler."""
    start, last = points[0], points[-1]
    length = float(np.linalg.norm(new.z - last.z))
    near = max(np.linalg.norm(start.z - last.z), np.linalg.norm(start.z - new.z)) < 2 * length
    if len(points) > 10 and near and start.tangent @ last.tangent > STRAIGHT:
        return "closed"
    return next((end for end in ("halved", "mirrored") if swaps(curve, last, new, end)), "")


def swaps(curve: Curve, one: BranchPoint, other: BranchPoint, what: str) -> bool:
    """Whether the halves of an orbit (``halved``), or its sides, changed places in between."""
    k = ("halved", "mirrored").index(what)
    return float(np.sum(differences(curve, one)[k] * differences(curve, other)[k])) < 0.0


def differences(curve: Curve, point: BranchPoint) -> tuple[Array, Array]:
    """What the two halves of an orbit, and its left and right, differ by; each (period, n).

    Zeros for an odd period, and on a curve of states whose left and right are alike.
    """
    points, mirror = point.orbit.points, curve.family.mirror
    half, odd = divmod(len(points), 2)
    halves = np.zeros_like(points) if odd else points - np.roll(points, half, axis=0)
    alike = mirror is None or curve.symmetric
    return halves, np.zeros_like(points) if alike else points - points[:, mirror]


def branch_off(
    curve: Curve, point: BranchPoint, mode: Array, times: int, ds: float
) -> tuple[Curve, BranchPoint]:
    """The branch that crosses at an orbit, a step of ds away from it.

    Args:
        mode: (n,) real eigenvector of the monodromy matrix whose multiplier is near 1 or -1.
        times: how many times longer the new period is: 2 where the multiplier is -1.

    Raises:
        AnalysisError: no orbit was found there.
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
