"""Taylor series of gears that are not plain, in all lanes: ``core.any_motion``, lanes at once."""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.any_motion import NEAR, TAIL
from herringbone_sim.core.lanes.packed import (
    BORDER,
    CARRIER,
    CONTACT,
    DAMPING,
    DASHPOT,
    DEEP,
    DEPTH,
    EXPONENT,
    HALF_PLAY,
    LEFT,
    LOAD_Q,
    LOAD_R,
    MOVE,
    OTHER,
    PLANET,
    POWER,
    ROUNDING,
    ROWS_OF_LAWS,
    SHARE,
    SIGN,
    STIFF,
    SUN,
    SWITCHES,
)
from herringbone_sim.core.lanes.series import window_row
from herringbone_sim.core.lanes.vector import (
    LANES,
    absolute,
    bits,
    choose,
    fma,
    load,
    splat,
    store,
)
from herringbone_sim.core.packed import compiled, inlined

LINEAR, LINEAR_DAMPER, STRENGTH, BENT_SHARE = range(4)
START, SIDE, TURN = range(3)


@inlined
def law_row(w):
    """First row of the constants of laws."""
    return window_row(w, w.shape[2])


@inlined
def coordinate_row(w, which, k):
    """Row of slide (0, 1), own_force (2) or own_hold (3) of coordinate k."""
    return law_row(w) + ROWS_OF_LAWS + w.shape[4] + which * w.q.shape[1] + k


@inlined
def shift_row(w, j):
    """Row of the displacement of the meshes by further coordinate j."""
    return law_row(w) + ROWS_OF_LAWS + j


@compiled
def power_of(w, out, i, a, row):
    """Order i of the power of ``depth`` whose exponent is a constant of mesh a."""
    depth = w.own.depth
    if i == 0:
        for lane in range(LANES):
            out[0, a, lane] = depth[0, a, lane] ** w.constants[row, a, lane]
        return
    exponent = load(w.constants, row, a)
    total = splat(0.0)
    for j in range(1, i + 1):
        factor = fma(exponent, splat(float(j)), splat(float(j - i)))
        total = fma(factor * load(depth, j, a), load(out, i - j, a), total)
    store(out, i, a, total / (load(depth, 0, a) * float(i)))


@compiled
def set_factors(w):
    """Factors on f and c v of every mesh, from its contact; see ``any_motion.linear_law``."""
    row = law_row(w)
    for a in range(w.k.shape[1]):
        for lane in range(LANES):
            reference, exponent = w.constants[row, a, lane], w.constants[row + EXPONENT, a, lane]
            share, power = w.constants[row + OTHER, a, lane], w.constants[row + POWER, a, lane]
            spring, damper, strength, bent = 1.0, 1.0, 1.0, 0.0
            if exponent != 1.0:
                spring = 2.0 / (exponent + 1.0) * (NEAR / reference) ** (exponent - 1.0)
                strength = reference ** (1.0 - exponent)
            if share != 0.0:
                closed = abs(w.mesh[CONTACT, a, lane])
                depth = w.constants[row + DEPTH, a, lane]
                damper += share * (closed * (NEAR / depth) ** power / (power + 1.0) - 1.0)
                bent = share * depth**-power
            w.own.factor[LINEAR, a, lane] = spring
            w.own.factor[LINEAR_DAMPER, a, lane] = damper
            w.own.factor[STRENGTH, a, lane] = strength
            w.own.factor[BENT_SHARE, a, lane] = bent


