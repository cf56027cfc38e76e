"""Where one simulated motion gives way to another: by bisection, every value from one start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.paper.observe import Observer
from herringbone_sim.paper.regimes import Sweep, find_cut, motions_of
from herringbone_sim.paper.scenarios import Scenario
from herringbone_sim.paper.staircase import Reading, Way, request
from herringbone_sim.paper.statements import BoundaryAt

ROUNDS, INNER = 2, 15


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
    other is left as ``locate`` finds it. Within the interval the last value before the first one
    that is no longer ``before`` counts.
    """
    found = locate(sweep, wanted)
    if not found.note.startswith("clean"):
        return found
    low, high = found.at - found.half_width, found.at + found.half_width
    for _ in range(ROUNDS):
        values = np.linspace(low, high, INNER + 2)
        motions = motions_of(observer.batch(request(one, reading, values[1:-1], way)))
        still = np.append(motions == wanted.before, False)
        first = int(np.argmin(still))
        low, high = float(values[first]), float(values[first + 1])
    return Boundary(
        (low + high) / 2.0,
        (high - low) / 2.0,
        found.share_before,
        found.share_after,
        "bisected",
    )
