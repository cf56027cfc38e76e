"""All branches of periodic orbits connected to a given orbit, with their boundaries.

The branch of an orbit is continued in both directions; at each flip the branch of twice the period
is continued, and so on up to a largest period. A branch that ends in an orbit of half its period
leads back to the branch of that orbit, so the cascade P1 -> P2 -> P4 is found from any member.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.boundaries import (
    Boundary,
    Watch,
    bisect,
    critical_mode,
    find_boundaries,
)
from herringbone_sim.dynamics.continuation import (
    Branch,
    StepControl,
    branch_off,
    follow,
    follow_both,
    passes_simpler,
)
from herringbone_sim.dynamics.curve import BranchPoint, Curve, Family, begin
from herringbone_sim.errors import AnalysisError, ParameterError

SIMPLER = ("halved", "mirrored")
OFF = 1e-4  # arclength from a junction to the first orbit of the branch that leaves there
SAME = 1e-3  # largest difference of equal orbits; junctions are located to about OFF


@dataclass(frozen=True)
class Followed:
    """A continued branch with its boundaries.

    Attributes:
        curve: the curve that contains it (period and symmetry).
        branch: its orbits.
        boundaries: in the order of the branch.
        origin: how the branch was reached, as text such as ``flip of P1 at 0.5``.
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
        """Whether left and right are equal along the branch."""
        return self.curve.symmetric


@dataclass(frozen=True)
class CascadeOptions:
    """Limits of the search for connected branches.

    Attributes:
        max_period: largest period that is continued [forcing periods].
        asymmetric: also follow branches that leave a symmetric one by a left-right perturbation.
        steps: step control of the continuation.
        branches: largest number of branches.
    """

    max_period: int = 4
    asymmetric: bool = False
    steps: StepControl = field(default_factory=StepControl)
    branches: int = 40


def trace_cascade(
    family: Family,
    starts: Sequence[tuple[float, Array]],
    watch: Watch | None = None,
    options: CascadeOptions | None = None,
    progress: Callable[[Followed], object] | None = None,
) -> list[Followed]:
    """Continue the branches of given orbits and all branches that connect to them.

    Args:
        starts: pairs of a parameter value and the states (period, n) of an orbit there, or near
            it.
        watch: see ``find_boundaries``.
        progress: called with each completed branch.

    Returns:
        At most ``options.branches`` branches, in the order in which they were completed.

    Raises:
        AnalysisError: Newton's method finds no orbit near a start.
    """
    options = options or CascadeOptions()
    waiting = [_first(family, points, value) for value, points in starts]
    branches: list[Followed] = []
    while waiting and len(branches) < options.branches:
        opening = waiting.pop(0)
        if any(_is_known(branch, opening) for branch in branches):
            continue
        done = _trace(opening, watch, options.steps)
        branches.append(done)
        if progress:
            progress(done)
        waiting += [*_to_simpler(done), *_to_doubled(done, options)]
    return branches


@dataclass(frozen=True)
class BranchStart:
    """Start of a branch that is still to be continued.

    Attributes:
        curve: of the branch.
        start: an orbit on it.
        origin: how the branch was reached, as text.
        both: whether to continue in both directions from the start.
        junction: (period, n) states of the orbit at which the branch meets the one that led to
            it; empty for a start that the caller gave.
    """

    curve: Curve
    start: BranchPoint
    origin: str
    both: bool
    junction: Array


def _first(family: Family, points: Array, value: float) -> BranchStart:
    """Branch start at an orbit that the caller gave."""
    curve, start = begin(family, points, value)
    return BranchStart(curve, start, f"start at {value:g}", True, start.orbit.points[:0])


def _trace(opening: BranchStart, watch: Watch | None, steps: StepControl) -> Followed:
    """Continue a branch from its start and locate its boundaries."""
    curve = opening.curve
    branch = _trimmed(
        curve, (follow_both if opening.both else follow)(curve, opening.start, steps)
    )
    boundaries = tuple(find_boundaries(curve, branch, watch))
    return Followed(curve, branch, boundaries, opening.origin)


