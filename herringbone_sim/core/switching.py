"""Where a series takes a level: the switching of contact, found on the series itself."""

from __future__ import annotations

from herringbone_sim.core.extended import n_own, set_seats, shift_deflections
from herringbone_sim.core.packed import compiled, inlined
from herringbone_sim.core.right_hand_side import deflections


@inlined
def polynomial(a, m, s):
    """Value at s of the series in column m."""
    value = a[a.shape[0] - 1, m]
    for i in range(a.shape[0] - 2, -1, -1):
        value = value * s + a[i, m]
    return value


@inlined
def value_and_slope(a, m, s):
    """Value and derivative at s of the series in column m."""
    value = a[a.shape[0] - 1, m]
    ds = 0.0
    for i in range(a.shape[0] - 2, -1, -1):
        ds = ds * s + value
        value = value * s + a[i, m]
    return value, ds


@inlined
def slope(a, m, s):
    """Derivative at s of the series in column m."""
    last = a.shape[0] - 1
    value = last * a[last, m]
    for i in range(last - 1, 0, -1):
        value = value * s + i * a[i, m]
    return value


@inlined
def curvature(a, m, s):
    """Second derivative at s of the series in column m."""
    last = a.shape[0] - 1
    value = last * (last - 1) * a[last, m]
    for i in range(last - 1, 1, -1):
        value = value * s + i * (i - 1) * a[i, m]
    return value


@compiled
def root(a, m, level, low, at_low, high, at_high):
    """Where the series in column m takes a level between low and high: Newton in a bracket."""
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
def turning_point(a, m, low, high):
    """Where the series in column m stands still between low and high: Newton in a bracket."""
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
    """First s in [0, 1] at which sign * (x - level) turns negative; 2 when it does not.

    A step is short against the fastest oscillation, so x has at most one turning point in it.
    A crossing known to lie after ``before`` may be left out (then 2): another switch comes first.
    """
    start = sign * (a[0, m] - level)
    start_slope = sign * a[1, m]
    stop = sign * (end - level)
    stop_slope = sign * end_slope
    if stop < 0.0:
        if start > 0.0:
            if before < 1.0 and sign * (polynomial(a, m, before) - level) > 1e-12:
                return 2.0
            return root(a, m, level, 0.0, a[0, m] - level, 1.0, end - level)
        if start_slope <= 0.0:
            return 0.0
        top = turning_point(a, m, 0.0, 1.0)
        at_top = polynomial(a, m, top) - level
        if sign * at_top <= 0.0:
            return 0.0
        return root(a, m, level, top, at_top, 1.0, end - level)
    if start_slope < 0.0 and stop_slope > 0.0:
        corner = (stop - stop_slope - start) / (start_slope - stop_slope)
        if start + start_slope * corner < 0.1 * (stop_slope - start_slope):
            bottom = turning_point(a, m, 0.0, 1.0)
            at_bottom = polynomial(a, m, bottom) - level
            if sign * at_bottom < 0.0:
                if start <= 0.0:
                    return 0.0
                return root(a, m, level, 0.0, a[0, m] - level, bottom, at_bottom)
    return 2.0


@inlined
def set_contact(p, w, y):
    """Contact of every mesh (Eqs. 1, 4) from the state and ``w.error``."""
    deflections(p, y[: 2 + 2 * len(p.classes)], w.end)
    if len(p.extended) > 0:
        shift_deflections(p, y, w.end)
        set_seats(p, w, y)
    for m in range(4 * len(p.classes)):
        x = w.end[m] - w.error[0, m]
        w.contact[m] = 1.0 if x > p.b[m] else (-1.0 if x < -p.b[m] else 0.0)


@inlined
def next_switch(p, w):
    """First switching within the step, s = 2 when there is none; new contacts in ``w.contact``.

    All meshes that switch at that very s switch together: identical halves and planets do.
    """
    n = 4 * len(p.classes)
    rows = n + n_own(p)
    b = w.border if len(p.extended) > 0 else p.b
    for m in range(rows):
        w.end[m] = w.x[0, m]
        w.end_slope[m] = 0.0
    for i in range(1, w.x.shape[0]):
        for m in range(rows):
            w.end[m] += w.x[i, m]
            w.end_slope[m] += i * w.x[i, m]
    first = 2.0
    if len(p.extended) > 0:
        first = next_sign(p, w)
    for m in range(rows):
        if m >= n and b[m] == 0.0:  # a seat without play
            w.at[m] = 2.0
            continue
        side = w.contact[m]
        end = w.end[m]
        end_slope = w.end_slope[m]
        w.next[m] = 0.0
        if side != 0.0:
            w.at[m] = leaves_at(w.x, m, side * b[m], side, end, end_slope, first)
        else:
            up = leaves_at(w.x, m, b[m], -1.0, end, end_slope, first)
            down = leaves_at(w.x, m, -b[m], 1.0, end, end_slope, first)
            w.at[m] = min(up, down)
            w.next[m] = 1.0 if up < down else -1.0
        first = min(first, w.at[m])
    if first < 1.0:
        for m in range(rows):
            if w.at[m] == first:
                w.contact[m] = w.next[m]
        if len(p.extended) > 0:
            turn_signs(p, w, first)
    return first


@inlined
def next_sign(p, w):
    """First s in the step at which a force that rubs changes its sign, 2 when none does."""
    first = 2.0
    for r in range(p.rubs.size):
        a = p.rubs[r]
        end = 0.0
        for i in range(w.forces.shape[0] - 1, -1, -1):
            end += w.forces[i, a]
        rate = slope(w.forces, a, 1.0)
        w.sign_at[a] = leaves_at(w.forces, a, 0.0, w.sign[a], end, rate, first)
        first = min(first, w.sign_at[a])
    return first


@inlined
def turn_signs(p, w, s):
    """Change the signs of the forces that do so at s."""
    for r in range(p.rubs.size):
        a = p.rubs[r]
        if w.sign_at[a] == s:
            w.sign[a] = -w.sign[a]