@compiled
def mesh_force(w, i, a):
    """Order i of the force of mesh a from its deflection up to that order."""
    o, row = w.own, law_row(w)
    contact = load(w.mesh, CONTACT, a)
    deep = load(w.mesh, DEEP, a) != splat(0.0)
    f = absolute(contact) * load(w.x, i, a)
    rest = splat(0.0)
    damper = splat(0.0)
    unit = splat(0.0)
    if i == 0:
        f = f - contact * load(w.constants, BORDER, a)
        rest = 1.0 - load(w.constants, row + OTHER, a)
        damper = load(o.factor, LINEAR_DAMPER, a)
        unit = splat(1.0)
    spring = load(o.factor, LINEAR, a) * f
    if bits(deep):
        store(o.depth, i, a, choose(deep, contact * f, unit))
        power_of(w, o.spring_power, i, a, row + EXPONENT)
        power_of(w, o.damper_power, i, a, row + POWER)
        bent = contact * load(o.factor, STRENGTH, a) * load(o.spring_power, i, a)
        spring = choose(deep, bent, spring)
        share = load(o.factor, BENT_SHARE, a)
        damper = choose(deep, fma(share, load(o.damper_power, i, a), rest), damper)
    store(o.spring, i, a, spring)
    store(o.damper, i, a, damper)
    total = splat(0.0)
    slow = splat(0.0)
    for j in range(i + 1):
        total = fma(load(w.k, j, a), load(o.spring, i - j, a), total)
        slow = fma(load(o.damper, j, a), load(o.rate, i - j, a), slow)
    store(o.force, i, a, fma(load(w.constants, DAMPING, a), slow, total))


@compiled
def logarithms(w, which, j, sign):
    """Order 0 of a corner of the play of coordinate j, with rows as ``any_motion.corner``."""
    row, p = law_row(w), w.q.shape[0]
    k = w.q.shape[1] - w.shape[4] + j
    g = w.own.corner
    for lane in range(LANES):
        width = w.constants[row + ROUNDING, j, lane]
        if width == 0.0:
            width = 1.0
        u = (sign * w.q[0, k, lane] - w.constants[row + HALF_PLAY, j, lane]) / width
        e = np.exp(-abs(u))
        logistic = 1.0 / (1.0 + e) if u > 0.0 else e / (1.0 + e)
        g[which * p, j, lane] = logistic
        g[(which + 1) * p, j, lane] = logistic - logistic * logistic
        g[(which + 2) * p, j, lane] = max(u, 0.0) + np.log1p(e)


@compiled
def corner(w, which, i, j, sign):
    """Order i of a corner, see ``logarithms``."""
    if i == 0:
        logarithms(w, which, j, sign)
        return
    p, g = w.q.shape[0], w.own.corner
    k = w.q.shape[1] - w.shape[4] + j
    width = load(w.constants, law_row(w) + ROUNDING, j)
    per_width = splat(sign) / choose(width == splat(0.0), splat(1.0), width)
    logistic, rise = splat(0.0), splat(0.0)
    for r in range(1, i + 1):
        du = load(w.q, r, k) * per_width * float(r)
        logistic = fma(du, load(g, (which + 1) * p + i - r, j), logistic)
        rise = fma(du, load(g, which * p + i - r, j), rise)
    store(g, which * p + i, j, logistic / splat(float(i)))
    store(g, (which + 2) * p + i, j, rise / splat(float(i)))
    slope = load(g, which * p + i, j)
    for r in range(i + 1):
        slope = slope - load(g, which * p + r, j) * load(g, which * p + i - r, j)
    store(g, (which + 1) * p + i, j, slope)


@compiled
def hold_force(w, i, j):
    """Order i of the force of the spring of further coordinate j."""
    row, p, g = law_row(w), w.q.shape[0], w.own.corner
    k = w.q.shape[1] - w.shape[4] + j
    width = load(w.constants, row + ROUNDING, j)
    straight = width == splat(0.0)
    play = load(w.q, i, k)
    if bits(straight) != (1 << LANES) - 1:
        corner(w, 0, i, j, 1.0)
        corner(w, 3, i, j, -1.0)
        play = choose(straight, play, width * (load(g, 2 * p + i, j) - load(g, 5 * p + i, j)))
    dashpot = load(w.constants, row + DASHPOT, j) * load(w.v, i, k)
    store(w.own.hold, i, j, fma(load(w.constants, row + STIFF, j), play, dashpot))


