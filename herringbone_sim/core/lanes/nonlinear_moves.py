"""A move of gears with ``Packed.powers``, which also ends where |f| passes ``LINEAR_BELOW``.

Intervals are cut where the series lose precision. Arguments: see ``lanes.packed``.
"""

from __future__ import annotations

from herringbone_sim.core.lanes.columns import jump_columns, move_nonlinear_columns, push_columns
from herringbone_sim.core.lanes.extended import (
    ends,
    jump_tangents,
    law_row,
    reverse_signs,
    stop_at_pitch,
)
from herringbone_sim.core.lanes.nonlinear_forces import LINEAR_BELOW
from herringbone_sim.core.lanes.nonlinear_series import (
    expand_derivatives,
    expand_nonlinear_motion,
    expand_nonlinear_tangent,
    shorten,
)
from herringbone_sim.core.lanes.packed import (
    AT,
    AT_DEPTH,
    BORDER,
    CONTACT,
    DAMPING,
    DAMPING_SHARE,
    DEEP,
    DEPTH,
    END,
    END_SLOPE,
    EXPONENT,
    JUMP,
    MOVE,
    NEXT,
    POWER,
    SIGN,
    SWITCHES,
)
from herringbone_sim.core.lanes.series import expand_excitation, take_state
from herringbone_sim.core.lanes.switching import count_contact, may_leave, touch, watch_sign
from herringbone_sim.core.lanes.vector import (
    bits,
    choose,
    get,
    load,
    n_lanes,
    put,
    store,
    without,
)
from herringbone_sim.core.packed import called, inlined
from herringbone_sim.core.switching import leaves_at, polynomial

MOST_MOVES = 4000  # within a grid step, after which a lane no longer stops at switches


@inlined
def bends(w, a, lane):
    """Whether the law of mesh a in a lane has a power of |f| that is not constant."""
    row = law_row(w)
    other = (
        get(w.constants, row + DAMPING_SHARE, a, lane) != 0.0
        and get(w.constants, row + POWER, a, lane) != 0.0
    )
    return get(w.constants, row + EXPONENT, a, lane) != 1.0 or other


@called
def touch_depth(w):
    """Set DEEP, whether a law with a power is in force, of meshes in lanes that begin a grid step.

    It is where |f| exceeds ``LINEAR_BELOW``; ``touch`` computes the deflections before.
    """
    for a in range(w.k.shape[1]):
        for lane in range(n_lanes(w.progress)):
            if get(w.progress, SWITCHES, 0, lane) == 0.0:
                x, b = get(w.x, 0, a, lane), get(w.constants, BORDER, a, lane)
                deep = bends(w, a, lane) and abs(x) > b + LINEAR_BELOW
                put(w.mesh_state, DEEP, a, lane, 1.0 if deep else 0.0)


