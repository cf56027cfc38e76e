"""The Taylor step of a gear that is not plain: as ``taylor``, with more that switches.

Besides contact, a step ends where a law with a power of |f| begins to bend, where a force that
rubs changes its sign, at the pitch point, and where the series no longer hold.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.any_motion import (
    NEAR,
    begin_series,
    bends,
    deflect,
    expand_any_motion,
    expand_any_tangent,
    expand_derivatives,
    linear_law,
    mesh_force,
    share_that_holds,
    shorten,
)
from herringbone_sim.core.columns import move_any_columns, push_columns
from herringbone_sim.core.packed import compiled, inlined
from herringbone_sim.core.right_hand_side import ON_EDGE, accelerate, force_law
from herringbone_sim.core.series import expand_excitation
from herringbone_sim.core.switching import leaves_at, polynomial, slope
from herringbone_sim.core.taylor import up_to_edge

MOST_MOVES = 4000
CONTACT, DEPTH, SIGN = range(3)


@inlined
def up_to_pitch(p, phase, part):
    """A part of a step, or as much of it as lies before the flanks next change their slide."""
    if p.slide.shape[0] > 0:
        half = phase / np.pi + 2.0 * ON_EDGE
        part = min(part, (np.floor(half) + 1.0 - phase / np.pi) * np.pi / p.Omega)
    return part


@compiled
def set_any_contact(p, w, y):
    """Contact, depth and sign of the force of every mesh from the state and ``w.error``."""
    m = 2 + 2 * len(p.classes)
    begin_series(w, y, m)
    deflect(p, w, 0, 0.0, w.error)
    for a in range(4 * len(p.classes)):
        x = w.x[0, a]
        w.contact[a] = 1.0 if x > p.b[a] else (-1.0 if x < -p.b[a] else 0.0)
        w.any.deep[a] = 1.0 if bends(p, a) and abs(x) > p.b[a] + NEAR else 0.0


@compiled
def set_signs(p, w):
    """Sign of the force of every mesh at the start of the series."""
    for a in range(4 * len(p.classes)):
        w.any.sign[a] = 1.0 if w.any.force[0, a] >= 0.0 else -1.0


@compiled
def start_forces(p, w, y, h):
    """Order 0 of all mesh forces."""
    begin_series(w, y, 2 + 2 * len(p.classes))
    deflect(p, w, 0, 1.0 / h, w.error)
    for a in range(4 * len(p.classes)):
        mesh_force(p, w, 0, a, 1.0)


@inlined
def value_at_end(a, m):
    """Value at 1 of the series in column m."""
    value = 0.0
    for i in range(a.shape[0] - 1, -1, -1):
        value += a[i, m]
    return value


@compiled
def next_event(p, w):
    """First s in the step at which anything switches, 2 when nothing does; all in ``any.at``."""
    z = w.any
    first = 2.0
    for a in range(4 * len(p.classes)):
        z.at[CONTACT, a] = z.at[DEPTH, a] = z.at[SIGN, a] = 2.0
        side = w.contact[a]
        end, rate = value_at_end(w.x, a), slope(w.x, a, 1.0)
        if side == 0.0:
            up = leaves_at(w.x, a, p.b[a], -1.0, end, rate, first)
            down = leaves_at(w.x, a, -p.b[a], 1.0, end, rate, first)
            z.at[CONTACT, a] = min(up, down)
            w.next[a] = 1.0 if up < down else -1.0
        else:
            w.next[a] = 0.0
            border = side * (p.b[a] + NEAR)
            if z.deep[a] != 0.0:
                z.at[DEPTH, a] = leaves_at(w.x, a, border, side, end, rate, first)
            else:
                z.at[CONTACT, a] = leaves_at(w.x, a, side * p.b[a], side, end, rate, first)
                if bends(p, a):
                    z.at[DEPTH, a] = leaves_at(w.x, a, border, -side, end, rate, first)
        if p.slide.shape[0] > 0:
            end, rate = value_at_end(z.force, a), slope(z.force, a, 1.0)
            z.at[SIGN, a] = leaves_at(z.force, a, 0.0, z.sign[a], end, rate, first)
        first = min(first, z.at[CONTACT, a], z.at[DEPTH, a], z.at[SIGN, a])
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
    """Switch all that does so at s; leaves the jump of each mesh force in ``any.jump``."""
    z = w.any
    for a in range(4 * len(p.classes)):
        z.jump[a] = 0.0
        if z.at[CONTACT, a] == s or z.at[DEPTH, a] == s:
            k, x, v = polynomial(w.k, a, s), w.end[a], w.end_slope[a]
            before = force_in_state(p, w, a, k, x, v)
            if z.at[CONTACT, a] == s:
                w.contact[a] = w.next[a]
            else:
                z.deep[a] = 1.0 - z.deep[a]
            z.jump[a] = force_in_state(p, w, a, k, x, v) - before
        if z.at[SIGN, a] == s:
            z.sign[a] = -z.sign[a]


@inlined
def border_sides(p, w):
    """Side on which each mesh meets or leaves the border next, into ``w.force``."""
    for a in range(4 * len(p.classes)):
        w.force[a] = w.contact[a] if w.contact[a] != 0.0 else w.next[a]


@inlined
def take_any_state(w, y, m, s):
    """State of the series at s into y."""
    own = w.q.shape[1] - m
    for k in range(m):
        y[k] = polynomial(w.q, k, s)
        y[m + k] = polynomial(w.v, k, s)
    for j in range(own):
        y[2 * m + j] = polynomial(w.q, m + j, s)
        y[2 * m + own + j] = polynomial(w.v, m + j, s)


@compiled
def move_any_tangents(p, w, tangents, phase, h, s):
    """Advance tangent vectors by s * h with the series of the step just taken."""
    if tangents.shape[0] == 0:
        return
    m = 2 + 2 * len(p.classes)
    expand_derivatives(p, w)
    for k in range(tangents.shape[0]):
        expand_any_tangent(p, w, tangents[k], phase, h, w.none_m, w.any.spring, w.any.hold)
        take_any_state(w, tangents[k], m, s)


@compiled
def jump_tangents(p, w, tangents, moved):
    """Saltation of tangent vectors where a mesh force jumps: the other motion jumps later.

    ``moved`` is None, or (k, n_mesh) by how much the switches of columns move, in deflection.
    """
    c = len(p.classes)
    n = 4 * c
    m = 2 + 2 * c
    s = p.seat.shape[0]
    for a in range(n):
        if w.any.jump[a] == 0.0 or w.end_slope[a] == 0.0:
            continue
        for b in range(n):
            w.force[b] = 0.0
        w.force[a] = w.any.jump[a] / w.end_slope[a]
        for k in range(m + s):
            w.push[k] = 0.0
        accelerate(p, w.force, w.push)
        for k in range(m + s):
            w.push[k] -= p.own_force[k, a] * w.force[a]
        for t in range(tangents.shape[0]):
            y = tangents[t]
            side = (a // c) % 2
            r = y[2 + side * c + a % c]
            x = y[side] - r if a < 2 * c else r
            for j in range(s):
                x += p.own_shift[j, a] * y[2 * m + j]
            if moved is not None:
                x -= moved[t, a]
            for k in range(m):
                y[m + k] += w.push[k] * x
            for j in range(s):
                y[2 * m + s + j] += w.push[m + j] * x


@compiled
def any_step(p, w, y, tangents, near, phase, cycle, h):
    """As ``taylor.taylor_step``."""
    m = 2 + 2 * len(p.classes)
    left = h
    at = phase
    switches = 0
    moves = 0
    begins = True
    while True:
        part = up_to_pitch(p, at, up_to_edge(p, at, cycle, left))
        expand_excitation(p, w, at, cycle, part)
        if begins:
            set_any_contact(p, w, y)
            start_forces(p, w, y, part)
            set_signs(p, w)
            begins = False
        expand_any_motion(p, w, y, at, part)
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
        if near is not None:
            border_sides(p, w)
            push_columns(near, y, w.force, at, cycle, part, s)
        take_any_state(w, y, m, s)
        meet(p, w, s)
        move_any_tangents(p, w, tangents, at, part, s)
        if near is not None:
            move_any_columns(p, w, near, tangents.shape[0] > 0, at, part, s)
        if s == 1.0 and part == left:
            return switches
        if s < 1.0:
            switch(p, w, s)
            jump_tangents(p, w, tangents, None)
            if near is not None:
                jump_tangents(p, w, near.columns, near.moved)
        at += p.Omega * part * s
        left -= part * s
