"""Taylor series of a motion whose forces are not linear between switches.

A gear with ``powers`` has force laws with powers of |f|, or seats with rounded corners, see
``Packed``. The recurrences are those of ``series`` with the products and powers of series that
such laws ask for (Jorba and Zou, Exp. Math. 14, 99, 2005); how far the series hold is read off
their last terms.

Over 300 lines: the series of the forces, of a motion and of its tangents are one recurrence.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.lanes.extended import know_signs, law_row, push_pairs, shift_series
from herringbone_sim.core.lanes.packed import (
    BORDER,
    CONTACT,
    DAMPING,
    DEEP,
    DEPTH,
    EXPONENT,
    HALF,
    LEFT,
    OTHER,
    POWER,
    ROUNDING,
    SHARE,
    STIFF,
    TURN,
)
from herringbone_sim.core.lanes.series import accelerate, begin_series
from herringbone_sim.core.lanes.vector import (
    absolute,
    bits,
    choose,
    fma,
    get,
    load,
    n_lanes,
    put,
    store,
    without,
)
from herringbone_sim.core.packed import called, inlined

# Where |f| is below this, in b_c (10 nm for b_c = 10 um), a law with a power of |f| is taken
# linear, of the same work: a power has no series at 0.
NEAR = 1e-3
TAIL = 1e-10  # of the last two terms of a series that still holds, b_c and b_c omega_n
LINEAR, LINEAR_DAMPER, STRENGTH, BENT_SHARE = range(4)


@inlined
def power_of(w, out, i, a, row):
    """Order i of the power of ``depth`` whose exponent is a constant of mesh a."""
    depth = w.own.depth
    if i == 0:
        for lane in range(n_lanes(w.lane)):
            put(out, 0, a, lane, get(depth, 0, a, lane) ** get(w.constants, row, a, lane))
        return
    exponent = load(w.constants, row, a)
    total = 0.0
    for j in range(1, i + 1):
        factor = fma(exponent, float(j), float(j - i))
        total = fma(factor * load(depth, j, a), load(out, i - j, a), total)
    store(out, i, a, total / (load(depth, 0, a) * float(i)))


@called
def set_factors(w):
    """Factors on f and c v of every mesh, from its contact.

    Where the law is taken linear, they are of the same work up to ``NEAR``.
    """
    row = law_row(w)
    for a in range(w.k.shape[1]):
        for lane in range(n_lanes(w.lane)):
            reference, exponent = (
                get(w.constants, row, a, lane),
                get(w.constants, row + EXPONENT, a, lane),
            )
            share, power = (
                get(w.constants, row + OTHER, a, lane),
                get(w.constants, row + POWER, a, lane),
            )
            spring, damper, strength, bent = 1.0, 1.0, 1.0, 0.0
            if exponent != 1.0:
                spring = 2.0 / (exponent + 1.0) * (NEAR / reference) ** (exponent - 1.0)
                strength = reference ** (1.0 - exponent)
            if share != 0.0:
                closed = abs(get(w.mesh, CONTACT, a, lane))
                depth = get(w.constants, row + DEPTH, a, lane)
                damper += share * (closed * (NEAR / depth) ** power / (power + 1.0) - 1.0)
                bent = share * depth**-power
            put(w.own.factor, LINEAR, a, lane, spring)
            put(w.own.factor, LINEAR_DAMPER, a, lane, damper)
            put(w.own.factor, STRENGTH, a, lane, strength)
            put(w.own.factor, BENT_SHARE, a, lane, bent)


@inlined
def bends_spring(w, a):
    """Whether the spring of mesh a follows a power in any lane."""
    return bits(load(w.constants, law_row(w) + EXPONENT, a) != 1.0) != 0


@inlined
def bends_damper(w, a):
    """Whether the damping of mesh a follows another law in any lane."""
    return bits(load(w.constants, law_row(w) + OTHER, a) != 0.0) != 0


@inlined
def mesh_force(w, i, a):
    """Order i of the force of mesh a from its deflection up to that order."""
    o, row = w.own, law_row(w)
    contact = load(w.mesh, CONTACT, a)
    deep = load(w.mesh, DEEP, a) != 0.0
    f = absolute(contact) * load(w.x, i, a)
    rest = 0.0
    damper = 0.0
    unit = 0.0
    if i == 0:
        f = f - contact * load(w.constants, BORDER, a)
        rest = 1.0 - load(w.constants, row + OTHER, a)
        damper = load(o.factor, LINEAR_DAMPER, a)
        unit = 1.0
    spring = load(o.factor, LINEAR, a) * f
    store(o.depth, i, a, choose(deep, contact * f, unit))
    if bits(deep) and bends_spring(w, a):
        power_of(w, o.spring_power, i, a, row + EXPONENT)
        bent = contact * load(o.factor, STRENGTH, a) * load(o.spring_power, i, a)
        spring = choose(deep, bent, spring)
    if bits(deep) and bends_damper(w, a):
        power_of(w, o.damper_power, i, a, row + POWER)
        share = load(o.factor, BENT_SHARE, a)
        damper = choose(deep, fma(share, load(o.damper_power, i, a), rest), damper)
    store(o.spring, i, a, spring)
    store(o.damper, i, a, damper)
    total = 0.0
    slow = load(o.damper, 0, a) * load(o.rate, i, a)
    for j in range(i + 1):
        total = fma(load(w.k, j, a), load(o.spring, i - j, a), total)
    if bends_damper(w, a):
        for j in range(1, i + 1):
            slow = fma(load(o.damper, j, a), load(o.rate, i - j, a), slow)
    store(w.forces, i, a, fma(load(w.constants, DAMPING, a), slow, total))


@called
def logarithms(w, which, a, sign):
    """Order 0 of a corner of the play of the seat in column a.

    Three blocks of rows of ``corner`` from ``which`` on: the logistic function of
    u = (sign x - half play) / rounding, its slope by itself, and ln(1 + e^u).
    """
    row, p, j = law_row(w), w.q.shape[0], a - w.k.shape[1]
    g = w.own.corner
    for lane in range(n_lanes(w.lane)):
        width = get(w.constants, row + ROUNDING, a, lane)
        if width == 0.0:
            width = 1.0
        u = (sign * get(w.x, 0, a, lane) - get(w.constants, row + HALF, a, lane)) / width
        e = np.exp(-abs(u))
        logistic = 1.0 / (1.0 + e) if u > 0.0 else e / (1.0 + e)
        put(g, which * p, j, lane, logistic)
        put(g, (which + 1) * p, j, lane, logistic - logistic * logistic)
        put(g, (which + 2) * p, j, lane, max(u, 0.0) + np.log1p(e))


@called
def corner(w, which, i, a, sign):
    """Order i of a corner, see ``logarithms``."""
    if i == 0:
        logarithms(w, which, a, sign)
        return
    p, g, j = w.q.shape[0], w.own.corner, a - w.k.shape[1]
    width = load(w.constants, law_row(w) + ROUNDING, a)
    per_width = sign / choose(width == 0.0, 1.0, width)
    logistic, rise = 0.0, 0.0
    for r in range(1, i + 1):
        du = load(w.x, r, a) * per_width * float(r)
        logistic = fma(du, load(g, (which + 1) * p + i - r, j), logistic)
        rise = fma(du, load(g, which * p + i - r, j), rise)
    store(g, which * p + i, j, logistic / float(i))
    store(g, (which + 2) * p + i, j, rise / float(i))
    slope = load(g, which * p + i, j)
    for r in range(i + 1):
        slope = slope - load(g, which * p + r, j) * load(g, which * p + i - r, j)
    store(g, (which + 1) * p + i, j, slope)


@inlined
def hold_force(w, i, a):
    """Order i of the force of the seat in column a."""
    row, p, g, j = law_row(w), w.q.shape[0], w.own.corner, a - w.k.shape[1]
    contact = load(w.mesh, CONTACT, a)
    play = absolute(contact) * load(w.x, i, a)
    if i == 0:
        play = play - contact * load(w.constants, row + HALF, a)
    width = load(w.constants, row + ROUNDING, a)
    straight = width == 0.0
    if bits(without(straight)):
        corner(w, 0, i, a, 1.0)
        corner(w, 3, i, a, -1.0)
        play = choose(straight, play, width * (load(g, 2 * p + i, j) - load(g, 5 * p + i, j)))
    dashpot = load(w.constants, DAMPING, a) * load(w.own.rate, i, a)
    store(w.forces, i, a, fma(load(w.constants, row + STIFF, a), play, dashpot))


@inlined
def deflect(shape, w, i, forced, coupled):
    """Order i of the deflections and of their rates."""
    sides, c = len(shape[0]), len(shape[1])
    half = sides * c
    rate = float(i + 1) / load(w.lane, LEFT, 0)
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
    shift_series(w, i, w.own.rate, coupled)


@inlined
def push(shape, w, i, forced, coupled, controlled, inverse):
    """Order i + 1 of the motion from order i of all forces."""
    for a in range(w.k.shape[1]):
        store(w.force, 0, a, load(w.forces, i, a))
    if forced and i == 0:
        know_signs(w)
    push_pairs(w, i, coupled)
    scale = load(w.lane, LEFT, 0) * inverse[i + 1]
    accelerate(shape, w, i, forced, coupled, controlled, scale)


@called
def expand_any_motion(shape, w, controlled, inverse):
    """Series of the state over what is left of each lane's step."""
    last = w.k.shape[0] - 1
    begin_series(shape, w, 0)
    set_factors(w)
    for i in range(last):
        deflect(shape, w, i, True, True)
        for a in range(w.k.shape[1]):
            mesh_force(w, i, a)
        for a in range(w.k.shape[1], w.x.shape[1]):
            hold_force(w, i, a)
        push(shape, w, i, True, True, controlled, inverse)
    deflect(shape, w, last, True, True)
    for a in range(w.x.shape[1]):
        store(w.own.rate, last, a, 0.0)
        store(w.forces, last, a, 0.0)