@called
def find_nonlinear_moves(w):
    """Set MOVE: the fraction of its interval that each lane advances, 1 or up to a switch.

    Contact, force signs with friction, and DEEP (see ``touch_depth``) switch.
    """
    order, n = w.x.shape[0], w.x.shape[1]
    x = w.x.reshape(order, w.x.size // order)
    store(w.progress, MOVE, 0, 1.0)
    for r in range(w.rubs.size):
        watch_sign(w, w.rubs[r])
    for a in range(n):
        ends(w, w.x, a, END, END_SLOPE)
        store(w.mesh_state, AT, a, 2.0)
        store(w.mesh_state, AT_DEPTH, a, 2.0)
        seen, lane = may_switch(w, a), 0
        while seen:
            if seen & 1:
                locate(x, w, a, lane)
            seen >>= 1
            lane += 1
    stuck = load(w.progress, SWITCHES, 0) > (MOST_MOVES - 0.5)
    store(w.progress, MOVE, 0, choose(stuck, 1.0, load(w.progress, MOVE, 0)))


@inlined
def may_switch(w, a):
    """Return, as bits, the lanes in which column a may switch contact or DEEP in the interval.

    ``a``: a mesh or a seat. Reads END and END_SLOPE, set by ``ends``.
    """
    contact, b = load(w.mesh_state, CONTACT, a), load(w.constants, BORDER, a)
    start, first = load(w.x, 0, a), load(w.x, 1, a)
    stop, slope = load(w.mesh_state, END, a), load(w.mesh_state, END_SLOPE, a)
    zero, near = 0.0, LINEAR_BELOW
    is_open, deep = contact == zero, load(w.mesh_state, DEEP, a) != zero
    sign = choose(is_open, 1.0, contact)
    inner = choose(is_open, b, choose(deep, 0.0 - b - near, 0.0 - b))
    outer = choose(is_open, b, b + near)
    s, ds, e, de = sign * start, sign * first, sign * stop, sign * slope
    seen = may_leave(s + inner, ds, e + inner, de)
    other = may_leave(outer - s, zero - ds, outer - e, zero - de)
    return bits(seen | (other & without(deep)))


@called
def locate(x, w, a, lane):
    """Locate where contact (AT, NEXT) and DEEP (AT_DEPTH) of column a switch in one lane.

    ``a``: a mesh or a seat. AT and AT_DEPTH are fractions of the interval, above 1 for no switch.
    MOVE is reduced to the first of them. Nothing is changed after ``MOST_MOVES`` switches.
    """
    if get(w.progress, SWITCHES, 0, lane) >= MOST_MOVES:
        return
    column, first = a * n_lanes(w.progress) + lane, get(w.progress, MOVE, 0, lane)
    side, b = get(w.mesh_state, CONTACT, a, lane), get(w.constants, BORDER, a, lane)
    end, slope = get(w.mesh_state, END, a, lane), get(w.mesh_state, END_SLOPE, a, lane)
    if side == 0.0:
        up = leaves_at(x, column, b, -1.0, end, slope, first)
        down = leaves_at(x, column, -b, 1.0, end, slope, first)
        put(w.mesh_state, AT, a, lane, min(up, down))
        put(w.mesh_state, NEXT, a, lane, 1.0 if up < down else -1.0)
    else:
        border = side * (b + LINEAR_BELOW)
        put(w.mesh_state, NEXT, a, lane, 0.0)
        if get(w.mesh_state, DEEP, a, lane) != 0.0:
            put(
                w.mesh_state,
                AT_DEPTH,
                a,
                lane,
                leaves_at(x, column, border, side, end, slope, first),
            )
        else:
            put(w.mesh_state, AT, a, lane, leaves_at(x, column, side * b, side, end, slope, first))
            if a < w.k.shape[1] and bends(w, a, lane):
                put(
                    w.mesh_state,
                    AT_DEPTH,
                    a,
                    lane,
                    leaves_at(x, column, border, -side, end, slope, first),
                )
    put(
        w.progress,
        MOVE,
        0,
        lane,
        min(first, get(w.mesh_state, AT, a, lane), get(w.mesh_state, AT_DEPTH, a, lane)),
    )


@inlined
def law_force(w, a, lane, k, x, v):
    """Return the force of mesh a in one lane by the law for its present CONTACT and DEEP."""
    row, contact = law_row(w), get(w.mesh_state, CONTACT, a, lane)
    f = abs(contact) * x - contact * get(w.constants, BORDER, a, lane)
    exponent, share = (
        get(w.constants, row + EXPONENT, a, lane),
        get(w.constants, row + DAMPING_SHARE, a, lane),
    )
    spring, damper = f, 1.0
    depth = abs(f) if get(w.mesh_state, DEEP, a, lane) != 0.0 else LINEAR_BELOW
    if exponent != 1.0:
        spring = f * (depth / get(w.constants, row, a, lane)) ** (exponent - 1.0)
        if get(w.mesh_state, DEEP, a, lane) == 0.0:
            spring *= 2.0 / (exponent + 1.0)
    if share != 0.0:
        power = get(w.constants, row + POWER, a, lane)
        part = abs(contact) * (depth / get(w.constants, row + DEPTH, a, lane)) ** power
        if get(w.mesh_state, DEEP, a, lane) == 0.0:
            part /= power + 1.0
        damper += share * (part - 1.0)
    return k * spring + get(w.constants, DAMPING, a, lane) * damper * v


@called
def meet(w):
    """Store deflection, its rate and stiffness of every mesh at a switch that ends a move.

    They are in rows END and END_SLOPE and in ``nonlinear.met``, as tangent vectors overwrite the
    series.
    """
    order, n = w.x.shape[0], w.k.shape[1]
    x, v = (
        w.x.reshape(order, w.x.size // order),
        w.nonlinear.rate.reshape(order, w.nonlinear.rate.size // order),
    )
    k = w.k.reshape(order, w.k.size // order)
    for a in range(n):
        for lane in range(n_lanes(w.progress)):
            move = get(w.progress, MOVE, 0, lane)
            if move < 1.0:
                column = a * n_lanes(w.progress) + lane
                put(w.mesh_state, END, a, lane, polynomial(x, column, move))
                put(w.mesh_state, END_SLOPE, a, lane, polynomial(v, column, move))
                put(w.nonlinear.met, 0, a, lane, polynomial(k, column, move))


@called
def switch(w):
    """Switch contact, DEEP and signs at the end of the moves; returns whether a force jumps."""
    jumps = False
    reverse_signs(w)
    for a in range(w.x.shape[1]):
        for lane in range(n_lanes(w.progress)):
            put(w.mesh_state, JUMP, a, lane, 0.0)
            move = get(w.progress, MOVE, 0, lane)
            if not move < 1.0:
                continue
            if a >= w.k.shape[1]:
                if get(w.mesh_state, AT, a, lane) == move:
                    put(w.mesh_state, CONTACT, a, lane, get(w.mesh_state, NEXT, a, lane))
            elif (
                get(w.mesh_state, AT, a, lane) == move
                or get(w.mesh_state, AT_DEPTH, a, lane) == move
            ):
                x, v = get(w.mesh_state, END, a, lane), get(w.mesh_state, END_SLOPE, a, lane)
                k = get(w.nonlinear.met, 0, a, lane)
                before = law_force(w, a, lane, k, x, v)
                if get(w.mesh_state, AT, a, lane) == move:
                    put(w.mesh_state, CONTACT, a, lane, get(w.mesh_state, NEXT, a, lane))
                else:
                    put(w.mesh_state, DEEP, a, lane, 1.0 - get(w.mesh_state, DEEP, a, lane))
                jump = law_force(w, a, lane, k, x, v) - before
                if v != 0.0 and jump != 0.0:
                    put(w.mesh_state, JUMP, a, lane, jump / v)
                    put(w.mesh_state, SIGN, a, lane, 1.0 if v > 0.0 else -1.0)
                    jumps = True
    return jumps


@called
def move_nonlinear(unrolled, w, neighbours, inverse, controlled):
    """Advance every lane by one move, in place; forces may be powers, as ``Packed.powers`` tells.

    ``lanes.packed`` explains moves and arguments.
    """
    stop_at_pitch(w)
    expand_excitation(w, inverse, controlled)
    touch(unrolled, w)
    touch_depth(w)
    expand_nonlinear_motion(unrolled, w, controlled, inverse)
    shorten(w)
    find_nonlinear_moves(w)
    if neighbours is not None:
        push_columns(unrolled, w, neighbours, inverse, controlled)
    take_state(unrolled, w, 0)
    meet(w)
    if w.y.shape[0] > 1 or neighbours is not None:
        expand_derivatives(w)
    for row in range(1, w.y.shape[0]):
        expand_nonlinear_tangent(unrolled, w, row, row == 1 or len(unrolled[0]) == 2, inverse)
        take_state(unrolled, w, row)
    if neighbours is not None:
        move_nonlinear_columns(unrolled, w, neighbours, inverse)
    count_contact(w)
    if switch(w):
        jump_tangents(unrolled, w)
        if neighbours is not None:
            jump_columns(unrolled, w, neighbours)
