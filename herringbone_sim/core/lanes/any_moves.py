"""A move of gears that are not plain, in all lanes: ``core.any_step``, lanes at once."""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.any_motion import NEAR
from herringbone_sim.core.any_step import MOST_MOVES
from herringbone_sim.core.lanes.any_series import (
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
    take_any_state,
)
from herringbone_sim.core.lanes.columns import move_any_columns, push_columns
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
from herringbone_sim.core.lanes.vector import LANES, fma, load, splat, store
from herringbone_sim.core.packed import TWO_PI, compiled, inlined
from herringbone_sim.core.right_hand_side import ON_EDGE
from herringbone_sim.core.switching import leaves_at, polynomial


@compiled
def stop_at_pitch(w):
    """End the step of each lane where its flanks next change their slide, if there is friction."""
    if w.shape[5] == 0:
        return
    for lane in range(LANES):
        phase, Omega = w.lane[PHASE, 0, lane], w.constants[OMEGA, 0, lane]
        left = w.lane[LEFT, 0, lane]
        half = phase / np.pi
        part = min(left, (np.floor(half + 2.0 * ON_EDGE) + 1.0 - half) * np.pi / Omega)
        turn = part * Omega / TWO_PI
        start = phase / TWO_PI
        whole = np.floor(start + 0.5 * turn + 0.5)
        w.lane[LEFT, 0, lane] = part
        w.lane[SHARE, 0, lane] *= part / left
        w.own.turn[START, 0, lane] = start - whole
        w.own.turn[SIDE, 0, lane] = 1.0 if start + 0.5 * turn > whole else -1.0
        w.own.turn[TURN, 0, lane] = turn


@inlined
def bends(w, a, lane):
    """Whether the law of a mesh has a power that is no constant."""
    row = law_row(w)
    other = w.constants[row + OTHER, a, lane] != 0.0 and w.constants[row + POWER, a, lane] != 0.0
    return w.constants[row + EXPONENT, a, lane] != 1.0 or other


@compiled
def touch_depth(shape, w):
    """Depth of the meshes of lanes that begin a step of the grid."""
    begin_series(w, 0)
    deflect(shape, w, 0, True)
    for a in range(w.k.shape[1]):
        for lane in range(LANES):
            if w.lane[SWITCHES, 0, lane] == 0.0:
                x, b = w.x[0, a, lane], w.constants[BORDER, a, lane]
                contact = 1.0 if x > b else (-1.0 if x < -b else 0.0)
                w.mesh[CONTACT, a, lane] = contact
                deep = bends(w, a, lane) and abs(x) > b + NEAR
                w.mesh[DEEP, a, lane] = 1.0 if deep else 0.0


@compiled
def ends(w, series, end_row, slope_row):
    """Value and slope at the end of the step of each mesh's series, into rows of ``w.mesh``."""
    for a in range(w.k.shape[1]):
        end, slope = splat(0.0), splat(0.0)
        for i in range(series.shape[0] - 1, 0, -1):
            x = load(series, i, a)
            end = end + x
            slope = fma(splat(float(i)), x, slope)
        store(w.mesh, end_row, a, end + load(series, 0, a))
        store(w.mesh, slope_row, a, slope)


@compiled
def find_events(w):
    """How far each lane goes, 1 or up to its first event, into ``w.lane``."""
    order, n = w.x.shape[0], w.k.shape[1]
    x = w.x.reshape(order, n * LANES)
    force = w.own.force.reshape(order, n * LANES)
    ends(w, w.own.force, AT_DEPTH, AT_SIGN)
    store(w.lane, MOVE, 0, splat(1.0))
    for a in range(n):
        for lane in range(LANES):
            at = 2.0
            if w.shape[5] > 0 and w.lane[SWITCHES, 0, lane] < MOST_MOVES:
                end, slope = w.mesh[AT_DEPTH, a, lane], w.mesh[AT_SIGN, a, lane]
                sign, first = w.mesh[SIGN, a, lane], w.lane[MOVE, 0, lane]
                at = leaves_at(force, a * LANES + lane, 0.0, sign, end, slope, first)
                w.lane[MOVE, 0, lane] = min(first, at)
            w.mesh[AT_SIGN, a, lane] = at
    ends(w, w.x, END, END_SLOPE)
    for a in range(n):
        for lane in range(LANES):
            locate(x, w, a, lane)


