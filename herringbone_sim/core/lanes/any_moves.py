"""A move of gears that are not plain: more ends it than contact.

A step ends also where a law with a power of |f| begins to bend, where a force that rubs changes
its sign, at the pitch point, and where the series no longer hold.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.lanes.any_series import (
    NEAR,
    SIDE,
    START,
    TURN,
    begin_series,
    coordinate_row,
    deflect,
    expand_any_motion,
    expand_any_tangent,
    expand_derivatives,
    law_row,
    shift_row,
    shorten,
)
from herringbone_sim.core.lanes.packed import (
    AT,
    AT_DEPTH,
    AT_SIGN,
    BORDER,
    CARRIER,
    CONTACT,
    DAMPING,
    DEEP,
    DEPTH,
    END,
    END_SLOPE,
    EXPONENT,
    LEFT,
    MOVE,
    NEXT,
    OMEGA,
    OTHER,
    PHASE,
    PLANET,
    POWER,
    SHARE,
    SIGN,
    SUN,
    SWITCHES,
)
from herringbone_sim.core.lanes.series import expand_excitation
from herringbone_sim.core.lanes.switching import count_contact
from herringbone_sim.core.lanes.vector import fma, get, load, n_lanes, put, store
from herringbone_sim.core.packed import TWO_PI, compiled, inlined
from herringbone_sim.core.right_hand_side import ON_EDGE
from herringbone_sim.core.switching import leaves_at, polynomial

MOST_MOVES = 4000  # within a step of the grid; a lane that has made them is let through


@compiled
def stop_at_pitch(w):
    """End the step of each lane where its flanks next change their slide, if there is friction."""
    if w.shape[5] == 0:
        return
    for lane in range(n_lanes(w.lane)):
        phase, Omega = get(w.lane, PHASE, 0, lane), get(w.constants, OMEGA, 0, lane)
        left = get(w.lane, LEFT, 0, lane)
        half = phase / np.pi
        part = min(left, (np.floor(half + 2.0 * ON_EDGE) + 1.0 - half) * np.pi / Omega)
        turn = part * Omega / TWO_PI
        start = phase / TWO_PI
        whole = np.floor(start + 0.5 * turn + 0.5)
        put(w.lane, LEFT, 0, lane, part)
        put(w.lane, SHARE, 0, lane, get(w.lane, SHARE, 0, lane) * (part / left))
        put(w.own.turn, START, 0, lane, start - whole)
        put(w.own.turn, SIDE, 0, lane, 1.0 if start + 0.5 * turn > whole else -1.0)
        put(w.own.turn, TURN, 0, lane, turn)


@inlined
def bends(w, a, lane):
    """Whether the law of a mesh has a power that is no constant."""
    row = law_row(w)
    other = (
        get(w.constants, row + OTHER, a, lane) != 0.0
        and get(w.constants, row + POWER, a, lane) != 0.0
    )
    return get(w.constants, row + EXPONENT, a, lane) != 1.0 or other


@compiled
def touch_depth(shape, w):
    """Depth of the meshes of lanes that begin a step of the grid."""
    begin_series(w, 0)
    deflect(shape, w, 0, True)
    for a in range(w.k.shape[1]):
        for lane in range(n_lanes(w.lane)):
            if get(w.lane, SWITCHES, 0, lane) == 0.0:
                x, b = get(w.x, 0, a, lane), get(w.constants, BORDER, a, lane)
                contact = 1.0 if x > b else (-1.0 if x < -b else 0.0)
                put(w.mesh, CONTACT, a, lane, contact)
                deep = bends(w, a, lane) and abs(x) > b + NEAR
                put(w.mesh, DEEP, a, lane, 1.0 if deep else 0.0)


@compiled
def ends(w, series, end_row, slope_row):
    """Value and slope at the end of the step of each mesh's series, into rows of ``w.mesh``."""
    for a in range(w.k.shape[1]):
        end, slope = 0.0, 0.0
        for i in range(series.shape[0] - 1, 0, -1):
            x = load(series, i, a)
            end = end + x
            slope = fma(float(i), x, slope)
        store(w.mesh, end_row, a, end + load(series, 0, a))
        store(w.mesh, slope_row, a, slope)