@called
def expand_derivatives(w):
    """Series of the derivatives of all forces by deflections and rates, for tangent vectors."""
    o, row = w.own, law_row(w)
    last = w.k.shape[0] - 1
    for a in range(w.k.shape[1]):
        contact = load(w.mesh, CONTACT, a)
        deep = load(w.mesh, DEEP, a) != 0.0
        some = bits(deep) != 0
        c = load(w.constants, DAMPING, a)
        straight = absolute(contact) * load(o.factor, LINEAR, a)
        share = c * load(o.factor, BENT_SHARE, a)
        exponent, power = load(w.constants, row + EXPONENT, a), load(w.constants, row + POWER, a)
        strength = exponent * load(o.factor, STRENGTH, a)
        for i in range(last + 1):
            damp = 0.0
            soft = straight * load(w.k, i, a)
            if i == 0:
                damp = c * load(o.factor, LINEAR_DAMPER, a)
            if some and bends_spring(w, a):
                # powers less one, by division of the series by |f|
                less = quotient(o, o.spring_power, i, a)
                store(o.other, i, a, less)
                bent = 0.0
                for j in range(i + 1):
                    bent = fma(load(w.k, j, a), load(o.other, i - j, a), bent)
                soft = choose(deep, strength * bent, soft)
            if some and bends_damper(w, a):
                rest = c * (1.0 - load(w.constants, row + OTHER, a)) if i == 0 else 0.0
                damp = choose(deep, fma(share, load(o.damper_power, i, a), rest), damp)
            store(o.soft, i, a, soft)
            store(o.damp, i, a, damp)
        if some and bends_damper(w, a):
            for i in range(last + 1):
                less = quotient(o, o.damper_power, i, a)
                store(o.other, i, a, less)
                more = 0.0
                for j in range(i + 1):
                    more = fma(load(o.rate, j, a), load(o.other, i - j, a), more)
                more = choose(deep, contact * share * power * more, 0.0)
                store(o.soft, i, a, load(o.soft, i, a) + more)
    p, g = w.q.shape[0], o.corner
    for j in range(w.shape[4]):
        b = w.k.shape[1] + j
        width, stiff = load(w.constants, row + ROUNDING, b), load(w.constants, row + STIFF, b)
        straight = width == 0.0
        for i in range(last + 1):
            give = stiff * absolute(load(w.mesh, CONTACT, b)) if i == 0 else 0.0
            if bits(without(straight)):
                give = choose(straight, give, stiff * (load(g, i, j) + load(g, 3 * p + i, j)))
            store(o.give, i, j, give)