@compiled
def locate(x, w, a, lane):
    """Where mesh a makes or loses contact, or its law begins or ceases to bend, in one lane."""
    w.mesh[AT, a, lane] = w.mesh[AT_DEPTH, a, lane] = 2.0
    if w.lane[SWITCHES, 0, lane] >= MOST_MOVES:
        return
    column, first = a * LANES + lane, w.lane[MOVE, 0, lane]
    side, b = w.mesh[CONTACT, a, lane], w.constants[BORDER, a, lane]
    end, slope = w.mesh[END, a, lane], w.mesh[END_SLOPE, a, lane]
    if side == 0.0:
        up = leaves_at(x, column, b, -1.0, end, slope, first)
        down = leaves_at(x, column, -b, 1.0, end, slope, first)
        w.mesh[AT, a, lane] = min(up, down)
        w.mesh[NEXT, a, lane] = 1.0 if up < down else -1.0
    else:
        border = side * (b + NEAR)
        w.mesh[NEXT, a, lane] = 0.0
        if w.mesh[DEEP, a, lane] != 0.0:
            w.mesh[AT_DEPTH, a, lane] = leaves_at(x, column, border, side, end, slope, first)
        else:
            w.mesh[AT, a, lane] = leaves_at(x, column, side * b, side, end, slope, first)
            if bends(w, a, lane):
                w.mesh[AT_DEPTH, a, lane] = leaves_at(x, column, border, -side, end, slope, first)
    w.lane[MOVE, 0, lane] = min(first, w.mesh[AT, a, lane], w.mesh[AT_DEPTH, a, lane])


@inlined
def law_force(w, a, lane, k, x, v):
    """Force of a mesh in one lane by the law in force in its present contact and depth."""
    row, contact = law_row(w), w.mesh[CONTACT, a, lane]
    f = abs(contact) * x - contact * w.constants[BORDER, a, lane]
    exponent, share = w.constants[row + EXPONENT, a, lane], w.constants[row + OTHER, a, lane]
    spring, damper = f, 1.0
    depth = abs(f) if w.mesh[DEEP, a, lane] != 0.0 else NEAR
    if exponent != 1.0:
        spring = f * (depth / w.constants[row, a, lane]) ** (exponent - 1.0)
        if w.mesh[DEEP, a, lane] == 0.0:
            spring *= 2.0 / (exponent + 1.0)
    if share != 0.0:
        power = w.constants[row + POWER, a, lane]
        part = abs(contact) * (depth / w.constants[row + DEPTH, a, lane]) ** power
        if w.mesh[DEEP, a, lane] == 0.0:
            part /= power + 1.0
        damper += share * (part - 1.0)
    return k * spring + w.constants[DAMPING, a, lane] * damper * v


@compiled
def meet(w):
    """Deflection, its rate and the stiffness of every mesh at the end of the moves, kept in
    ``w.mesh`` and ``own.other`` while tangent vectors use their series.
    """
    order, n = w.x.shape[0], w.k.shape[1]
    x, v = w.x.reshape(order, n * LANES), w.own.rate.reshape(order, n * LANES)
    k = w.k.reshape(order, n * LANES)
    for a in range(n):
        for lane in range(LANES):
            move = w.lane[MOVE, 0, lane]
            if move < 1.0:
                column = a * LANES + lane
                w.mesh[END, a, lane] = polynomial(x, column, move)
                w.mesh[END_SLOPE, a, lane] = polynomial(v, column, move)
                w.own.met[0, a, lane] = polynomial(k, column, move)


