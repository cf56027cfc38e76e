"""A Dormand-Prince step in sixteen lanes, of a different length in each, with tangents."""

from __future__ import annotations

from herringbone_sim.core.lanes.nonlinear_series import most
from herringbone_sim.core.lanes.vector import (
    absolute,
    choose,
    fma,
    give,
    load,
    root,
    store,
    take,
    without,
)
from herringbone_sim.core.packed import called, inlined
from herringbone_sim.effects.crossing import END
from herringbone_sim.effects.dormand_prince import APART, NODE, TOLERANCE, A
from herringbone_sim.effects.dormand_prince import ERROR as SHARES
from herringbone_sim.effects.lanes.gear import OMEGA, SI
from herringbone_sim.effects.lanes.progress import DONE, ERROR, NOW, PIECE_START, TAKEN, TRIED
from herringbone_sim.effects.lanes.slope import inside, slope, slope_of
from herringbone_sim.effects.law import PLAY, SHIFT
from herringbone_sim.effects.run import FORCE, LENGTH, RATE


@inlined
def begin_phase(m):
    """Return the phase [rad] at the start of each lane's step."""
    return fma(take(m.r.progress, DONE), take(m.scalars, OMEGA), take(m.r.progress, PIECE_START))


@inlined
def clamp_shift_of(m, j):
    """Return the shift [m] of deflection j into its contact state, as ``Trial.clamp_shift``."""
    w = m.w
    x = take(w.plain, j) + load(w.law, SHIFT, j)
    margin = take(m.scalars, SI + LENGTH) * (4.0 * APART)
    return inside(x, load(w.law, PLAY, j), take(w.contact_state, j), margin) - x


@called
def attempt(m):
    """Try a step of length ``TRIED`` in each lane, from stage 0, which is ready, to stage 6.

    Errors over the tolerance go into ``ERROR``, margins at the end into row END.
    """
    r = m.r
    h, begin, Omega = take(r.progress, TRIED), begin_phase(m), take(m.scalars, OMEGA)
    for i in range(1, 7):
        for k in range(r.z.shape[0]):
            moved = load(r.slope, 0, k) * A[i, 0]
            for j in range(1, i):
                moved = fma(load(r.slope, j, k), A[i, j], moved)
            store(r.y, i, k, fma(h, moved, load(r.y, 0, k)))
        give(r.progress, NOW, fma(h * Omega, NODE[i], begin))
        slope_of(m, r.y[i], r.slope[i], False)
        for j in range(m.w.x.shape[0]):
            store(r.clamp_shift, i, j, clamp_shift_of(m, j))
    worst = h * 0.0
    for k in range(r.z.shape[0]):
        off = load(r.slope, 0, k) * SHARES[0]
        for j in range(1, 7):
            off = fma(load(r.slope, j, k), SHARES[j], off)
        size = most(absolute(load(r.y, 0, k)), absolute(load(r.y, 6, k)))
        off = absolute(h * off) / (size + 1.0)
        worst = choose((off > worst) | without(off == off), off, worst)
    give(r.progress, ERROR, worst / TOLERANCE)
    margins(m, END)


@called
def margins(m, row):
    """Write the margins of the last evaluated slope into a row, as ``located.margins``."""
    r, w, n = m.r, m.w, m.w.x.shape[0]
    length = 1.0 / take(m.scalars, SI + LENGTH)
    rate, newton = 1.0 / take(m.scalars, SI + RATE), 1.0 / take(m.scalars, SI + FORCE)
    zero, unit = length * 0.0, length * 0.0 + 1.0
    for j in range(n):
        x, b = take(w.plain, j) + load(w.law, SHIFT, j), load(w.law, PLAY, j)
        v, contact_state = take(w.v, j), take(w.contact_state, j)
        up = (x > zero) | ((x == zero) & (v > zero))
        outward = choose(up, unit, zero - unit)
        is_open = contact_state == zero
        margin = choose(is_open, b - absolute(x), contact_state * x - b)
        margin_rate = choose(is_open, zero - outward * v, contact_state * v)
        store(r.margin, row, j, margin * length)
        store(r.margin_rate, row, j, margin_rate * rate)
        sign = take(r.sign, j) * take(w.force, j) * newton if m.reacts else unit
        store(r.margin, row, n + j, sign)


@called
def difference(m, y, v, dv):
    """Write the derivative of the slope at y along v to dv, as ``dormand_prince.difference``."""
    r = m.r
    square = take(m.scalars, OMEGA) * 0.0
    for k in range(v.shape[0]):
        square = fma(take(v, k), take(v, k), square)
    size = root(square)
    small = choose(size == 0.0, size, APART / size)
    for k in range(v.shape[0]):
        give(r.was, k, fma(small, take(v, k), take(y, k)))
    slope(m, r.was, dv, True)
    for k in range(v.shape[0]):
        give(r.was, k, take(y, k) - small * take(v, k))
    slope(m, r.was, r.along[6], True)
    for k in range(v.shape[0]):
        give(dv, k, (take(dv, k) - load(r.along, 6, k)) * (size / (2.0 * APART)))


@called
def carry(m):
    """Advance the tangent in place in every lane that accepts the step it tried."""
    r, w = m.r, m.w
    h, begin, Omega = take(r.progress, TRIED), begin_phase(m), take(m.scalars, OMEGA)
    taken = take(r.progress, TAKEN) == 1.0
    for i in range(6):
        for k in range(r.z.shape[0]):
            moved = h * 0.0
            for j in range(i):
                moved = fma(load(r.along, j, k), A[i, j], moved)
            give(r.direction, k, fma(h, moved, load(r.tangent, 0, k)))
        for j in range(w.x.shape[0]):
            give(w.clamp_shift, j, load(r.clamp_shift, i, j))
        give(r.progress, NOW, fma(h * Omega, NODE[i], begin))
        difference(m, r.y[i], r.direction, r.along[i])
    for k in range(r.z.shape[0]):
        moved = h * 0.0
        for j in range(6):
            moved = fma(load(r.along, j, k), A[6, j], moved)
        old = load(r.tangent, 0, k)
        store(r.tangent, 0, k, choose(taken, fma(h, moved, old), old))
