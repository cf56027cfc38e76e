"""Decide in each lane whether to accept a tried step, retry it, or locate an edge within it.

A step is first tried whole (WHOLE). If a margin dips below zero between its ends, the part up to
there is tried (DIP) and, if that passes no edge, the whole again (BACK). If it passes an edge, the
edge is bracketed by further trials (BRACKET) and the upper end of the bracket tried last (FINAL).
"""

from __future__ import annotations

import math

from herringbone_sim.core.packed import called, inlined
from herringbone_sim.effects.crossing import END, START, dip, guess, keep, passed
from herringbone_sim.effects.crossing import HIGH as AT_HIGH
from herringbone_sim.effects.crossing import LOW as AT_LOW
from herringbone_sim.effects.lanes.progress import (
    COUNT,
    DONE,
    ERROR,
    HIGH,
    LAST,
    LOW,
    MODE,
    PIECE_LENGTH,
    STEP,
    TRIED,
    WANT,
)
from herringbone_sim.effects.located import SHORTEST, TRIALS

WHOLE, DIP, BACK, BRACKET, FINAL, WAIT = range(6)  # ``progress[MODE]``; WAIT: no step is tried


@inlined
def plan(at, lane):
    """Set the step that a lane tries next (``TRIED``), and its mode to WHOLE.

    The rest of the piece is divided into the fewest equal steps that are no longer than ``WANT``.
    A piece is a grid step, or the part of it up to the next edge of an event of teeth or the next
    half mesh cycle.

    Args:
        at: (rows, lanes) ``LaneTrial.progress``, rows as in the module ``progress``; lengths in
            units of tau.
        lane: index of the lane.
    """
    left = at[PIECE_LENGTH, lane] - at[DONE, lane]
    at[MODE, lane], at[TRIED, lane] = WHOLE, left / math.ceil(left / at[WANT, lane])


@called
def narrow(at, lane, margin, margin_rate):
    """Set the next trial in the search for the first margin that falls below zero.

    A step ends at the upper end of the bracket, once the overshoot there is small enough or after
    ``TRIALS`` trials.

    Returns:
        Whether the last trial ended there; if not, ``TRIED`` and ``MODE`` are set anew.
    """
    low, high = at[LOW, lane], at[HIGH, lane]
    if at[COUNT, lane] < TRIALS:
        part, worst = guess(margin, margin_rate, high - low)
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
def open_bracket(at, lane, margin, margin_rate):
    """Begin the search for the edge that the tried step has passed; returns as ``narrow``."""
    high = at[TRIED, lane]
    at[LOW, lane], at[HIGH, lane], at[LAST, lane], at[COUNT, lane] = 0.0, high, high, 0.0
    keep(margin, margin_rate, START, AT_LOW)
    keep(margin, margin_rate, END, AT_HIGH)
    return narrow(at, lane, margin, margin_rate)


@called
def decide(at, lane, margin, margin_rate):
    """Return whether a lane accepts the step it tried; if not, set what it tries next.

    ``margin`` and ``margin_rate`` are the margins and rates of the lane, see ``crossing``.
    """
    mode, tried, error = at[MODE, lane], at[TRIED, lane], at[ERROR, lane]
    if mode == WHOLE:
        if not error <= 1.0 and tried > SHORTEST:
            at[WANT, lane] = tried * (max(0.2, 0.9 * error**-0.2) if error < 1e30 else 0.2)
            plan(at, lane)
            return False
        at[WANT, lane] = tried * min(5.0, 0.9 * max(error, 1e-9) ** -0.2)
        at[STEP, lane] = tried
        if passed(margin):
            return open_bracket(at, lane, margin, margin_rate)
        part = dip(margin, margin_rate, tried)
        if part < 1.0:
            at[TRIED, lane], at[MODE, lane] = part * tried, DIP
        return part == 1.0
    if mode == DIP:
        if passed(margin):
            return open_bracket(at, lane, margin, margin_rate)
        at[TRIED, lane], at[MODE, lane] = at[STEP, lane], BACK
        return False
    if mode == BRACKET:
        beyond = passed(margin)
        at[HIGH if beyond else LOW, lane] = tried
        keep(margin, margin_rate, END, AT_HIGH if beyond else AT_LOW)
        at[COUNT, lane] += 1.0
        return narrow(at, lane, margin, margin_rate)
    return mode != WAIT