@compiled
def find_events(w):
    """How far each lane goes, 1 or up to its first event, into ``w.lane``."""
    n = w.k.shape[1]
    x = w.x.reshape(w.x.shape[0], w.x.size // w.x.shape[0])
    force = w.own.force.reshape(w.x.shape[0], w.x.size // w.x.shape[0])
    ends(w, w.own.force, AT_DEPTH, AT_SIGN)
    store(w.lane, MOVE, 0, 1.0)
    for a in range(n):
        for lane in range(n_lanes(w.lane)):
            at = 2.0
            if w.shape[5] > 0 and get(w.lane, SWITCHES, 0, lane) < MOST_MOVES:
                end, slope = get(w.mesh, AT_DEPTH, a, lane), get(w.mesh, AT_SIGN, a, lane)
                sign, first = get(w.mesh, SIGN, a, lane), get(w.lane, MOVE, 0, lane)
                at = leaves_at(force, a * n_lanes(w.lane) + lane, 0.0, sign, end, slope, first)
                put(w.lane, MOVE, 0, lane, min(first, at))
            put(w.mesh, AT_SIGN, a, lane, at)
    ends(w, w.x, END, END_SLOPE)
    for a in range(n):
        for lane in range(n_lanes(w.lane)):
            locate(x, w, a, lane)


@compiled
def locate(x, w, a, lane):
    """Where mesh a makes or loses contact, or its law begins or ceases to bend, in one lane."""
    put(w.mesh, AT, a, lane, 2.0)
    put(w.mesh, AT_DEPTH, a, lane, 2.0)
    if get(w.lane, SWITCHES, 0, lane) >= MOST_MOVES:
        return
    column, first = a * n_lanes(w.lane) + lane, get(w.lane, MOVE, 0, lane)
    side, b = get(w.mesh, CONTACT, a, lane), get(w.constants, BORDER, a, lane)
    end, slope = get(w.mesh, END, a, lane), get(w.mesh, END_SLOPE, a, lane)
    if side == 0.0:
        up = leaves_at(x, column, b, -1.0, end, slope, first)
        down = leaves_at(x, column, -b, 1.0, end, slope, first)
        put(w.mesh, AT, a, lane, min(up, down))
        put(w.mesh, NEXT, a, lane, 1.0 if up < down else -1.0)
    else:
        border = side * (b + NEAR)
        put(w.mesh, NEXT, a, lane, 0.0)
        if get(w.mesh, DEEP, a, lane) != 0.0:
            put(w.mesh, AT_DEPTH, a, lane, leaves_at(x, column, border, side, end, slope, first))
        else:
            put(w.mesh, AT, a, lane, leaves_at(x, column, side * b, side, end, slope, first))
            if bends(w, a, lane):
                put(
                    w.mesh,
                    AT_DEPTH,
                    a,
                    lane,
                    leaves_at(x, column, border, -side, end, slope, first),
                )
    put(
        w.lane, MOVE, 0, lane, min(first, get(w.mesh, AT, a, lane), get(w.mesh, AT_DEPTH, a, lane))
    )


@compiled
def take_any_state(w, row):
    """State or tangent vector at the end of each lane's move into ``w.y``."""
    move, s = load(w.lane, MOVE, 0), w.shape[4]
    m, last = w.q.shape[1] - s, w.q.shape[0] - 1
    for k in range(m + s):
        q, v = load(w.q, last, k), load(w.v, last, k)
        for i in range(last - 1, -1, -1):
            q = fma(q, move, load(w.q, i, k))
            v = fma(v, move, load(w.v, i, k))
        store(w.y, row, k if k < m else m + k, q)
        store(w.y, row, m + k if k < m else m + s + k, v)


@inlined
def law_force(w, a, lane, k, x, v):
    """Force of a mesh in one lane by the law in force in its present contact and depth."""
    row, contact = law_row(w), get(w.mesh, CONTACT, a, lane)
    f = abs(contact) * x - contact * get(w.constants, BORDER, a, lane)
    exponent, share = (
        get(w.constants, row + EXPONENT, a, lane),
        get(w.constants, row + OTHER, a, lane),
    )
    spring, damper = f, 1.0
    depth = abs(f) if get(w.mesh, DEEP, a, lane) != 0.0 else NEAR
    if exponent != 1.0:
        spring = f * (depth / get(w.constants, row, a, lane)) ** (exponent - 1.0)
        if get(w.mesh, DEEP, a, lane) == 0.0:
            spring *= 2.0 / (exponent + 1.0)
    if share != 0.0:
        power = get(w.constants, row + POWER, a, lane)
        part = abs(contact) * (depth / get(w.constants, row + DEPTH, a, lane)) ** power
        if get(w.mesh, DEEP, a, lane) == 0.0:
            part /= power + 1.0
        damper += share * (part - 1.0)
    return k * spring + get(w.constants, DAMPING, a, lane) * damper * v


@compiled
def meet(w):
    """Deflection, its rate and the stiffness of every mesh at the end of the moves, kept in
    ``w.mesh`` and ``own.other`` while tangent vectors use their series.
    """
    n = w.k.shape[1]
    x, v = (
        w.x.reshape(w.x.shape[0], w.x.size // w.x.shape[0]),
        w.own.rate.reshape(w.x.shape[0], -1),
    )
    k = w.k.reshape(w.x.shape[0], w.x.size // w.x.shape[0])
    for a in range(n):
        for lane in range(n_lanes(w.lane)):
            move = get(w.lane, MOVE, 0, lane)
            if move < 1.0:
                column = a * n_lanes(w.lane) + lane
                put(w.mesh, END, a, lane, polynomial(x, column, move))
                put(w.mesh, END_SLOPE, a, lane, polynomial(v, column, move))
                put(w.own.met, 0, a, lane, polynomial(k, column, move))


@compiled
def switch(w):
    """Switch all that does so at the end of the moves; jumps of the forces into ``own.jump``."""
    jumps = False
    for a in range(w.k.shape[1]):
        for lane in range(n_lanes(w.lane)):
            put(w.own.jump, 0, a, lane, 0.0)
            move = get(w.lane, MOVE, 0, lane)
            if not move < 1.0:
                continue
            if get(w.mesh, AT, a, lane) == move or get(w.mesh, AT_DEPTH, a, lane) == move:
                x, v = get(w.mesh, END, a, lane), get(w.mesh, END_SLOPE, a, lane)
                k = get(w.own.met, 0, a, lane)
                before = law_force(w, a, lane, k, x, v)
                if get(w.mesh, AT, a, lane) == move:
                    put(w.mesh, CONTACT, a, lane, get(w.mesh, NEXT, a, lane))
                else:
                    put(w.mesh, DEEP, a, lane, 1.0 - get(w.mesh, DEEP, a, lane))
                jump = law_force(w, a, lane, k, x, v) - before
                if v != 0.0 and jump != 0.0:
                    put(w.own.jump, 0, a, lane, jump / v)
                    jumps = True
            if get(w.mesh, AT_SIGN, a, lane) == move:
                put(w.mesh, SIGN, a, lane, -get(w.mesh, SIGN, a, lane))
    return jumps


@compiled
def jump_tangents(shape, w):
    """Saltation of tangent vectors where a mesh force jumps: the other motion jumps later."""
    sides, c, s = len(shape[0]), len(shape[1]), w.shape[4]
    half, m = sides * c, w.q.shape[1] - s
    for row in range(1, w.y.shape[0]):
        coupled = row == 1 or sides == 2
        for lane in range(n_lanes(w.lane)):
            for a in range(2 * half):
                jump = get(w.own.jump, 0, a, lane)
                if jump == 0.0:
                    continue
                planet = a % half
                r = get(w.y, row, sides + planet, lane)
                x = get(w.y, row, planet // c, lane) - r if a < half else r
                for j in range(s):
                    shift = get(w.constants, shift_row(w, j), a, lane)
                    x += shift * get(w.y, row, 2 * m + j, lane)
                push = jump * x
                carrier = push * get(w.constants, CARRIER, 0, lane) if coupled else 0.0
                for side in range(sides):
                    put(w.y, row, m + side, lane, get(w.y, row, m + side, lane) - 2.0 * carrier)
                for k in range(half):
                    put(
                        w.y, row, m + sides + k, lane, get(w.y, row, m + sides + k, lane) - carrier
                    )
                own = push * get(w.constants, PLANET, planet, lane)
                if a < half:
                    put(
                        w.y,
                        row,
                        m + planet // c,
                        lane,
                        get(w.y, row, m + planet // c, lane)
                        - push * get(w.constants, SUN, planet // c, lane),
                    )
                    put(
                        w.y,
                        row,
                        m + sides + planet,
                        lane,
                        get(w.y, row, m + sides + planet, lane) + own,
                    )
                else:
                    put(
                        w.y,
                        row,
                        m + sides + planet,
                        lane,
                        get(w.y, row, m + sides + planet, lane) - own,
                    )
                for k in range(m + s):
                    at = m + k if k < m else m + s + k
                    put(
                        w.y,
                        row,
                        at,
                        lane,
                        get(w.y, row, at, lane)
                        - push * get(w.constants, coordinate_row(w, 2, k), a, lane),
                    )


@compiled
def move_any(shape, w, inverse, controlled):
    """One move of every lane: to the end of its step, an event, or where the series end."""
    stop_at_pitch(w)
    expand_excitation(w, inverse, controlled)
    touch_depth(shape, w)
    expand_any_motion(shape, w, controlled, inverse)
    shorten(w)
    find_events(w)
    take_any_state(w, 0)
    meet(w)
    if w.y.shape[0] > 1:
        expand_derivatives(w)
    for row in range(1, w.y.shape[0]):
        expand_any_tangent(shape, w, row, row == 1 or len(shape[0]) == 2, inverse)
        take_any_state(w, row)
    count_contact(w)
    if switch(w):
        jump_tangents(shape, w)