@compiled
def deflect(shape, w, i, forced):
    """Order i of the deflections and of their rates."""
    sides, c = len(shape[0]), len(shape[1])
    half = sides * c
    rate = splat(float(i + 1)) / load(w.lane, LEFT, 0)
    for side in range(sides):
        for k in range(c):
            a = side * c + k
            r, dr = load(w.q, i, sides + a), load(w.v, i, sides + a)
            x, v = load(w.q, i, side) - r, load(w.v, i, side) - dr
            if forced:
                x = x - load(w.error, i, a)
                r = r - load(w.error, i, half + a)
                if i + 1 < w.error.shape[0]:
                    v = v - rate * load(w.error, i + 1, a)
                    dr = dr - rate * load(w.error, i + 1, half + a)
            store(w.x, i, a, x)
            store(w.x, i, half + a, r)
            store(w.own.rate, i, a, v)
            store(w.own.rate, i, half + a, dr)
    first = w.q.shape[1] - w.shape[4]
    for j in range(w.shape[4]):
        for a in range(2 * half):
            shift = load(w.constants, shift_row(w, j), a)
            store(w.x, i, a, fma(shift, load(w.q, i, first + j), load(w.x, i, a)))
            store(w.own.rate, i, a, fma(shift, load(w.v, i, first + j), load(w.own.rate, i, a)))


@compiled
def push(shape, w, i, force, hold, forced, coupled, controlled, inverse):
    """Order i + 1 of the motion from order i of all forces."""
    sides, c = len(shape[0]), len(shape[1])
    half = sides * c
    m = sides + half
    scale = load(w.lane, LEFT, 0) * splat(inverse[i + 1])
    carrier = splat(0.0)
    if coupled:
        for a in range(2 * half):
            carrier = carrier + load(force, i, a)
        carrier = carrier * load(w.constants, CARRIER, 0)
    for side in range(sides):
        sun = splat(0.0)
        for k in range(c):
            a = side * c + k
            sun = sun + load(force, i, a)
            difference = load(force, i, a) - load(force, i, half + a)
            r = fma(difference, load(w.constants, PLANET, a), 0.0 - carrier)
            if forced and i == 0:
                r = r + load(w.constants, LOAD_R, 0)
            store(w.own.push, 0, sides + a, r)
        q = 0.0 - (load(w.constants, SUN, side) * sun + carrier * 2.0)
        if forced and i == 0:
            q = q + load(w.constants, LOAD_Q, side)
        store(w.own.push, 0, side, q)
    for k in range(m, w.q.shape[1]):
        store(w.own.push, 0, k, splat(0.0))
    if w.shape[4] > 0:
        for k in range(w.q.shape[1]):
            total = load(w.own.push, 0, k)
            for a in range(2 * half):
                total = total - load(w.constants, coordinate_row(w, 2, k), a) * load(force, i, a)
            for j in range(w.shape[4]):
                total = total - load(w.constants, coordinate_row(w, 3, k), j) * load(hold, i, j)
            store(w.own.push, 0, k, total)
    if w.shape[5] > 0:
        rub(w, i, force, coupled)
    for k in range(w.q.shape[1]):
        acceleration = load(w.own.push, 0, k)
        if forced and controlled:
            acceleration = acceleration - load(w.load, i, k)
        store(w.v, i + 1, k, acceleration * scale)
        store(w.q, i + 1, k, load(w.v, i, k) * scale)


@compiled
def rub(w, i, force, coupled):
    """Add order i of the accelerations by friction."""
    start, turn = load(w.own.turn, START, 0), load(w.own.turn, TURN, 0)
    for a in range(w.k.shape[1]):
        g = load(w.own.turn, SIDE, 0) * load(w.mesh, SIGN, a)
        first = g * load(force, i, a)
        lever = start * first
        if i > 0:
            lever = fma(turn * g, load(force, i - 1, a), lever)
        for k in range(w.q.shape[1]):
            total = load(w.own.push, 0, k)
            total = fma(load(w.constants, coordinate_row(w, 0, k), a), first, total)
            total = fma(load(w.constants, coordinate_row(w, 1, k), a), lever, total)
            store(w.own.push, 0, k, total)