@compiled
def switch(w):
    """Switch all that does so at the end of the moves; jumps of the forces into ``own.jump``."""
    jumps = False
    for a in range(w.k.shape[1]):
        for lane in range(LANES):
            w.own.jump[0, a, lane] = 0.0
            move = w.lane[MOVE, 0, lane]
            if not move < 1.0:
                continue
            if w.mesh[AT, a, lane] == move or w.mesh[AT_DEPTH, a, lane] == move:
                x, v = w.mesh[END, a, lane], w.mesh[END_SLOPE, a, lane]
                k = w.own.met[0, a, lane]
                before = law_force(w, a, lane, k, x, v)
                if w.mesh[AT, a, lane] == move:
                    w.mesh[CONTACT, a, lane] = w.mesh[NEXT, a, lane]
                else:
                    w.mesh[DEEP, a, lane] = 1.0 - w.mesh[DEEP, a, lane]
                jump = law_force(w, a, lane, k, x, v) - before
                if v != 0.0 and jump != 0.0:
                    w.own.jump[0, a, lane] = jump / v
                    jumps = True
            if w.mesh[AT_SIGN, a, lane] == move:
                w.mesh[SIGN, a, lane] = -w.mesh[SIGN, a, lane]
    return jumps


@compiled
def jump_tangents(shape, w, y, moved):
    """Saltation of tangent vectors where a mesh force jumps, see ``any_step.jump_tangents``.

    Rows of ``y`` are the state and tangent vectors, or columns where ``moved`` is not None.
    """
    sides, c, s = len(shape[0]), len(shape[1]), w.shape[4]
    half, m = sides * c, w.q.shape[1] - s
    first = 1 if moved is None else 0
    for row in range(first, y.shape[0]):
        coupled = row == 1 or sides == 2 or first == 0
        for lane in range(LANES):
            for a in range(2 * half):
                jump = w.own.jump[0, a, lane]
                if jump == 0.0:
                    continue
                planet = a % half
                r = y[row, sides + planet, lane]
                x = y[row, planet // c, lane] - r if a < half else r
                for j in range(s):
                    shift = w.constants[shift_row(w, j), a, lane]
                    x += shift * y[row, 2 * m + j, lane]
                if moved is not None:
                    x -= moved[row, a, lane]
                push = jump * x
                carrier = push * w.constants[CARRIER, 0, lane] if coupled else 0.0
                for side in range(sides):
                    y[row, m + side, lane] -= 2.0 * carrier
                for k in range(half):
                    y[row, m + sides + k, lane] -= carrier
                own = push * w.constants[PLANET, planet, lane]
                if a < half:
                    y[row, m + planet // c, lane] -= push * w.constants[SUN, planet // c, lane]
                    y[row, m + sides + planet, lane] += own
                else:
                    y[row, m + sides + planet, lane] -= own
                for k in range(m + s):
                    at = m + k if k < m else m + s + k
                    y[row, at, lane] -= push * w.constants[coordinate_row(w, 2, k), a, lane]


@compiled
def move_any(shape, w, near, inverse, controlled):
    """One move of every lane: to the end of its step, an event, or where the series end."""
    stop_at_pitch(w)
    expand_excitation(w, inverse, controlled)
    touch_depth(shape, w)
    expand_any_motion(shape, w, controlled, inverse)
    shorten(w)
    find_events(w)
    if near is not None:
        push_columns(shape, w, near, inverse, controlled)
    take_any_state(w, 0)
    meet(w)
    if w.y.shape[0] > 1 or near is not None:
        expand_derivatives(w)
    if w.y.shape[0] > 1:
        expand_any_tangent(shape, w, 1, True, inverse)
        take_any_state(w, 1)
    if w.y.shape[0] > 2:
        expand_any_tangent(shape, w, 2, False, inverse)
        take_any_state(w, 2)
    if near is not None:
        move_any_columns(shape, w, near, inverse)
    count_contact(w)
    if switch(w):
        jump_tangents(shape, w, w.y, None)
        if near is not None:
            jump_tangents(shape, w, near.columns, near.moved)
