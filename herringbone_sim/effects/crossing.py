"""Estimate where margins fall below zero within a step, from values and rates at two points.

``margin`` (4, 2 n) holds the margins of n meshes: distances of deflections from the next backlash
edge, then of forces from zero. ``margin_rate`` (4, n) holds the rates of the former per tau, see
``located.margins``. Rows: start of the step, both ends of the bracket, end of the step.
"""

from __future__ import annotations

import math

from herringbone_sim.core.packed import called, inlined

START, LOW, HIGH, END = range(4)
ON_BORDER = 1e-10  # b_c: overshoot of a deflection at the end of a step that ends at an edge
ON_ZERO = 1e-7  # overshoot of a force there, in b_c omega_n^2 kg over the projection


@called
def cubic_zero(a, b, slope_a, slope_b):
    """Return the zero in 0 .. 1 of a cubic with values a > 0 > b and given slopes at 0 and 1."""
    at = a / (a - b)
    for _ in range(4):
        c2 = 3.0 * (b - a) - 2.0 * slope_a - slope_b
        c3 = 2.0 * (a - b) + slope_a + slope_b
        value = a + at * (slope_a + at * (c2 + at * c3))
        slope_at = slope_a + at * (2.0 * c2 + 3.0 * c3 * at)
        if slope_at == 0.0:
            break
        at = min(max(at - value / slope_at, 0.0), 1.0)
    return at


@called
def passed(margin):
    """Return whether any margin is negative at the end of a step and less than at its start."""
    crossed = False
    for i in range(margin.shape[1]):
        crossed = crossed or (margin[END, i] < 0.0 and margin[END, i] < margin[START, i])
    return crossed


@called
def dip(margin, margin_rate, h):
    """Return the fraction of a step of length h at which a margin dips below zero, else 1.

    Only deflection margins >= 0 at both ends count, if the minimum of their cubic interpolant is
    below -ON_BORDER; the earliest minimum is returned.
    """
    first = 1.0
    for j in range(margin_rate.shape[1]):
        a, b = margin[START, j], margin[END, j]
        p, q = h * margin_rate[START, j], h * margin_rate[END, j]
        if p < 0.0 < q and a >= 0.0 and b >= 0.0:
            c2, c3 = 3.0 * (b - a) - 2.0 * p - q, 2.0 * (a - b) + p + q
            square = c2 * c2 - 3.0 * c3 * p
            if square > 0.0:
                at = -p / (c2 + math.sqrt(square)) if c2 > 0.0 else 1.0
                least = a + at * (p + at * (c2 + at * c3))
                if at < first and least < -ON_BORDER:
                    first = at
    return first


@inlined
def keep(margin, margin_rate, of, into):
    """Copy margins and rates from row ``of`` to row ``into``."""
    for i in range(margin.shape[1]):
        margin[into, i] = margin[of, i]
    for j in range(margin_rate.shape[1]):
        margin_rate[into, j] = margin_rate[of, j]


@called
def guess(margin, margin_rate, width):
    """Estimate where a bracket LOW .. HIGH of some width passes its first edge.

    Returns:
        The fraction of the bracket, and the largest overshoot at HIGH in units of ON_BORDER or
        ON_ZERO.
    """
    n, part, worst = margin_rate.shape[1], 1.0, 0.0
    for i in range(2 * n):
        if margin[HIGH, i] < 0.0 and margin[HIGH, i] < margin[START, i]:
            on = ON_BORDER if i < n else ON_ZERO
            worst = max(worst, -margin[HIGH, i] / on)
            a, b = max(margin[LOW, i], 0.0) + on, min(margin[HIGH, i] + on, -1e-3 * on)
            at = a / (a - b)
            if i < n:
                at = cubic_zero(a, b, width * margin_rate[LOW, i], width * margin_rate[HIGH, i])
            part = min(part, at)
    return part, worst
