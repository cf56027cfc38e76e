"""Where one simulated motion gives way to another: by bisection, every value from one start."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.paper.observe import Observer
from herringbone_sim.paper.regimes import Sweep, find_cut, motions_of
from herringbone_sim.paper.scenarios import Array, Scenario
from herringbone_sim.paper.staircase import Reading, Way, request
from herringbone_sim.paper.statements import BoundaryAt

ROUNDS, INNER = 2, 15
PATIENCE, MOVES = 4000, 8
FINE = 1e-5


@dataclass(frozen=True)
class Boundary:
    """Where ``before`` gives way to ``after``.

    Attributes:
        at: the value; NaN where the edge is not to be seen.
        half_width: half of the interval in which it lies.
        share_before, share_after: shares of the sweep's values with the motion, within 3 % of the
            sweep on either side: 1 and 1 for a clean edge, less for a ragged one.
        note: what was done, in words.
    """

    at: float
    half_width: float
    share_before: float
    share_after: float
    note: str


def locate(sweep: Sweep, wanted: BoundaryAt) -> Boundary:
    """The boundary as the values of a sweep show it."""
    near = (wanted.low + wanted.high) / 2.0
    cut = find_cut(sweep, wanted.before, wanted.after, near)
    if cut is None:
        return Boundary(float("nan"), float("nan"), 0.0, 0.0, "no such edge")
    note = "clean on the grid" if cut.clean else "ragged: between two values of the sweep"
    half = (cut.high - cut.low) / 2.0
    return Boundary(cut.at, half, cut.share_before, cut.share_after, note)


def bisect(
    observer: Observer,
    one: Scenario,
    reading: Reading,
    sweep: Sweep,
    wanted: BoundaryAt,
    way: Way | None = None,
) -> Boundary:
    """The boundary to 1/256 of the sweep's step: sections of the interval, 15 values at a time.

    Only an edge whose two neighbours on the sweep show the two motions can be cut in pieces; any
    other is left as ``locate`` finds it. Every value is given 4000 cycles to settle, and its
    points must repeat to 1e-5 b_c: beside a period doubling a motion leaves its old orbit slowly
    and not far, so the interval of the sweep may have to be moved by some steps first. Within it
    the first value that is not ``before`` counts.
    """
    found = locate(sweep, wanted)
    if not found.note.startswith("clean"):
        return found

    def is_before(values: Array) -> NDArray[np.bool_]:
        asked = replace(request(one, reading, values, way), transient=PATIENCE)
        motions = motions_of(observer.batch(asked), FINE)
        same: NDArray[np.bool_] = motions == wanted.before
        return same

    low, high = found.at - found.half_width, found.at + found.half_width
    width = high - low
    for _ in range(MOVES):
        first, last = is_before(np.array([low, high]))
        if first and not last:
            break
        low, high = (low - width, high - width) if not first else (low + width, high + width)
    else:
        return replace(found, note="edge of the sweep; it moves with patience")
    for _ in range(ROUNDS):
        values = np.linspace(low, high, INNER + 2)
        at = int(np.argmin(np.append(is_before(values[1:-1]), False)))
        low, high = float(values[at]), float(values[at + 1])
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    return replace(found, at=middle, half_width=half, note="bisected")
