"""All that hangs together with one periodic orbit: its branch, the doubled ones, their boundaries.

From one orbit its branch is followed both ways; at each flip the branch of twice the period is
followed, and so on up to a largest period. A branch that is found to end in an orbit of half its
period leads back to the branch of that one. The cascade P1 -> P2 -> P4 is had from any of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np

from herringbone_sim.dynamics.boundaries import (
    Boundary,
    Watch,
    bisect,
    find_boundaries,
    mode_of,
)
from herringbone_sim.dynamics.continuation import (
    Branch,
    Steps,
    branch_off,
    follow,
    follow_both,
    swaps,
)
from herringbone_sim.dynamics.curve import BranchPoint, Curve, Family, begin
from herringbone_sim.dynamics.orbits import Array
from herringbone_sim.errors import AnalysisError, ParameterError

SIMPLER = ("halved", "mirrored")
OFF = 1e-4  # arclength at which a branch is taken up beside the one that it leaves
SAME = 1e-3  # distance of orbits that are one; junctions are known to about OFF


@dataclass(frozen=True)
class Followed:
    """A branch with its boundaries.

    Attributes:
        curve: that it lies on.
        branch: its orbits.
        boundaries: in the order of the branch.
        origin: how it was come by.
    """

    curve: Curve
    branch: Branch
    boundaries: tuple[Boundary, ...]
    origin: str

    @property
    def period(self) -> int:
        return self.curve.period

    @property
    def symmetric(self) -> bool:
        """Whether left and right are alike."""
        return self.curve.symmetric


@dataclass(frozen=True)
class Options:
    """How far to go: largest period, branches whose sides differ, step control, most branches."""

    max_period: int = 4
    asymmetric: bool = False
    steps: Steps = field(default_factory=Steps)
    branches: int = 40


def explore(
    family: Family,
    starts: Sequence[tuple[float, Array]],
    watch: Watch | None = None,
    options: Options | None = None,
    progress: Callable[[Followed], object] | None = None,
) -> list[Followed]:
    """The branches of some orbits, and those that leave them where a multiplier passes -1.

    Args:
        starts: values of the parameter, and the states (period, n) of an orbit there, or near.
        watch: see ``find_boundaries``.
        progress: called with each branch that is done.

    Raises:
        AnalysisError: there is no orbit near a start.
    """
    options = options or Options()
    waiting = [_first(family, points, value) for value, points in starts]
    found: list[Followed] = []
    while waiting and len(found) < options.branches:
        lead = waiting.pop(0)
        if any(_is_known(one, lead) for one in found):
            continue
        done = _pursue(lead, watch, options.steps)
        found.append(done)
        if progress:
            progress(done)
        waiting += [*_to_simpler(done), *_to_doubled(done, options)]
    return found


@dataclass(frozen=True)
class Lead:
    """Where a branch can be taken up: an orbit of it, and the orbit at which it meets another.

    Attributes:
        curve: of the branch.
        start: an orbit of it.
        origin: in words.
        both: whether it goes on to both sides of the start.
        junction: (period, n) the orbit that both branches have in common; empty for the first.
    """

    curve: Curve
    start: BranchPoint
    origin: str
    both: bool
    junction: Array


def _first(family: Family, points: Array, value: float) -> Lead:
    curve, start = begin(family, points, value)
    return Lead(curve, start, f"start at {value:g}", True, start.orbit.points[:0])


def _pursue(lead: Lead, watch: Watch | None, steps: Steps) -> Followed:
    curve = lead.curve
    branch = _trimmed(curve, (follow_both if lead.both else follow)(curve, lead.start, steps))
    boundaries = tuple(find_boundaries(curve, branch, watch))
    return Followed(curve, branch, boundaries, lead.origin)


def _trimmed(curve: Curve, branch: Branch) -> Branch:
    """A branch that passed a simpler orbit, cut off just before it."""
    points = list(branch.points)
    for last, inner, end in ((-1, -2, branch.ends[1]), (0, 1, branch.ends[0])):
        if end in SIMPLER:
            a = points[inner]
            passed = partial(swaps, curve, a, what=end)
            points[last] = bisect(curve, a, points[last], passed, OFF)[0]
    return Branch(tuple(points), branch.ends)


def _simpler_ends(one: Followed) -> list[tuple[BranchPoint, Array]]:
    """Last orbits of a branch that ends in simpler ones, and those (period, n)."""
    mirror, found = one.curve.family.mirror, []
    for i, end in zip((0, -1), one.branch.ends, strict=True):
        point = one.branch.points[i]
        points = point.orbit.points
        if end == "halved":
            half = one.period // 2
            found.append((point, 0.5 * (points[:half] + points[half:])))
        elif end == "mirrored" and mirror is not None:
            found.append((point, 0.5 * (points + points[:, mirror])))
    return found


def _to_simpler(one: Followed) -> Iterator[Lead]:
    """Leads to the branches that a branch ends in."""
    family = one.curve.family
    for point, junction in _simpler_ends(one):
        for aside in (-OFF, OFF):
            with suppress(AnalysisError, ParameterError):
                value = point.value + aside * (family.high - family.low)
                curve, start = begin(family, _cleaned(junction, family), value)
                yield Lead(curve, start, f"end of P{one.period}", True, junction)
                break


def _cleaned(points: Array, family: Family) -> Array:
    """States with left and right made alike where they are so nearly."""
    if family.mirror is None or np.abs(points - points[:, family.mirror]).max() > SAME:
        return points
    return 0.5 * (points + points[:, family.mirror])


def _to_doubled(one: Followed, options: Options) -> Iterator[Lead]:
    """Leads to the branches that leave a branch at its flips (and where its sides part)."""
    for boundary in one.boundaries:
        sort = "+1" if boundary.detail.endswith("+1") else "-1"
        parts = boundary.kind == "transverse" and abs(boundary.multiplier.imag) < 1e-9
        times = 2 if sort == "-1" else 1
        wanted = boundary.kind == "flip" or (parts and options.asymmetric)
        if not wanted or times * one.period > options.max_period:
            continue
        mode = mode_of(one.curve, boundary)
        origin = f"{boundary.kind} of P{one.period} at {boundary.value:.6g}"
        for off in (OFF, 10 * OFF, 100 * OFF):
            with suppress(AnalysisError):
                curve, start = branch_off(one.curve, boundary.point, mode, times, off)
                yield Lead(curve, start, origin, False, boundary.point.orbit.points)
                break


def _is_known(one: Followed, lead: Lead) -> bool:
    """Whether a branch that was followed is the one that a lead leads to."""
    if (one.period, one.symmetric) != (lead.curve.period, lead.curve.symmetric):
        return False
    if not len(lead.junction):
        return any(_between(a, b, lead.start) for a, b in pairwise(one.branch.points))
    meets = [points for _, points in _simpler_ends(one)]
    meets += [boundary.point.orbit.points for boundary in one.boundaries]
    return any(_same(points, lead.junction) for points in meets)


def _between(a: BranchPoint, b: BranchPoint, point: BranchPoint) -> bool:
    """Whether an orbit lies on the way from one orbit of a branch to the next."""
    if not min(a.value, b.value) <= point.value <= max(a.value, b.value) or a.value == b.value:
        return False
    share = (point.value - a.value) / (b.value - a.value)
    points = a.orbit.points + share * (b.orbit.points - a.orbit.points)
    return _same(points, point.orbit.points)


def _same(one: Array, other: Array) -> bool:
    """Whether two orbits are one, wherever they begin."""
    shifts = (np.roll(one, i, axis=0) for i in range(len(one)))
    return one.shape == other.shape and any(np.abs(s - other).max() < SAME for s in shifts)
