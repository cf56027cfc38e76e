"""Friction, added coordinates and damping by contact in the recurrences of the kernel.

Added coordinates (a ring or pins that move) are each on a seat: one more column like a mesh, of
constant stiffness; see ``Packed.push`` for its forces. Plain gears (``Packed.extended``) compile
without them. Arguments: see ``lanes.packed``.

Over 300 lines: what effects add to a motion is read together with what they add to tangents.
"""

from __future__ import annotations

from herringbone_sim.core.lanes.packed import (
    AT_SIGN,
    BORDER,
    CARRIER,
    CONTACT,
    DAMP,
    DAMPING,
    HALF,
    INTERVAL_CYCLES,
    JUMP,
    LEFT,
    MOVE,
    OMEGA,
    OPEN,
    PHASE,
    PITCH_SIDE,
    PITCH_START,
    PLANET,
    ROWS_OF_LAWS,
    SHARE,
    SIGN,
    STIFF,
    SUN,
    SWITCHES,
)
from herringbone_sim.core.lanes.rows import event_row
from herringbone_sim.core.lanes.vector import absolute, bits, choose, fma, load, nearest, store
from herringbone_sim.core.packed import TWO_PI, called, inlined
from herringbone_sim.core.right_hand_side import ON_EDGE


@inlined
def law_row(w):
    """Return the first row of the constants of laws."""
    return event_row(w, w.sizes[2])


@inlined
def shift_row(w, coupled, j):
    """Return the row of the displacement of the meshes by added coordinate j."""
    return law_row(w) + ROWS_OF_LAWS + (j if coupled else w.sizes[4] + j)


@inlined
def push_row(w, coupled, which, k):
    """Return the row of ``Packed.push[which, k]``."""
    part = which if coupled else 3 + which
    return law_row(w) + ROWS_OF_LAWS + 2 * w.sizes[4] + part * (w.q.shape[1] + 1) + k


@inlined
def down(a):
    """Return the floor, lane by lane."""
    whole = nearest(a)
    return choose(a < whole, whole - 1.0, whole)


@inlined
def stop_at_pitch(w):
    """End the interval of each lane at the next half mesh cycle, if that comes first.

    Nothing is done without friction in any lane; with friction in one, all lanes stop. There the
    distance from the pitch point passes zero or jumps to the next pair of teeth. Also sets
    PITCH_START, PITCH_SIDE and INTERVAL_CYCLES.
    """
    if w.rubs.size > 0:
        left = load(w.progress, LEFT, 0)
        start = load(w.progress, PHASE, 0) * (1.0 / TWO_PI)
        half = start + start
        cycles = (down(half + 2.0 * ON_EDGE) + 1.0 - half) * 0.5
        part = cycles * TWO_PI / load(w.constants, OMEGA, 0)
        near = (TWO_PI * ON_EDGE) / load(w.constants, OMEGA, 0)
        part = choose(part < left - near, part, left)
        interval_cycles = part * load(w.constants, OMEGA, 0) * (1.0 / TWO_PI)
        middle = start + interval_cycles * 0.5
        whole = down(middle + 0.5)
        store(w.progress, LEFT, 0, part)
        store(w.progress, SHARE, 0, load(w.progress, SHARE, 0) * part / left)
        store(w.progress, PITCH_START, 0, start - whole)
        store(w.progress, PITCH_SIDE, 0, choose(middle > whole, 1.0, -1.0))
        store(w.progress, INTERVAL_CYCLES, 0, interval_cycles)


@inlined
def touch_all(unrolled, w):
    """Set contact of meshes and seats, and force signs to 0 (unknown), as a grid step begins."""
    sides, c = len(unrolled[0]), len(unrolled[1])
    half = sides * c
    m = sides + half
    begins = load(w.progress, SWITCHES, 0) == 0.0
    for side in range(sides):
        for k in range(c):
            a = side * c + k
            r = load(w.y, 0, sides + a)
            store(w.x, 0, a, load(w.y, 0, side) - r - load(w.error, 0, a))
            store(w.x, 0, half + a, r - load(w.error, 0, half + a))
    for t in range(w.shifts.shape[0]):
        j, a = w.shifts[t, 0], w.shifts[t, 1]
        shift = load(w.constants, shift_row(w, True, j), a)
        store(w.x, 0, a, fma(shift, load(w.y, 0, 2 * m + j), load(w.x, 0, a)))
    for j in range(w.sizes[4]):
        store(w.x, 0, 2 * half + j, load(w.y, 0, 2 * m + j))
    for a in range(w.x.shape[1]):
        x, b = load(w.x, 0, a), load(w.constants, BORDER, a)
        back = choose(x < 0.0 - b, -1.0, 0.0)
        contact = choose(x > b, 1.0, back)
        store(w.mesh_state, CONTACT, a, choose(begins, contact, load(w.mesh_state, CONTACT, a)))
        store(w.mesh_state, SIGN, a, choose(begins, 0.0, load(w.mesh_state, SIGN, a)))


