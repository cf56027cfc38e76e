"""Find the first switch of contact in every lane, in all lanes at once where that is possible.

Rare cases are located lane by lane (``core.switching``). A margin is a quantity whose change from
positive to negative is a switch.
"""

from __future__ import annotations

from herringbone_sim.core.lanes.extended import ends, reverse_signs, set_jump, touch_all
from herringbone_sim.core.lanes.packed import (
    AT,
    AT_DEPTH,
    AT_SIGN,
    BACK,
    BORDER,
    CONTACT,
    DONE,
    DRIVE,
    END,
    END_SLOPE,
    MOVE,
    NEXT,
    SHARE,
    SIGN,
    SWITCHES,
)
from herringbone_sim.core.lanes.vector import (
    absolute,
    bits,
    choose,
    fma,
    get,
    load,
    n_lanes,
    put,
    root,
    store,
    without,
)
from herringbone_sim.core.packed import called, inlined
from herringbone_sim.core.switching import leaves_at

MAX_SUBSTEPS = 400  # moves within a grid step, after which a lane no longer stops at switches
CLOSE = 1e-6  # of the interval: Newton step after which the next is negligible, about its square


@inlined
def may_leave(start, start_slope, stop, stop_slope):
    """Return the mask of lanes in which a margin turns or may turn negative in the interval."""
    dips = (start_slope < 0.0) & (stop_slope > 0.0)
    if bits(dips):
        corner = (stop - stop_slope - start) / (start_slope - stop_slope)
        low = start + start_slope * corner < (stop_slope - start_slope) * 0.1
        return (stop < 0.0) | (dips & low)
    return stop < 0.0


@inlined
def cross(series, m, sign, border, start, start_slope, stop, wanted):
    """Return where the margins sign * x + border of column m, positive at 0, are zero before 1.

    Only ``wanted`` lanes are valid. Newton within a bracket, from the root of the parabola through
    both ends; the step after one of ``CLOSE`` is below 1e-12. A lane no longer changes once it has
    converged, so that its result does not depend on the others.
    """
    bend = stop - start - start_slope
    discriminant = start_slope * start_slope - 4.0 * start * bend
    s = (start + start) / (root(absolute(discriminant)) - start_slope)
    s = choose(wanted, s, 0.5)
    low, high = 0.0, 1.0
    last = series.shape[0] - 1
    unconverged = wanted
    for _ in range(60):
        value, ds = load(series, last, m), 0.0
        for i in range(last - 1, -1, -1):
            ds = fma(ds, s, value)
            value = fma(value, s, load(series, i, m))
        value, ds = fma(sign, value, border), sign * ds
        beyond = value < 0.0
        low, high = choose(beyond, low, s), choose(beyond, s, high)
        new = s - value / ds
        inside = without((new < low) | (new > high)) & (new == new)
        there = inside & (absolute(new - s) < CLOSE)
        s = choose(unconverged, choose(inside, new, (low + high) * 0.5), s)
        unconverged = unconverged & without(there)
        if not bits(unconverged):
            break
    return s


@inlined
def watch_mesh(w, m):
    """Locate simple switches of mesh m in all lanes; returns, as bits, the lanes for ``locate``.

    These are the rare ones that may dip through a border and back within the interval, or that
    start on one.
    """
    end, slope = 0.0, 0.0
    for i in range(w.x.shape[0] - 1, 0, -1):
        x = load(w.x, i, m)
        end = end + x
        slope = fma(float(i), x, slope)
    start, first = load(w.x, 0, m), load(w.x, 1, m)
    end = end + start
    b, contact = load(w.constants, BORDER, m), load(w.mesh_state, CONTACT, m)
    zero, unit = 0.0, 1.0
    is_open = contact == zero
    up = is_open & (end > zero)
    sign = choose(is_open, choose(up, zero - unit, unit), contact)
    border = choose(is_open, b, zero - b)
    begin, stop = fma(sign, start, border), fma(sign, end, border)
    plain = (begin > zero) & (stop < zero)
    seen = may_leave(begin, sign * first, stop, sign * slope)
    other = may_leave(b - sign * start, zero - sign * first, b - sign * end, zero - sign * slope)
    other = other & is_open
    plain = plain & without(other)
    at = 2.0
    if bits(plain):
        at = choose(plain, cross(w.x, m, sign, border, begin, sign * first, stop, plain), at)
    store(w.mesh_state, END, m, end)
    store(w.mesh_state, END_SLOPE, m, slope)
    store(w.mesh_state, AT, m, at)
    store(w.mesh_state, NEXT, m, choose(is_open, zero - sign, zero))
    move = load(w.progress, MOVE, 0)
    store(w.progress, MOVE, 0, choose(at < move, at, move))
    return bits(seen | other) & ~bits(plain)


@called
def locate(x, w, m, lane):
    """Locate the switch of mesh m in one lane: AT (2: none), NEXT, and MOVE if it is the first."""
    contact, b = get(w.mesh_state, CONTACT, m, lane), get(w.constants, BORDER, m, lane)
    end, slope = get(w.mesh_state, END, m, lane), get(w.mesh_state, END_SLOPE, m, lane)
    before = get(w.progress, MOVE, 0, lane)
    column = m * n_lanes(w.progress) + lane
    if contact != 0.0:
        at = leaves_at(x, column, contact * b, contact, end, slope, before)
        put(w.mesh_state, NEXT, m, lane, 0.0)
    else:
        up = leaves_at(x, column, b, -1.0, end, slope, before)
        down = leaves_at(x, column, -b, 1.0, end, slope, before)
        at = min(up, down)
        put(w.mesh_state, NEXT, m, lane, 1.0 if up < down else -1.0)
    put(w.mesh_state, AT, m, lane, at)
    if at < before:
        put(w.progress, MOVE, 0, lane, at)