@inlined
def begin_series(w, row):
    """Order 0 of all coordinates from the state or a tangent vector."""
    s = w.shape[4]
    m = w.q.shape[1] - s
    for k in range(m):
        store(w.q, 0, k, load(w.y, row, k))
        store(w.v, 0, k, load(w.y, row, m + k))
    for j in range(s):
        store(w.q, 0, m + j, load(w.y, row, 2 * m + j))
        store(w.v, 0, m + j, load(w.y, row, 2 * m + s + j))


@compiled
def expand_any_motion(shape, w, controlled, inverse):
    """Series of the state over what is left of each lane's step."""
    last = w.k.shape[0] - 1
    begin_series(w, 0)
    set_factors(w)
    for i in range(last):
        deflect(shape, w, i, True)
        for a in range(w.k.shape[1]):
            mesh_force(w, i, a)
        for j in range(w.shape[4]):
            hold_force(w, i, j)
        if i == 0 and w.shape[5] > 0:
            set_signs(w)
        push(shape, w, i, w.own.force, w.own.hold, True, True, controlled, inverse)
    deflect(shape, w, last, True)
    for a in range(w.k.shape[1]):
        store(w.own.rate, last, a, splat(0.0))
        store(w.own.force, last, a, splat(0.0))


@inlined
def set_signs(w):
    """Sign of the forces in the lanes that begin a step of the grid."""
    for a in range(w.k.shape[1]):
        down = load(w.own.force, 0, a) < splat(0.0)
        now = choose(down, splat(-1.0), splat(1.0))
        begins = load(w.lane, SWITCHES, 0) == splat(0.0)
        store(w.mesh, SIGN, a, choose(begins, now, load(w.mesh, SIGN, a)))


@compiled
def expand_derivatives(w):
    """Series of the derivatives of all forces by deflections and rates, for tangent vectors."""
    o, row = w.own, law_row(w)
    last = w.k.shape[0] - 1
    for a in range(w.k.shape[1]):
        contact = load(w.mesh, CONTACT, a)
        deep = load(w.mesh, DEEP, a) != splat(0.0)
        some = bits(deep) != 0
        c = load(w.constants, DAMPING, a)
        straight = absolute(contact) * load(o.factor, LINEAR, a)
        share = c * load(o.factor, BENT_SHARE, a)
        exponent, power = load(w.constants, row + EXPONENT, a), load(w.constants, row + POWER, a)
        strength = exponent * load(o.factor, STRENGTH, a)
        for i in range(last + 1):
            damp = splat(0.0)
            soft = straight * load(w.k, i, a)
            if i == 0:
                damp = c * load(o.factor, LINEAR_DAMPER, a)
            if some:
                # powers less one, by division of the series by |f|
                less = quotient(o, o.spring_power, i, a)
                store(o.other, i, a, less)
                bent = splat(0.0)
                for j in range(i + 1):
                    bent = fma(load(w.k, j, a), load(o.other, i - j, a), bent)
                soft = choose(deep, strength * bent, soft)
                rest = c * (1.0 - load(w.constants, row + OTHER, a)) if i == 0 else splat(0.0)
                damp = choose(deep, fma(share, load(o.damper_power, i, a), rest), damp)
            store(o.soft, i, a, soft)
            store(o.damp, i, a, damp)
        if some:
            for i in range(last + 1):
                less = quotient(o, o.damper_power, i, a)
                store(o.other, i, a, less)
                more = splat(0.0)
                for j in range(i + 1):
                    more = fma(load(o.rate, j, a), load(o.other, i - j, a), more)
                more = choose(deep, contact * share * power * more, splat(0.0))
                store(o.soft, i, a, load(o.soft, i, a) + more)
    p, g = w.q.shape[0], o.corner
    for j in range(w.shape[4]):
        width, stiff = load(w.constants, row + ROUNDING, j), load(w.constants, row + STIFF, j)
        straight = width == splat(0.0)
        for i in range(last + 1):
            give = stiff if i == 0 else splat(0.0)
            if bits(straight) != (1 << LANES) - 1:
                give = choose(straight, give, stiff * (load(g, i, j) + load(g, 3 * p + i, j)))
            store(o.give, i, j, give)


