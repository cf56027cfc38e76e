"""What comes of a step that was tried: taken, tried again, or looked into for a border."""

from __future__ import annotations

import math

from herringbone_sim.core.packed import called, inlined
from herringbone_sim.effects.crossing import END, START, dip, guess, keep, passed
from herringbone_sim.effects.crossing import HIGH as AT_HIGH
from herringbone_sim.effects.crossing import LOW as AT_LOW
from herringbone_sim.effects.lanes.places import (
    COUNT,
    DONE,
    ERROR,
    HIGH,
    LAST,
    LOW,
    MODE,
    REACH,
    STEP,
    TRIED,
    WANT,
)
from herringbone_sim.effects.located import SHORTEST, TRIALS

WHOLE, DIP, BACK, BRACKET, FINAL, WAIT = range(6)  # what is tried, ``lane[MODE]``


@inlined
def plan(at, lane):
    """Set the step that a lane tries next towards the end of its piece.

    The rest of its piece is divided into equal steps, none longer than ``WANT``; ``TRIED`` is one
    of them and ``MODE`` is ``WHOLE``.

    Args:
        at: (rows, lanes) ``LaneTrial.lane``, rows as in ``places``; lengths in units of tau.
        lane: index of the lane.
    """
    left = at[REACH, lane] - at[DONE, lane]
    at[MODE, lane], at[TRIED, lane] = WHOLE, left / math.ceil(left / at[WANT, lane])


@called
def narrow(at, lane, gap, pace):
    """The next look for a border; returns whether the step just tried ends there."""
    low, high = at[LOW, lane], at[HIGH, lane]
    if at[COUNT, lane] < TRIALS:
        part, worst = guess(gap, pace, high - low)
        if worst > 2.0:
            part = 0.5 if at[COUNT, lane] % 4 == 3 else part
            last = low + min(max(part, 1e-12), 1.0 - 1e-12) * (high - low)
            at[LAST, lane], at[TRIED, lane], at[MODE, lane] = last, last, BRACKET
            return False
    if at[LAST, lane] != high:
        at[TRIED, lane], at[MODE, lane] = high, FINAL
        return False
    return True


@called
def open_bracket(at, lane, gap, pace):
    """Look for the border that the step just tried has passed; as ``narrow``."""
    high = at[TRIED, lane]
    at[LOW, lane], at[HIGH, lane], at[LAST, lane], at[COUNT, lane] = 0.0, high, high, 0.0
    keep(gap, pace, START, AT_LOW)
    keep(gap, pace, END, AT_HIGH)
    return narrow(at, lane, gap, pace)


@called
def decide(at, lane, gap, pace):
    """Whether a lane takes the step it tried; else what it tries next is set."""
    mode, tried, error = at[MODE, lane], at[TRIED, lane], at[ERROR, lane]
    if mode == WHOLE:
        if not error <= 1.0 and tried > SHORTEST:
            at[WANT, lane] = tried * (max(0.2, 0.9 * error**-0.2) if error < 1e30 else 0.2)
            plan(at, lane)
            return False
        at[WANT, lane] = tried * min(5.0, 0.9 * max(error, 1e-9) ** -0.2)
        at[STEP, lane] = tried
        if passed(gap):
            return open_bracket(at, lane, gap, pace)
        part = dip(gap, pace, tried)
        if part < 1.0:
            at[TRIED, lane], at[MODE, lane] = part * tried, DIP
        return part == 1.0
    if mode == DIP:
        if passed(gap):
            return open_bracket(at, lane, gap, pace)
        at[TRIED, lane], at[MODE, lane] = at[STEP, lane], BACK
        return False
    if mode == BRACKET:
        beyond = passed(gap)
        at[HIGH if beyond else LOW, lane] = tried
        keep(gap, pace, END, AT_HIGH if beyond else AT_LOW)
        at[COUNT, lane] += 1.0
        return narrow(at, lane, gap, pace)
    return mode != WAIT
