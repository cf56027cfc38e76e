"""Locate contact switches as roots of Taylor polynomials.

``a`` (order + 1, columns) holds coefficients in s, which goes from 0 to 1 within a step.
"""

from __future__ import annotations

from herringbone_sim.core.packed import compiled, inlined


@inlined
def polynomial(a, m, s):
    """Return the value at s of the polynomial in column m."""
    value = a[a.shape[0] - 1, m]
    for i in range(a.shape[0] - 2, -1, -1):
        value = value * s + a[i, m]
    return value


@inlined
def value_and_slope(a, m, s):
    """Return value and derivative at s of the polynomial in column m."""
    value = a[a.shape[0] - 1, m]
    ds = 0.0
    for i in range(a.shape[0] - 2, -1, -1):
        ds = ds * s + value
        value = value * s + a[i, m]
    return value, ds


@inlined
def slope(a, m, s):
    """Return the derivative at s of the polynomial in column m."""
    last = a.shape[0] - 1
    value = last * a[last, m]
    for i in range(last - 1, 0, -1):
        value = value * s + i * a[i, m]
    return value


@inlined
def curvature(a, m, s):
    """Return the second derivative at s of the polynomial in column m."""
    last = a.shape[0] - 1
    value = last * (last - 1) * a[last, m]
    for i in range(last - 1, 1, -1):
        value = value * s + i * (i - 1) * a[i, m]
    return value


@compiled
def polynomial_zero(a, m, level, low, at_low, high, at_high):
    """Return where the polynomial in column m equals ``level``, by Newton's method in a bracket.

    ``at_low`` and ``at_high`` are its values minus ``level`` at ``low`` and ``high``.
    """
    below = at_low < 0.0
    s = low + (high - low) * at_low / (at_low - at_high) if at_low != at_high else low
    for _ in range(60):
        value, ds = value_and_slope(a, m, s)
        value -= level
        if (value < 0.0) == below:
            low = s
        else:
            high = s
        new = s - value / ds if ds != 0.0 else low
        if not low <= new <= high:
            new = 0.5 * (low + high)
        elif abs(new - s) < 1e-9:
            return new
        s = new
    return s


@compiled
def extremum(a, m, low, high):
    """Return the s of an extremum of the polynomial in column m between ``low`` and ``high``, by
    Newton's method in a bracket.
    """
    falling = slope(a, m, low) < 0.0
    s = 0.5 * (low + high)
    for _ in range(60):
        value = slope(a, m, s)
        if (value < 0.0) == falling:
            low = s
        else:
            high = s
        dd = curvature(a, m, s)
        new = s - value / dd if dd != 0.0 else low
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - s) < 1e-12:
            return new
        s = new
    return s


@compiled
def leaves_at(a, m, level, sign, end, end_slope, before):
    """Return the first s in [0, 1] at which sign * (x - level) turns negative; 2 if there is none.

    x is the polynomial in column m; ``end`` and ``end_slope`` are its value and slope at s = 1. A
    step is short compared with the fastest oscillation, so x has at most one extremum in it. A
    crossing after ``before`` may be omitted (result 2), as another switch comes first.
    """
    start = sign * (a[0, m] - level)
    start_slope = sign * a[1, m]
    stop = sign * (end - level)
    stop_slope = sign * end_slope
    if stop < 0.0:
        if start > 0.0:
            if before < 1.0 and sign * (polynomial(a, m, before) - level) > 1e-12:
                return 2.0
            return polynomial_zero(a, m, level, 0.0, a[0, m] - level, 1.0, end - level)
        if start_slope <= 0.0:
            return 0.0
        top = extremum(a, m, 0.0, 1.0)
        at_top = polynomial(a, m, top) - level
        if sign * at_top <= 0.0:
            return 0.0
        return polynomial_zero(a, m, level, top, at_top, 1.0, end - level)
    if start_slope < 0.0 and stop_slope > 0.0:
        corner = (stop - stop_slope - start) / (start_slope - stop_slope)
        if start + start_slope * corner < 0.1 * (stop_slope - start_slope):
            bottom = extremum(a, m, 0.0, 1.0)
            at_bottom = polynomial(a, m, bottom) - level
            if sign * at_bottom < 0.0:
                if start <= 0.0:
                    return 0.0
                return polynomial_zero(a, m, level, 0.0, a[0, m] - level, bottom, at_bottom)
    return 2.0