@inlined
def watch_sign(w, m):
    """Locate where the force of mesh m changes its sign, in all lanes: AT_SIGN and MOVE."""
    ends(w, w.forces, m, AT_DEPTH, AT_SIGN)
    sign, zero = load(w.mesh_state, SIGN, m), 0.0
    begin, first = sign * load(w.forces, 0, m), sign * load(w.forces, 1, m)
    stop, slope = sign * load(w.mesh_state, AT_DEPTH, m), sign * load(w.mesh_state, AT_SIGN, m)
    plain = (begin > zero) & (stop < zero)
    seen = may_leave(begin, first, stop, slope)
    at = 2.0
    if bits(plain):
        at = choose(plain, cross(w.forces, m, sign, zero, begin, first, stop, plain), at)
    store(w.mesh_state, AT, m, at)
    left = bits(seen) & ~bits(plain)
    lane = 0
    while left:
        if left & 1:
            locate_sign(w, m, lane)
        left >>= 1
        lane += 1
    at, move = load(w.mesh_state, AT, m), load(w.progress, MOVE, 0)
    store(w.mesh_state, AT_SIGN, m, at)
    store(w.progress, MOVE, 0, choose(at < move, at, move))


@called
def locate_sign(w, m, lane):
    """Locate where the force of mesh m changes its sign in one lane (2: nowhere), into row AT."""
    forces = w.forces.reshape(w.forces.shape[0], w.forces.size // w.forces.shape[0])
    end, slope = get(w.mesh_state, AT_DEPTH, m, lane), get(w.mesh_state, AT_SIGN, m, lane)
    sign = get(w.mesh_state, SIGN, m, lane)
    put(
        w.mesh_state,
        AT,
        m,
        lane,
        leaves_at(forces, m * n_lanes(w.progress) + lane, 0.0, sign, end, slope, 2.0),
    )


@called
def find_next_switches(w):
    """Find the next switch of each lane; set MOVE, the fraction of its interval up to it, or 1.

    The mesh that switches, its time and next state are stored too (``locate``). A lane with more
    than ``MAX_SUBSTEPS`` moves in a step no longer stops at switches. w: ``Work``.
    """
    order, n = w.x.shape[0], w.x.shape[1]
    x = w.x.reshape(order, w.x.size // order)
    store(w.progress, MOVE, 0, 1.0)
    for r in range(w.rubs.size):
        watch_sign(w, w.rubs[r])
    for m in range(n):
        seen = watch_mesh(w, m)
        lane = 0
        while seen:
            if seen & 1:
                locate(x, w, m, lane)
            seen >>= 1
            lane += 1
    stuck = load(w.progress, SWITCHES, 0) > (MAX_SUBSTEPS - 0.5)
    store(w.progress, MOVE, 0, choose(stuck, 1.0, load(w.progress, MOVE, 0)))


@inlined
def switch_contact(unrolled, w):
    """Set the new contact of all meshes that switch at the end of their lane's move.

    Returns whether any lane's move ends at a switch.
    """
    move = load(w.progress, MOVE, 0)
    switching = move < 1.0
    if bits(switching):
        if len(unrolled[2]) > 0:
            reverse_signs(w)
        for m in range(w.x.shape[1]):
            here = (load(w.mesh_state, AT, m) == move) & switching
            old = load(w.mesh_state, CONTACT, m)
            new = choose(here, load(w.mesh_state, NEXT, m), old)
            store(w.mesh_state, CONTACT, m, new)
            if len(unrolled[2]) > 0:
                set_jump(w, m, old, new)
    return bits(switching) != 0


@inlined
def touch(unrolled, w):
    """Set the contact (Eqs. 1, 4) of the states in all lanes that begin a grid step."""
    if len(unrolled[2]) > 0:
        touch_all(unrolled, w)
        return
    sides, c = len(unrolled[0]), len(unrolled[1])
    half = sides * c
    begins = load(w.progress, SWITCHES, 0) == 0.0
    for side in range(sides):
        for k in range(c):
            a = side * c + k
            r = load(w.y, 0, sides + a)
            sun = load(w.y, 0, side) - r - load(w.error, 0, a)
            touch_mesh(w, a, sun, begins)
            touch_mesh(w, half + a, r - load(w.error, 0, half + a), begins)


@inlined
def touch_mesh(w, m, x, begins):
    """Set the contact of mesh m by its deflection x in the lanes of the mask ``begins``."""
    b = load(w.constants, BORDER, m)
    back = choose(x < 0.0 - b, -1.0, 0.0)
    contact = choose(x > b, 1.0, back)
    store(w.mesh_state, CONTACT, m, choose(begins, contact, load(w.mesh_state, CONTACT, m)))


@called
def count_contact(w):
    """Add the time of this move, in grid steps, to the contact time of each mesh (DRIVE, BACK)."""
    time = (
        load(w.progress, MOVE, 0) * load(w.progress, SHARE, 0) * (1.0 - load(w.progress, DONE, 0))
    )
    none = 0.0
    for m in range(w.x.shape[1]):
        contact = load(w.mesh_state, CONTACT, m)
        drive = choose(contact > none, time, none)
        back = choose(contact < none, time, none)
        store(w.mesh_state, DRIVE, m, load(w.mesh_state, DRIVE, m) + drive)
        store(w.mesh_state, BACK, m, load(w.mesh_state, BACK, m) + back)