@inlined
def set_damping(w):
    """Set DAMP: the damping of meshes and seats in their present contact."""
    for a in range(w.x.shape[1]):
        separated = load(w.mesh_state, CONTACT, a) == 0.0
        c = load(w.constants, DAMPING, a)
        store(w.mesh_state, DAMP, a, choose(separated, load(w.constants, law_row(w) + OPEN, a), c))


@inlined
def shift_series(w, i, rate, coupled):
    """Add the displacements by added coordinates to order i of deflections and their rates.

    Those of seats are set.
    """
    first, n = w.q.shape[1] - w.sizes[4], w.k.shape[1]
    for t in range(w.shifts.shape[0]):
        j, a = w.shifts[t, 0], w.shifts[t, 1]
        shift = load(w.constants, shift_row(w, coupled, j), a)
        store(w.x, i, a, fma(shift, load(w.q, i, first + j), load(w.x, i, a)))
        store(rate, i, a, fma(shift, load(w.v, i, first + j), load(rate, i, a)))
    for j in range(w.sizes[4]):
        store(w.x, i, n + j, load(w.q, i, first + j))
        store(rate, i, n + j, load(w.v, i, first + j))


@inlined
def shift_forces(w, i, forced, coupled):
    """Add the displacements by added coordinates to order i of deflections, f, damping forces.

    Deflections and forces of seats are set.
    """
    first, n = w.q.shape[1] - w.sizes[4], w.k.shape[1]
    for t in range(w.shifts.shape[0]):
        j, a = w.shifts[t, 0], w.shifts[t, 1]
        shift = load(w.constants, shift_row(w, coupled, j), a)
        x, v = shift * load(w.q, i, first + j), shift * load(w.v, i, first + j)
        if forced:
            store(w.x, i, a, load(w.x, i, a) + x)
        store(w.f, i, a, fma(absolute(load(w.mesh_state, CONTACT, a)), x, load(w.f, i, a)))
        store(w.force, 0, a, fma(load(w.mesh_state, DAMP, a), v, load(w.force, 0, a)))
    for j in range(w.sizes[4]):
        a = n + j
        x, contact = load(w.q, i, first + j), load(w.mesh_state, CONTACT, a)
        if forced:
            store(w.x, i, a, x)
        f = absolute(contact) * x
        if forced and i == 0:
            f = f - contact * load(w.constants, law_row(w) + HALF, a)
        damper = load(w.v, i, first + j) * load(w.mesh_state, DAMP, a)
        store(w.force, 0, a, fma(load(w.constants, law_row(w) + STIFF, a), f, damper))


@inlined
def keep_forces(w, i, forced, coupled):
    """Store order i of the forces in ``w.forces``; write their ``Packed.push`` into ``w.push``."""
    if w.pairs.shape[0] > 0:
        for a in range(w.x.shape[1]):
            store(w.forces, i, a, load(w.force, 0, a))
        if i == 0 and forced:
            know_signs(w)
        push_pairs(w, i, coupled)


@inlined
def know_signs(w):
    """Set unknown signs of forces with friction, and ``w.mix``: accelerations by unit forces."""
    n, t_all = w.k.shape[1], w.pairs.shape[0]
    for r in range(w.rubs.size):
        a = w.rubs[r]
        sign = load(w.mesh_state, SIGN, a)
        first = choose(load(w.forces, 0, a) < 0.0, -1.0, 1.0)
        store(w.mesh_state, SIGN, a, choose(sign == 0.0, first, sign))
    start, side = load(w.progress, PITCH_START, 0), load(w.progress, PITCH_SIDE, 0)
    interval_cycles = load(w.progress, INTERVAL_CYCLES, 0)
    for apart in range(2 if w.y.shape[0] > 2 else 1):
        coupled = apart == 0
        for t in range(t_all):
            k, a = w.pairs[t, 0], w.pairs[t, 1]
            now = load(w.constants, push_row(w, coupled, 0, k), a)
            later = 0.0
            if a < n and w.rubs.size > 0:
                g = side * load(w.mesh_state, SIGN, a)
                lever = load(w.constants, push_row(w, coupled, 2, k), a)
                rub = fma(start, lever, load(w.constants, push_row(w, coupled, 1, k), a))
                now = fma(g, rub, now)
                later = g * interval_cycles * lever
            store(w.mix, 2 * apart * t_all + t, 0, now)
            store(w.mix, (2 * apart + 1) * t_all + t, 0, later)