@inlined
def quotient(o, series, i, a):
    """Order i of a series over ``depth``, lower orders of which are in ``other``."""
    total = load(series, i, a)
    for j in range(1, i + 1):
        total = total - load(o.depth, j, a) * load(o.other, i - j, a)
    return total / load(o.depth, 0, a)


@called
def expand_any_tangent(shape, w, row, coupled, inverse):
    """Series of a tangent vector over the step of ``expand_derivatives``."""
    o, last = w.own, w.k.shape[0] - 1
    begin_series(shape, w, row)
    for i in range(last):
        deflect(shape, w, i, False, coupled)
        for a in range(w.k.shape[1]):
            total = 0.0
            for j in range(i + 1):
                total = fma(load(o.soft, j, a), load(w.x, i - j, a), total)
                total = fma(load(o.damp, j, a), load(o.rate, i - j, a), total)
            store(w.forces, i, a, total)
        for j in range(w.shape[4]):
            a = w.k.shape[1] + j
            total = load(w.constants, DAMPING, a) * load(o.rate, i, a)
            for r in range(i + 1):
                total = fma(load(o.give, r, j), load(w.x, i - r, a), total)
            store(w.forces, i, a, total)
        push(shape, w, i, False, coupled, False, inverse)


@called
def shorten(w):
    """Rewrite all series for the part of each lane's step over which they hold."""
    o, last = w.own, w.q.shape[0] - 1
    end, before = 0.0, 0.0
    for k in range(w.q.shape[1]):
        end = most(most(end, absolute(load(w.v, last, k))), absolute(load(w.q, last, k)))
        before = most(before, absolute(load(w.v, last - 1, k)))
        before = most(before, absolute(load(w.q, last - 1, k)))
    if not bits((end > TAIL) | (before > TAIL)):
        return
    store(w.scale, 0, 0, end)
    store(w.scale, 1, 0, before)
    for lane in range(n_lanes(w.lane)):
        share = 1.0
        if get(w.scale, 0, 0, lane) > TAIL:
            share = min(share, (TAIL / get(w.scale, 0, 0, lane)) ** (1.0 / last))
        if get(w.scale, 1, 0, lane) > TAIL:
            share = min(share, (TAIL / get(w.scale, 1, 0, lane)) ** (1.0 / (last - 1)))
        put(w.scale, 2, 0, lane, share)
    share = load(w.scale, 2, 0)
    scale = 1.0
    for i in range(w.q.shape[0]):
        for k in range(w.q.shape[1]):
            store(w.q, i, k, load(w.q, i, k) * scale)
            store(w.v, i, k, load(w.v, i, k) * scale)
        for a in range(w.k.shape[1]):
            store(w.k, i, a, load(w.k, i, a) * scale)
            store(o.depth, i, a, load(o.depth, i, a) * scale)
            store(o.spring_power, i, a, load(o.spring_power, i, a) * scale)
            store(o.damper_power, i, a, load(o.damper_power, i, a) * scale)
        for a in range(w.x.shape[1]):
            store(w.x, i, a, load(w.x, i, a) * scale)
            store(o.rate, i, a, load(o.rate, i, a) * scale)
            store(w.forces, i, a, load(w.forces, i, a) * scale)
        for j in range(w.shape[4]):
            for which in range(6):
                row = which * w.q.shape[0] + i
                store(o.corner, row, j, load(o.corner, row, j) * scale)
        scale = scale * share
    store(w.lane, LEFT, 0, load(w.lane, LEFT, 0) * share)
    store(w.lane, SHARE, 0, load(w.lane, SHARE, 0) * share)
    store(w.lane, TURN, 0, load(w.lane, TURN, 0) * share)
    t_all = w.pairs.shape[0]
    for t in range(t_all):
        store(w.mix, t_all + t, 0, load(w.mix, t_all + t, 0) * share)
        store(w.mix, 3 * t_all + t, 0, load(w.mix, 3 * t_all + t, 0) * share)


@inlined
def most(a, b):
    """The larger one, lane by lane."""
    return choose(a < b, b, a)
