"""A move of gears with powers, in all lanes: ``core.any_step``, lanes at once."""

from __future__ import annotations

from herringbone_sim.core.any_motion import NEAR
from herringbone_sim.core.any_step import MOST_MOVES
from herringbone_sim.core.lanes.any_series import (
    expand_any_motion,
    expand_any_tangent,
    expand_derivatives,
    shorten,
)
from herringbone_sim.core.lanes.extended import (
    ends,
    jump_tangents,
    law_row,
    stop_at_pitch,
    turn_signs,
)
from herringbone_sim.core.lanes.packed import (
    AT,
    AT_DEPTH,
    BORDER,
    CONTACT,
    DAMPING,
    DEEP,
    DEPTH,
    END,
    END_SLOPE,
    EXPONENT,
    JUMP,
    MOVE,
    NEXT,
    OTHER,
    POWER,
    SIGN,
    SWITCHES,
)
from herringbone_sim.core.lanes.series import expand_excitation, take_state
from herringbone_sim.core.lanes.switching import count_contact, may_leave, touch, watch_sign
from herringbone_sim.core.lanes.vector import LANES, bits, choose, load, splat, store, without
from herringbone_sim.core.packed import compiled, inlined
from herringbone_sim.core.switching import leaves_at, polynomial


@inlined
def bends(w, a, lane):
    """Whether the law of a mesh has a power that is no constant."""
    row = law_row(w)
    other = w.constants[row + OTHER, a, lane] != 0.0 and w.constants[row + POWER, a, lane] != 0.0
    return w.constants[row + EXPONENT, a, lane] != 1.0 or other


@compiled
def touch_depth(w):
    """Depth of the meshes of lanes that begin a step of the grid, after ``touch``."""
    for a in range(w.k.shape[1]):
        for lane in range(LANES):
            if w.lane[SWITCHES, 0, lane] == 0.0:
                x, b = w.x[0, a, lane], w.constants[BORDER, a, lane]
                deep = bends(w, a, lane) and abs(x) > b + NEAR
                w.mesh[DEEP, a, lane] = 1.0 if deep else 0.0


@compiled
def find_events(w):
    """How far each lane goes, 1 or up to its first event, into ``w.lane``."""
    order, n = w.x.shape[0], w.x.shape[1]
    x = w.x.reshape(order, n * LANES)
    store(w.lane, MOVE, 0, splat(1.0))
    for r in range(w.rubs.size):
        watch_sign(w, w.rubs[r])
    for a in range(n):
        ends(w, w.x, a, END, END_SLOPE)
        store(w.mesh, AT, a, splat(2.0))
        store(w.mesh, AT_DEPTH, a, splat(2.0))
        seen, lane = may_switch(w, a), 0
        while seen:
            if seen & 1:
                locate(x, w, a, lane)
            seen >>= 1
            lane += 1
    stuck = load(w.lane, SWITCHES, 0) > splat(MOST_MOVES - 0.5)
    store(w.lane, MOVE, 0, choose(stuck, splat(1.0), load(w.lane, MOVE, 0)))


@inlined
def may_switch(w, a):
    """Lanes, as bits, in which mesh a may pass a border of its contact or law within the step."""
    contact, b = load(w.mesh, CONTACT, a), load(w.constants, BORDER, a)
    start, first = load(w.x, 0, a), load(w.x, 1, a)
    stop, slope = load(w.mesh, END, a), load(w.mesh, END_SLOPE, a)
    zero, near = splat(0.0), splat(NEAR)
    is_open, deep = contact == zero, load(w.mesh, DEEP, a) != zero
    sign = choose(is_open, splat(1.0), contact)
    inner = choose(is_open, b, choose(deep, 0.0 - b - near, 0.0 - b))
    outer = choose(is_open, b, b + near)
    s, ds, e, de = sign * start, sign * first, sign * stop, sign * slope
    seen = may_leave(s + inner, ds, e + inner, de)
    other = may_leave(outer - s, zero - ds, outer - e, zero - de)
    return bits(seen | (other & without(deep)))


@compiled
def locate(x, w, a, lane):
    """Where mesh a makes or loses contact, or its law begins or ceases to bend, in one lane."""
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
            if a < w.k.shape[1] and bends(w, a, lane):
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
    order, n, rows = w.x.shape[0], w.k.shape[1], w.x.shape[1]
    x, v = w.x.reshape(order, rows * LANES), w.own.rate.reshape(order, rows * LANES)
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
    """Switch all that does so at the end of the moves; returns whether a force jumps."""
    jumps = False
    turn_signs(w)
    for a in range(w.x.shape[1]):
        for lane in range(LANES):
            w.mesh[JUMP, a, lane] = 0.0
            move = w.lane[MOVE, 0, lane]
            if not move < 1.0:
                continue
            if a >= w.k.shape[1]:
                if w.mesh[AT, a, lane] == move:
                    w.mesh[CONTACT, a, lane] = w.mesh[NEXT, a, lane]
            elif w.mesh[AT, a, lane] == move or w.mesh[AT_DEPTH, a, lane] == move:
                x, v = w.mesh[END, a, lane], w.mesh[END_SLOPE, a, lane]
                k = w.own.met[0, a, lane]
                before = law_force(w, a, lane, k, x, v)
                if w.mesh[AT, a, lane] == move:
                    w.mesh[CONTACT, a, lane] = w.mesh[NEXT, a, lane]
                else:
                    w.mesh[DEEP, a, lane] = 1.0 - w.mesh[DEEP, a, lane]
                jump = law_force(w, a, lane, k, x, v) - before
                if v != 0.0 and jump != 0.0:
                    w.mesh[JUMP, a, lane] = jump / v
                    w.mesh[SIGN, a, lane] = 1.0 if v > 0.0 else -1.0
                    jumps = True
    return jumps


@compiled
def move_any(shape, w, inverse, controlled):
    """One move of every lane: to the end of its step, an event, or where the series end."""
    stop_at_pitch(w)
    expand_excitation(w, inverse, controlled)
    touch(shape, w)
    touch_depth(w)
    expand_any_motion(shape, w, controlled, inverse)
    shorten(w)
    find_events(w)
    take_state(shape, w, 0)
    meet(w)
    if w.y.shape[0] > 1:
        expand_derivatives(w)
    if w.y.shape[0] > 1:
        expand_any_tangent(shape, w, 1, True, inverse)
        take_state(shape, w, 1)
    if w.y.shape[0] > 2:
        expand_any_tangent(shape, w, 2, False, inverse)
        take_state(shape, w, 2)
    count_contact(w)
    if switch(w) and w.y.shape[0] > 1:
        jump_tangents(shape, w)