def _trimmed(curve: Curve, branch: Branch) -> Branch:
    """Move an end that passed an orbit of half the period, or a symmetric one, to before it."""
    points = list(branch.points)
    for last, inner, end in ((-1, -2, branch.ends[1]), (0, 1, branch.ends[0])):
        if end in SIMPLER:
            a = points[inner]
            passed = partial(passes_simpler, curve, a, what=end)
            points[last] = bisect(curve, a, points[last], passed, OFF)[0]
    return Branch(tuple(points), branch.ends)


def _simpler_ends(traced: Followed) -> list[tuple[BranchPoint, Array]]:
    """For each end at a simpler orbit: the branch's last orbit, and states of the simpler one.

    The states (period, n) are averaged over the halves of the period, or over left and right.
    """
    mirror, simpler = traced.curve.family.mirror, []
    for i, end in zip((0, -1), traced.branch.ends, strict=True):
        point = traced.branch.points[i]
        points = point.orbit.points
        if end == "halved":
            half = traced.period // 2
            simpler.append((point, 0.5 * (points[:half] + points[half:])))
        elif end == "mirrored" and mirror is not None:
            simpler.append((point, 0.5 * (points + points[:, mirror])))
    return simpler


def _to_simpler(traced: Followed) -> Iterator[BranchStart]:
    """Yield starts of the branches of half the period, or with left = right, at the ends."""
    family = traced.curve.family
    for point, junction in _simpler_ends(traced):
        for aside in (-OFF, OFF):
            with suppress(AnalysisError, ParameterError):
                value = point.value + aside * (family.high - family.low)
                curve, start = begin(family, _cleaned(junction, family), value)
                yield BranchStart(curve, start, f"end of P{traced.period}", True, junction)
                break


def _cleaned(points: Array, family: Family) -> Array:
    """Average left and right of states (period, n) if they differ by less than ``SAME``."""
    if family.mirror is None or np.abs(points - points[:, family.mirror]).max() > SAME:
        return points
    return 0.5 * (points + points[:, family.mirror])


def _to_doubled(traced: Followed, options: CascadeOptions) -> Iterator[BranchStart]:
    """Yield starts of the branches that leave at flips and, if asked, at transverse crossings."""
    for boundary in traced.boundaries:
        sort = "+1" if boundary.detail.endswith("+1") else "-1"
        parts = boundary.kind == "transverse" and abs(boundary.multiplier.imag) < 1e-9
        times = 2 if sort == "-1" else 1
        wanted = boundary.kind == "flip" or (parts and options.asymmetric)
        if not wanted or times * traced.period > options.max_period:
            continue
        mode = critical_mode(traced.curve, boundary)
        origin = f"{boundary.kind} of P{traced.period} at {boundary.value:.6g}"
        for off in (OFF, 10 * OFF, 100 * OFF):
            with suppress(AnalysisError):
                curve, start = branch_off(traced.curve, boundary.point, mode, times, off)
                yield BranchStart(curve, start, origin, False, boundary.point.orbit.points)
                break


def _is_known(traced: Followed, opening: BranchStart) -> bool:
    """Tell whether a start lies on the branch ``traced``, which was continued already."""
    if (traced.period, traced.symmetric) != (opening.curve.period, opening.curve.symmetric):
        return False
    if not len(opening.junction):
        return any(_between(a, b, opening.start) for a, b in pairwise(traced.branch.points))
    meets = [points for _, points in _simpler_ends(traced)]
    meets += [boundary.point.orbit.points for boundary in traced.boundaries]
    return any(_same(points, opening.junction) for points in meets)


def _between(a: BranchPoint, b: BranchPoint, point: BranchPoint) -> bool:
    """Tell whether an orbit lies between two neighbouring orbits of a branch, by interpolation."""
    if not min(a.value, b.value) <= point.value <= max(a.value, b.value) or a.value == b.value:
        return False
    share = (point.value - a.value) / (b.value - a.value)
    points = a.orbit.points + share * (b.orbit.points - a.orbit.points)
    return _same(points, point.orbit.points)


def _same(a: Array, b: Array) -> bool:
    """Tell whether two orbits (period, n) are equal to within ``SAME``, up to a cyclic shift."""
    shifts = (np.roll(a, i, axis=0) for i in range(len(a)))
    return a.shape == b.shape and any(np.abs(s - b).max() < SAME for s in shifts)
