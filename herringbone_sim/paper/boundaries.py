"""Boundaries between motions: read from the values of a sweep, or bisected."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.paper.observe import BatchRunner
from herringbone_sim.paper.regimes import Sweep, find_cut, motions_of
from herringbone_sim.paper.scenarios import Scenario
from herringbone_sim.paper.staircase import Reading, request
from herringbone_sim.paper.statements import BoundaryAt

ROUNDS, INNER = 2, 15  # rounds of the bisection; values inside the interval in each
SETTLE = 4000  # mesh cycles discarded at each value
MOVES = 8  # largest number of steps by which the interval is moved
FINE = 1e-5  # b_c, tolerance of a period


@dataclass(frozen=True)
class Boundary:
    """Value of a parameter at which one motion changes to another.

    Attributes:
        at: the value; NaN if the sweep does not show the change.
        half_width: half of the interval in which it lies.
        share_before, share_after: fractions of the sweep's values with the two motions, within 3 %
            of the sweep on either side; 1 and 1 for a clean change, less for a ragged one.
        note: how it was obtained.
    """

    at: float
    half_width: float
    share_before: float
    share_after: float
    note: str


def locate(sweep: Sweep, wanted: BoundaryAt) -> Boundary:
    """Find a published boundary among the values of a sweep, see ``regimes.find_cut``."""
    near = (wanted.low + wanted.high) / 2.0
    cut = find_cut(sweep, wanted.before, wanted.after, near)
    if cut is None:
        return Boundary(float("nan"), float("nan"), 0.0, 0.0, "no such edge")
    note = "clean on the grid" if cut.clean else "ragged: between two values of the sweep"
    half = (cut.high - cut.low) / 2.0
    return Boundary(cut.at, half, cut.share_before, cut.share_after, note)


def bisect(
    runner: BatchRunner,
    scenario: Scenario,
    reading: Reading,
    sweep: Sweep,
    wanted: BoundaryAt,
) -> Boundary:
    """Locate a published boundary to 1/256 of the step of a sweep, 15 values at a time.

    Only a boundary whose two neighbouring values show the two motions can be bisected; any other
    is returned as from ``locate``. Every value settles for 4000 cycles and must repeat to 1e-5
    b_c: near a period doubling a motion leaves its old orbit slowly and not far, so the interval
    of the sweep may first have to be moved by some steps. In the interval, the first value
    without the motion ``before`` counts.

    Args:
        runner: integrates the runs.
        scenario: of the sweep.
        reading: parameters that the paper leaves open.
        sweep: in which the boundary is first located.
        wanted: the published boundary.
    """
    located = locate(sweep, wanted)
    if not located.note.startswith("clean"):
        return located

    def is_before(values: Array) -> Flags:
        runs = replace(request(scenario, reading, values), transient=SETTLE)
        motions = motions_of(runner.batch(runs), FINE)
        same: Flags = motions == wanted.before
        return same

    low, high = located.at - located.half_width, located.at + located.half_width
    width = high - low
    for _ in range(MOVES):
        first, last = is_before(np.array([low, high]))
        if first and not last:
            break
        low, high = (low - width, high - width) if not first else (low + width, high + width)
    else:
        return replace(located, note="edge of the sweep; it moves with more cycles to settle")
    for _ in range(ROUNDS):
        values = np.linspace(low, high, INNER + 2)
        at = int(np.argmin(np.append(is_before(values[1:-1]), False)))
        low, high = float(values[at]), float(values[at + 1])
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    return replace(located, at=middle, half_width=half, note="bisected")