@inlined
def push_pairs(w, i, coupled):
    """Write order i of the accelerations by ``Packed.push`` into ``w.push``."""
    t_all = w.pairs.shape[0]
    first = 0 if coupled else 2 * t_all
    t = 0
    while t < t_all:
        k = w.pairs[t, 0]
        total = 0.0
        while t < t_all and w.pairs[t, 0] == k:
            a = w.pairs[t, 1]
            total = fma(load(w.mix, first + t, 0), load(w.forces, i, a), total)
            if i > 0 and w.rubs.size > 0:
                total = fma(load(w.mix, first + t_all + t, 0), load(w.forces, i - 1, a), total)
            t += 1
        store(w.push, 0, k, total)


@inlined
def reverse_signs(w):
    """Reverse the signs of the forces that change sign at the end of their lane's move."""
    move = load(w.progress, MOVE, 0)
    for r in range(w.rubs.size):
        a = w.rubs[r]
        sign = load(w.mesh_state, SIGN, a)
        here = (load(w.mesh_state, AT_SIGN, a) == move) & (move < 1.0)
        store(w.mesh_state, SIGN, a, choose(here, 0.0 - sign, sign))


@inlined
def set_jump(w, a, old, new):
    """Set JUMP, the jump of a force at a change of contact over the rate of x, and its SIGN."""
    share = load(w.constants, DAMPING, a) - load(w.constants, law_row(w) + OPEN, a)
    jump = share * (absolute(new) - absolute(old))
    store(w.mesh_state, JUMP, a, jump)
    store(w.mesh_state, SIGN, a, choose(jump != 0.0, new - old, load(w.mesh_state, SIGN, a)))


@called
def jump_tangents(unrolled, w):
    """Apply the saltation matrix to tangent vectors where a mesh force jumps at a move's end."""
    for row in range(1, w.y.shape[0]):
        jump_rows(unrolled, w, w.y, row, row == 1 or len(unrolled[0]) == 2, None)


@inlined
def jump_rows(unrolled, w, y, row, coupled, border_shift):
    """Apply the saltation matrix to row ``row`` of y: a neighbour jumps at another time.

    Args:
        border_shift: None, or (rows, n_mesh) by how much a parameter moves the border of the jump.
    """
    sides, c, s = len(unrolled[0]), len(unrolled[1]), w.sizes[4]
    half = sides * c
    m = sides + half
    pitch_cycles = fma(
        load(w.progress, MOVE, 0),
        load(w.progress, INTERVAL_CYCLES, 0),
        load(w.progress, PITCH_START, 0),
    )
    for a in range(2 * half):
        jump = load(w.mesh_state, JUMP, a)
        if not bits(jump != 0.0):
            continue
        planet = a % half
        x = load(y, row, sides + planet)
        if a < half:
            x = load(y, row, planet // c) - x
        for t in range(w.shifts.shape[0]):
            if w.shifts[t, 1] == a:
                j = w.shifts[t, 0]
                shift = load(w.constants, shift_row(w, coupled, j), a)
                x = fma(shift, load(y, row, 2 * m + j), x)
        if border_shift is not None:
            x = x - load(border_shift, row, a)
        force = jump * x
        for k in range(m + s + 1):
            store(w.push, 0, k, 0.0)
        g = load(w.progress, PITCH_SIDE, 0) * load(w.mesh_state, SIGN, a)
        for t in range(w.pairs.shape[0]):
            if w.pairs[t, 1] == a:
                k = w.pairs[t, 0]
                lever = load(w.constants, push_row(w, coupled, 2, k), a)
                rub = fma(pitch_cycles, lever, load(w.constants, push_row(w, coupled, 1, k), a))
                share = fma(g, rub, load(w.constants, push_row(w, coupled, 0, k), a))
                store(w.push, 0, k, share * force)
        own = force * load(w.constants, PLANET, planet)
        carrier = load(w.push, 0, m + s)
        if coupled:
            carrier = carrier + force * load(w.constants, CARRIER, 0)
        if a < half:
            side = planet // c
            sun = force * load(w.constants, SUN, side)
            store(w.push, 0, side, load(w.push, 0, side) - sun)
        else:
            own = 0.0 - own
        store(w.push, 0, sides + planet, load(w.push, 0, sides + planet) + own)
        for k in range(m + s):
            added = load(w.push, 0, k)
            if k < m:
                added = added - (carrier + carrier if k < sides else carrier)
            at = m + k if k < m else m + s + k
            store(y, row, at, load(y, row, at) + added)
        for k in range(m + s + 1):
            store(w.push, 0, k, 0.0)


@inlined
def ends(w, series, a, end_row, slope_row):
    """Write value and slope of column a of a series at the interval's end to ``w.mesh_state``."""
    end, slope = 0.0, 0.0
    for i in range(series.shape[0] - 1, 0, -1):
        x = load(series, i, a)
        end = end + x
        slope = fma(float(i), x, slope)
    store(w.mesh_state, end_row, a, end + load(series, 0, a))
    store(w.mesh_state, slope_row, a, slope)
