"""The Taylor step of a gear with powers: as ``taylor``, with more that ends a step.

That is the place where a law with a power of |f| begins to bend, and the end of what the series
hold for.
"""

from __future__ import annotations

from herringbone_sim.core.any_motion import (
    NEAR,
    bends,
    deflect,
    expand_any_motion,
    expand_any_tangent,
    expand_derivatives,
    linear_law,
    share_that_holds,
    shorten,
)
from herringbone_sim.core.extended import jump_tangents, set_seats, up_to_pitch
from herringbone_sim.core.packed import compiled, inlined
from herringbone_sim.core.right_hand_side import force_law
from herringbone_sim.core.series import begin_series, expand_excitation
from herringbone_sim.core.switching import leaves_at, next_sign, polynomial, slope, turn_signs
from herringbone_sim.core.taylor import take_state, up_to_edge

MOST_MOVES = 4000


@compiled
def set_any_contact(p, w, y):
    """Contact and depth of every mesh and contact of the seats, from the state, ``w.error``."""
    begin_series(p, w, y)
    set_seats(p, w, y)
    deflect(p, w, 0, 0.0, w.error)
    for a in range(4 * len(p.classes)):
        x = w.x[0, a]
        w.contact[a] = 1.0 if x > p.b[a] else (-1.0 if x < -p.b[a] else 0.0)
        w.any.deep[a] = 1.0 if bends(p, a) and abs(x) > p.b[a] + NEAR else 0.0


@inlined
def value_at_end(a, m):
    """Value at 1 of the series in column m."""
    value = 0.0
    for i in range(a.shape[0] - 1, -1, -1):
        value += a[i, m]
    return value


@compiled
def next_event(p, w):
    """First s in the step at which anything switches, 2 when nothing does.

    Where contact, depth and sign do is left in ``at``, ``any.at`` and ``sign_at``.
    """
    z = w.any
    n = 4 * len(p.classes)
    first = next_sign(p, w)
    for a in range(w.x.shape[1]):
        w.at[a] = 2.0
        if a < n:
            z.at[a] = 2.0
        elif p.seat[a - n, 3] != 0.0 or p.seat[a - n, 2] == 0.0:
            continue
        b = p.b[a] if a < n else p.seat[a - n, 2]
        side = w.contact[a]
        end, rate = value_at_end(w.x, a), slope(w.x, a, 1.0)
        if side == 0.0:
            up = leaves_at(w.x, a, b, -1.0, end, rate, first)
            down = leaves_at(w.x, a, -b, 1.0, end, rate, first)
            w.at[a] = min(up, down)
            w.next[a] = 1.0 if up < down else -1.0
        else:
            w.next[a] = 0.0
            border = side * (b + NEAR)
            if a < n and z.deep[a] != 0.0:
                z.at[a] = leaves_at(w.x, a, border, side, end, rate, first)
            else:
                w.at[a] = leaves_at(w.x, a, side * b, side, end, rate, first)
                if a < n and bends(p, a):
                    z.at[a] = leaves_at(w.x, a, border, -side, end, rate, first)
        first = min(first, w.at[a])
        if a < n:
            first = min(first, z.at[a])
    return first


@inlined
def force_in_state(p, w, a, k, x, v):
    """Force of a mesh by the law that is in force in its present contact and depth."""
    f = abs(w.contact[a]) * x - w.contact[a] * p.b[a]
    if w.any.deep[a] != 0.0:
        return force_law(p, a, k, f, v)
    spring, damper = linear_law(p, a, abs(w.contact[a]))
    return k * spring * f + p.damping[a] * damper * v


@compiled
def meet(p, w, s):
    """Deflection and rate of every mesh at s, kept while tangent vectors use their series."""
    for a in range(4 * len(p.classes)):
        w.end[a] = polynomial(w.x, a, s)
        w.end_slope[a] = polynomial(w.any.rate, a, s)


@compiled
def switch(p, w, s):
    """Switch all that does so at s; leaves in ``jump`` how forces jump, over the rate."""
    z = w.any
    n = 4 * len(p.classes)
    turn_signs(p, w, s)
    for a in range(n):
        w.jump[a] = 0.0
        if w.at[a] == s or z.at[a] == s:
            k, x, v = polynomial(w.k, a, s), w.end[a], w.end_slope[a]
            before = force_in_state(p, w, a, k, x, v)
            if w.at[a] == s:
                w.contact[a] = w.next[a]
            else:
                z.deep[a] = 1.0 - z.deep[a]
            jump = force_in_state(p, w, a, k, x, v) - before
            if v != 0.0 and jump != 0.0:
                w.jump[a] = jump / v
                w.sign[a] = 1.0 if v > 0.0 else -1.0
    for a in range(n, w.x.shape[1]):
        if w.at[a] == s:
            w.contact[a] = w.next[a]


@compiled
def move_any_tangents(p, w, tangents, h, s):
    """Advance tangent vectors by s * h with the series of the step just taken."""
    if tangents.shape[0] == 0:
        return
    expand_derivatives(p, w)
    for k in range(tangents.shape[0]):
        expand_any_tangent(p, w, tangents[k], h, w.none_m)
        take_state(p, w, tangents[k], s)


@compiled
def any_step(p, w, y, tangents, phase, cycle, h):
    """Advance y, and tangents (k, n_state) if any, by h; returns the switches passed."""
    left = h
    at = phase
    switches = 0
    moves = 0
    begins = True
    while True:
        part = up_to_pitch(p, w, at, up_to_edge(p, at, cycle, left))
        expand_excitation(p, w, at, cycle, part)
        if begins:
            set_any_contact(p, w, y)
            begins = False
        expand_any_motion(p, w, y, part)
        share = share_that_holds(w) if moves < MOST_MOVES else 1.0
        if share < 1.0:
            shorten(w, share)
            part *= share
        s = next_event(p, w) if moves < MOST_MOVES else 2.0
        moves += 1
        if s < 1.0:
            switches += 1
        else:
            s = 1.0
        take_state(p, w, y, s)
        meet(p, w, s)
        move_any_tangents(p, w, tangents, part, s)
        if s == 1.0 and part == left:
            return switches
        if s < 1.0:
            switch(p, w, s)
            jump_tangents(p, w, tangents, s)
        at += p.Omega * part * s
        left -= part * s
