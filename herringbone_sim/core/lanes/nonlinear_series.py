"""Taylor series of a motion, and of its tangents, under the forces of ``nonlinear_forces``.

Intervals are cut so that the last terms are small. Arguments: see ``lanes.packed``.
"""

from __future__ import annotations

from herringbone_sim.core.lanes.extended import know_signs, law_row, push_pairs, shift_series
from herringbone_sim.core.lanes.nonlinear_forces import (
    BENT_SHARE,
    LINEAR,
    LINEAR_DAMPER,
    STRENGTH,
    bends_damper,
    bends_spring,
    mesh_force,
    seat_force_series,
    set_factors,
)
from herringbone_sim.core.lanes.packed import (
    CONTACT,
    DAMPING,
    DAMPING_SHARE,
    DEEP,
    EXPONENT,
    INTERVAL_CYCLES,
    LEFT,
    POWER,
    ROUNDING,
    SHARE,
    STIFF,
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

TAIL = 1e-10  # largest size of the last two terms of a series, b_c or b_c omega_n


@inlined
def deflect(unrolled, w, i, forced, coupled):
    """Set order i of ``w.x`` and ``w.nonlinear.rate`` from ``w.q``, ``w.v`` and, if forced, e.

    Deflections contain the displacements by added coordinates; seats' are set, too.
    """
    sides, c = len(unrolled[0]), len(unrolled[1])
    half = sides * c
    rate = float(i + 1) / load(w.progress, LEFT, 0)
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
            store(w.nonlinear.rate, i, a, v)
            store(w.nonlinear.rate, i, half + a, dr)
    shift_series(w, i, w.nonlinear.rate, coupled)


@inlined
def push(unrolled, w, i, forced, coupled, controlled, inverse):
    """Compute order i + 1 of the motion from order i of all forces."""
    for a in range(w.k.shape[1]):
        store(w.force, 0, a, load(w.forces, i, a))
    if forced and i == 0:
        know_signs(w)
    push_pairs(w, i, coupled)
    scale = load(w.progress, LEFT, 0) * inverse[i + 1]
    accelerate(unrolled, w, i, forced, coupled, controlled, scale)


@called
def expand_nonlinear_motion(unrolled, w, controlled, inverse):
    """Compute the series of the state over the interval of each lane."""
    last = w.k.shape[0] - 1
    begin_series(unrolled, w, 0)
    set_factors(w)
    for i in range(last):
        deflect(unrolled, w, i, True, True)
        for a in range(w.k.shape[1]):
            mesh_force(w, i, a)
        for a in range(w.k.shape[1], w.x.shape[1]):
            seat_force_series(w, i, a)
        push(unrolled, w, i, True, True, controlled, inverse)
    deflect(unrolled, w, last, True, True)
    for a in range(w.x.shape[1]):
        store(w.nonlinear.rate, last, a, 0.0)
        store(w.forces, last, a, 0.0)


@called
def expand_derivatives(w):
    """Compute the series of the derivatives of all forces by deflections and rates.

    They are ``force_by_x``, ``force_by_v`` and ``seat_stiffness`` in ``w.nonlinear``, for
    tangent vectors.
    """
    o, row = w.nonlinear, law_row(w)
    last = w.k.shape[0] - 1
    for a in range(w.k.shape[1]):
        contact = load(w.mesh_state, CONTACT, a)
        deep = load(w.mesh_state, DEEP, a) != 0.0
        some = bits(deep) != 0
        c = load(w.constants, DAMPING, a)
        straight = absolute(contact) * load(o.factor, LINEAR, a)
        share = c * load(o.factor, BENT_SHARE, a)
        exponent, power = load(w.constants, row + EXPONENT, a), load(w.constants, row + POWER, a)
        strength = exponent * load(o.factor, STRENGTH, a)
        for i in range(last + 1):
            force_by_v = 0.0
            force_by_x = straight * load(w.k, i, a)
            if i == 0:
                force_by_v = c * load(o.factor, LINEAR_DAMPER, a)
            if some and bends_spring(w, a):
                # |f|^(p - 1), by division of the series of |f|^p by that of |f|
                less = quotient(o, o.spring_power, i, a)
                store(o.power_over_depth, i, a, less)
                bent = 0.0
                for j in range(i + 1):
                    bent = fma(load(w.k, j, a), load(o.power_over_depth, i - j, a), bent)
                force_by_x = choose(deep, strength * bent, force_by_x)
            if some and bends_damper(w, a):
                rest = c * (1.0 - load(w.constants, row + DAMPING_SHARE, a)) if i == 0 else 0.0
                force_by_v = choose(deep, fma(share, load(o.damper_power, i, a), rest), force_by_v)
            store(o.force_by_x, i, a, force_by_x)
            store(o.force_by_v, i, a, force_by_v)
        if some and bends_damper(w, a):
            for i in range(last + 1):
                less = quotient(o, o.damper_power, i, a)
                store(o.power_over_depth, i, a, less)
                more = 0.0
                for j in range(i + 1):
                    more = fma(load(o.rate, j, a), load(o.power_over_depth, i - j, a), more)
                more = choose(deep, contact * share * power * more, 0.0)
                store(o.force_by_x, i, a, load(o.force_by_x, i, a) + more)
    p, g = w.q.shape[0], o.corner
    for j in range(w.sizes[4]):
        b = w.k.shape[1] + j
        width, stiff = load(w.constants, row + ROUNDING, b), load(w.constants, row + STIFF, b)
        straight = width == 0.0
        for i in range(last + 1):
            seat_stiffness = stiff * absolute(load(w.mesh_state, CONTACT, b)) if i == 0 else 0.0
            if bits(without(straight)):
                seat_stiffness = choose(
                    straight, seat_stiffness, stiff * (load(g, i, j) + load(g, 3 * p + i, j))
                )
            store(o.seat_stiffness, i, j, seat_stiffness)


@inlined
def quotient(o, series, i, a):
    """Return order i of a series divided by ``depth``.

    Lower orders of it are in ``power_over_depth``.
    """
    total = load(series, i, a)
    for j in range(1, i + 1):
        total = total - load(o.depth, j, a) * load(o.power_over_depth, i - j, a)
    return total / load(o.depth, 0, a)


@called
def expand_nonlinear_tangent(unrolled, w, row, coupled, inverse):
    """Compute the series of a tangent vector; call ``expand_derivatives`` before."""
    o, last = w.nonlinear, w.k.shape[0] - 1
    begin_series(unrolled, w, row)
    for i in range(last):
        deflect(unrolled, w, i, False, coupled)
        for a in range(w.k.shape[1]):
            total = 0.0
            for j in range(i + 1):
                total = fma(load(o.force_by_x, j, a), load(w.x, i - j, a), total)
                total = fma(load(o.force_by_v, j, a), load(o.rate, i - j, a), total)
            store(w.forces, i, a, total)
        for j in range(w.sizes[4]):
            a = w.k.shape[1] + j
            total = load(w.constants, DAMPING, a) * load(o.rate, i, a)
            for r in range(i + 1):
                total = fma(load(o.seat_stiffness, r, j), load(w.x, i - r, a), total)
            store(w.forces, i, a, total)
        push(unrolled, w, i, False, coupled, False, inverse)


@called
def shorten(w):
    """Cut the interval of each lane where the last terms exceed ``TAIL``; rescale all series."""
    o, last = w.nonlinear, w.q.shape[0] - 1
    end, before = 0.0, 0.0
    for k in range(w.q.shape[1]):
        end = most(most(end, absolute(load(w.v, last, k))), absolute(load(w.q, last, k)))
        before = most(before, absolute(load(w.v, last - 1, k)))
        before = most(before, absolute(load(w.q, last - 1, k)))
    if not bits((end > TAIL) | (before > TAIL)):
        return
    store(w.scale, 0, 0, end)
    store(w.scale, 1, 0, before)
    for lane in range(n_lanes(w.progress)):
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
        for j in range(w.sizes[4]):
            for which in range(6):
                row = which * w.q.shape[0] + i
                store(o.corner, row, j, load(o.corner, row, j) * scale)
        scale = scale * share
    store(w.progress, LEFT, 0, load(w.progress, LEFT, 0) * share)
    store(w.progress, SHARE, 0, load(w.progress, SHARE, 0) * share)
    store(w.progress, INTERVAL_CYCLES, 0, load(w.progress, INTERVAL_CYCLES, 0) * share)
    t_all = w.pairs.shape[0]
    for t in range(t_all):
        store(w.mix, t_all + t, 0, load(w.mix, t_all + t, 0) * share)
        store(w.mix, 3 * t_all + t, 0, load(w.mix, 3 * t_all + t, 0) * share)


@inlined
def most(a, b):
    """Return the maximum of a and b, lane by lane."""
    return choose(a < b, b, a)