@inlined
def quotient(o, series, i, a):
    """Order i of a series over ``depth``, lower orders of which are in ``other``."""
    total = load(series, i, a)
    for j in range(1, i + 1):
        total = total - load(o.depth, j, a) * load(o.other, i - j, a)
    return total / load(o.depth, 0, a)


@compiled
def expand_any_tangent(shape, w, row, coupled, inverse):
    """Series of a tangent vector over the step of ``expand_derivatives``."""
    o, last = w.own, w.k.shape[0] - 1
    begin_series(w, row)
    for i in range(last):
        deflect(shape, w, i, False)
        for a in range(w.k.shape[1]):
            total = splat(0.0)
            for j in range(i + 1):
                total = fma(load(o.soft, j, a), load(w.x, i - j, a), total)
                total = fma(load(o.damp, j, a), load(o.rate, i - j, a), total)
            store(o.other, i, a, total)
        first = w.q.shape[1] - w.shape[4]
        for j in range(w.shape[4]):
            dashpot = load(w.constants, law_row(w) + DASHPOT, j)
            total = dashpot * load(w.v, i, first + j)
            for r in range(i + 1):
                total = fma(load(o.give, r, j), load(w.q, i - r, first + j), total)
            store(o.other_hold, i, j, total)
        push(shape, w, i, o.other, o.other_hold, False, coupled, False, inverse)


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


@compiled
def shorten(w):
    """Rewrite all series for the part of each lane's step over which they hold."""
    o, last = w.own, w.q.shape[0] - 1
    end, before = splat(0.0), splat(0.0)
    for k in range(w.q.shape[1]):
        end = most(most(end, absolute(load(w.v, last, k))), absolute(load(w.q, last, k)))
        before = most(before, absolute(load(w.v, last - 1, k)))
        before = most(before, absolute(load(w.q, last - 1, k)))
    if not bits((end > splat(TAIL)) | (before > splat(TAIL))):
        return
    store(w.scale, 0, 0, end)
    store(w.scale, 1, 0, before)
    for lane in range(LANES):
        share = 1.0
        if w.scale[0, 0, lane] > TAIL:
            share = min(share, (TAIL / w.scale[0, 0, lane]) ** (1.0 / last))
        if w.scale[1, 0, lane] > TAIL:
            share = min(share, (TAIL / w.scale[1, 0, lane]) ** (1.0 / (last - 1)))
        w.scale[2, 0, lane] = share
    share = load(w.scale, 2, 0)
    scale = splat(1.0)
    for i in range(w.q.shape[0]):
        for k in range(w.q.shape[1]):
            store(w.q, i, k, load(w.q, i, k) * scale)
            store(w.v, i, k, load(w.v, i, k) * scale)
        for a in range(w.k.shape[1]):
            store(w.k, i, a, load(w.k, i, a) * scale)
            store(w.x, i, a, load(w.x, i, a) * scale)
            store(o.rate, i, a, load(o.rate, i, a) * scale)
            store(o.depth, i, a, load(o.depth, i, a) * scale)
            store(o.spring_power, i, a, load(o.spring_power, i, a) * scale)
            store(o.damper_power, i, a, load(o.damper_power, i, a) * scale)
            store(o.force, i, a, load(o.force, i, a) * scale)
        for j in range(w.shape[4]):
            for which in range(6):
                row = which * w.q.shape[0] + i
                store(o.corner, row, j, load(o.corner, row, j) * scale)
        scale = scale * share
    store(w.lane, LEFT, 0, load(w.lane, LEFT, 0) * share)
    store(w.lane, SHARE, 0, load(w.lane, SHARE, 0) * share)
    store(o.turn, TURN, 0, load(o.turn, TURN, 0) * share)


@inlined
def most(a, b):
    """The larger one, lane by lane."""
    return choose(a < b, b, a)
