"""Taylor series of forces that are not linear between switches, from the series of the motion.

A gear with ``powers`` has force laws with powers of |f|, or seats with rounded corners, see
``Packed``. The recurrences are those of products and powers of series (Jorba and Zou, Exp. Math.
14, 99, 2005). Arguments: see ``lanes.packed``.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.lanes.extended import law_row
from herringbone_sim.core.lanes.packed import (
    BORDER,
    CONTACT,
    DAMPING,
    DAMPING_SHARE,
    DEEP,
    DEPTH,
    EXPONENT,
    HALF,
    POWER,
    ROUNDING,
    STIFF,
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
    store,
    without,
)
from herringbone_sim.core.packed import called, inlined

# Where |f| is below this, in b_c (0.1 um for b_c = 100 um), a law with a power of |f| is replaced
# by a linear one of the same work: a power has no series at 0.
LINEAR_BELOW = 1e-3
# Rows of ``factor``: on f and on c v of the linear law; of the powers of |f| in spring and damper.
LINEAR, LINEAR_DAMPER, STRENGTH, BENT_SHARE = range(4)


@inlined
def power_of(w, out, i, a, row):
    """Compute order i of |f| to the exponent in row ``row`` of the constants, mesh a, into out."""
    depth = w.nonlinear.depth
    if i == 0:
        for lane in range(n_lanes(w.progress)):
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
    """Set the factors ``nonlinear.factor`` of the force law of every mesh in its present contact.

    The linear law does the same work up to ``LINEAR_BELOW`` as the law that it replaces.
    """
    row = law_row(w)
    for a in range(w.k.shape[1]):
        for lane in range(n_lanes(w.progress)):
            reference, exponent = (
                get(w.constants, row, a, lane),
                get(w.constants, row + EXPONENT, a, lane),
            )
            share, power = (
                get(w.constants, row + DAMPING_SHARE, a, lane),
                get(w.constants, row + POWER, a, lane),
            )
            spring, damper, strength, bent = 1.0, 1.0, 1.0, 0.0
            if exponent != 1.0:
                spring = 2.0 / (exponent + 1.0) * (LINEAR_BELOW / reference) ** (exponent - 1.0)
                strength = reference ** (1.0 - exponent)
            if share != 0.0:
                closed = abs(get(w.mesh_state, CONTACT, a, lane))
                depth = get(w.constants, row + DEPTH, a, lane)
                damper += share * (closed * (LINEAR_BELOW / depth) ** power / (power + 1.0) - 1.0)
                bent = share * depth**-power
            put(w.nonlinear.factor, LINEAR, a, lane, spring)
            put(w.nonlinear.factor, LINEAR_DAMPER, a, lane, damper)
            put(w.nonlinear.factor, STRENGTH, a, lane, strength)
            put(w.nonlinear.factor, BENT_SHARE, a, lane, bent)


@inlined
def bends_spring(w, a):
    """Whether the spring force of mesh a is a power of |f| in any lane."""
    return bits(load(w.constants, law_row(w) + EXPONENT, a) != 1.0) != 0


@inlined
def bends_damper(w, a):
    """Whether the damping force of mesh a is not c v in any lane."""
    return bits(load(w.constants, law_row(w) + DAMPING_SHARE, a) != 0.0) != 0


@inlined
def mesh_force(w, i, a):
    """Compute order i of the force of mesh a from its deflection up to that order."""
    o, row = w.nonlinear, law_row(w)
    contact = load(w.mesh_state, CONTACT, a)
    deep = load(w.mesh_state, DEEP, a) != 0.0
    f = absolute(contact) * load(w.x, i, a)
    rest = 0.0
    damper = 0.0
    unit = 0.0
    if i == 0:
        f = f - contact * load(w.constants, BORDER, a)
        rest = 1.0 - load(w.constants, row + DAMPING_SHARE, a)
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
    """Compute order 0 of one rounded corner of the play of the seat in column a.

    It fills three blocks of rows of ``corner`` from block ``which`` on: the logistic function of
    u = (sign x - half play) / rounding, its derivative by u, and ln(1 + e^u).
    """
    row, p, j = law_row(w), w.q.shape[0], a - w.k.shape[1]
    g = w.nonlinear.corner
    for lane in range(n_lanes(w.progress)):
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
    """Compute order i of the series of one rounded corner of the play of a seat, in all lanes.

    It is written to row i of each of the three blocks named in ``logarithms``, and needs their
    lower orders and the orders up to i of the deflection ``w.x``.

    Args:
        w: work arrays of the lanes.
        which: first of the three blocks: 0, or 3 for the corner at negative deflection.
        i: order; 0 is computed by ``logarithms``.
        a: column of the seat, behind those of the meshes.
        sign: 1.0 or -1.0, of the deflection at the corner.
    """
    if i == 0:
        logarithms(w, which, a, sign)
        return
    p, g, j = w.q.shape[0], w.nonlinear.corner, a - w.k.shape[1]
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
def seat_force_series(w, i, a):
    """Compute order i of the force of the seat in column a."""
    row, p, g, j = law_row(w), w.q.shape[0], w.nonlinear.corner, a - w.k.shape[1]
    contact = load(w.mesh_state, CONTACT, a)
    play = absolute(contact) * load(w.x, i, a)
    if i == 0:
        play = play - contact * load(w.constants, row + HALF, a)
    width = load(w.constants, row + ROUNDING, a)
    straight = width == 0.0
    if bits(without(straight)):
        corner(w, 0, i, a, 1.0)
        corner(w, 3, i, a, -1.0)
        play = choose(straight, play, width * (load(g, 2 * p + i, j) - load(g, 5 * p + i, j)))
    dashpot = load(w.constants, DAMPING, a) * load(w.nonlinear.rate, i, a)
    store(w.forces, i, a, fma(load(w.constants, row + STIFF, a), play, dashpot))
