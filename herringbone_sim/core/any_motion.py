"""Taylor series of a motion whose forces are not linear between switches.

That is of a gear with a power of the deflection in its laws, or with rounded corners of a play:
see ``Packed.powers``. The recurrences are those of ``series``
with the products and powers of series that such laws ask for (Jorba and Zou, Exp. Math. 14, 99,
2005); how far the series hold is read off their last terms.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.extended import know_signs, push_series, shift_series
from herringbone_sim.core.packed import compiled, inlined
from herringbone_sim.core.right_hand_side import accelerate
from herringbone_sim.core.series import begin_series

# Where |f| is below this, in b_c (10 nm for b_c = 10 um), a law with a power of |f| is taken
# linear, of the same work: a power has no series at 0.
NEAR = 1e-3
TAIL = 1e-10  # of the last two terms of a series that still holds, b_c and b_c omega_n


@inlined
def deflect(p, w, i, rate, error):
    """Order i of the deflections and of their rates."""
    c = len(p.classes)
    n = 4 * c
    for side in range(2):
        for k in range(c):
            a = side * c + k
            b = n // 2 + a
            r = w.q[i, 2 + a]
            dr = w.v[i, 2 + a]
            w.x[i, a] = w.q[i, side] - r - error[i, a]
            w.x[i, b] = r - error[i, b]
            w.any.rate[i, a] = w.v[i, side] - dr - rate * error[i + 1, a]
            w.any.rate[i, b] = dr - rate * error[i + 1, b]
    shift_series(p, w, i, w.any.rate[i])


@inlined
def power_of(series, out, i, a, exponent):
    """Order i of the power of the series in column a, which is positive at order 0."""
    if i == 0:
        out[0, a] = series[0, a] ** exponent
        return
    total = 0.0
    for j in range(1, i + 1):
        total += (exponent * j - (i - j)) * series[j, a] * out[i - j, a]
    out[i, a] = total / (i * series[0, a])


@inlined
def linear_law(p, a, closed):
    """Factors on k f and c v of a mesh whose law is taken linear: of the same work up to NEAR."""
    spring = 1.0
    damper = 1.0
    if p.law[1, a] != 1.0:
        spring = 2.0 / (p.law[1, a] + 1.0) * (NEAR / p.law[0, a]) ** (p.law[1, a] - 1.0)
    if p.law[2, a] != 0.0:
        share = closed * (NEAR / p.law[4, a]) ** p.law[3, a] / (p.law[3, a] + 1.0)
        damper = 1.0 - p.law[2, a] + p.law[2, a] * share
    return spring, damper


@inlined
def bends(p, a):
    """Whether the law of a mesh has a power that is no constant."""
    return p.law[1, a] != 1.0 or (p.law[2, a] != 0.0 and p.law[3, a] != 0.0)


@inlined
def mesh_force(p, w, i, a, border):
    """Order i of the force of a mesh from its deflection up to that order."""
    z = w.any
    contact = w.contact[a]
    w.f[i, a] = abs(contact) * w.x[i, a]
    if i == 0:
        w.f[0, a] -= contact * border * p.b[a]
    force = 0.0
    if z.deep[a] != 0.0:
        z.depth[i, a] = contact * w.f[i, a]
        power_of(z.depth, z.power, i, a, p.law[1, a])
        z.spring[i, a] = contact * z.power[i, a] * p.law[0, a] ** (1.0 - p.law[1, a])
        power_of(z.depth, z.damper, i, a, p.law[3, a])
        share = p.law[2, a] * p.law[4, a] ** -p.law[3, a]
        for j in range(i + 1):
            force += w.k[j, a] * z.spring[i - j, a]
            force += p.damping[a] * share * z.damper[j, a] * z.rate[i - j, a]
        force += p.damping[a] * (1.0 - p.law[2, a]) * z.rate[i, a]
    else:
        spring, damper = linear_law(p, a, abs(contact))
        for j in range(i + 1):
            force += spring * w.k[j, a] * w.f[i - j, a]
        force += p.damping[a] * damper * z.rate[i, a]
    w.forces[i, a] = force


@inlined
def corner(z, which, i, j, distance, rounding, sign, q):
    """Order i of ln(1 + e^u) and of its derivative by u, u = (sign q - distance) / rounding.

    Rows of ``corner`` from ``which`` on: the logistic function, its slope by itself, and the
    logarithm.
    """
    g = z.corner
    if i == 0:
        u = (sign * q[0, j] - distance) / rounding
        e = np.exp(-abs(u))
        g[which, 0, j] = 1.0 / (1.0 + e) if u > 0.0 else e / (1.0 + e)
        g[which + 2, 0, j] = max(u, 0.0) + np.log1p(e)
    else:
        logistic = 0.0
        rise = 0.0
        for r in range(1, i + 1):
            du = r * sign * q[r, j] / rounding
            logistic += du * g[which + 1, i - r, j]
            rise += du * g[which, i - r, j]
        g[which, i, j] = logistic / i
        g[which + 2, i, j] = rise / i
    slope = g[which, i, j]
    for r in range(i + 1):
        slope -= g[which, r, j] * g[which, i - r, j]
    g[which + 1, i, j] = slope


@inlined
def hold_force(p, w, i, j):
    """Order i of the force of the seat of a further coordinate."""
    z = w.any
    a = 4 * len(p.classes) + j
    play = abs(w.contact[a]) * w.x[i, a]
    if i == 0:
        play -= w.contact[a] * p.seat[j, 2]
    if p.seat[j, 3] != 0.0:
        own = w.x[:, 4 * len(p.classes) :]
        corner(z, 0, i, j, p.seat[j, 2], p.seat[j, 3], 1.0, own)
        corner(z, 3, i, j, p.seat[j, 2], p.seat[j, 3], -1.0, own)
        play = p.seat[j, 3] * (z.corner[2, i, j] - z.corner[5, i, j])
    w.forces[i, a] = p.seat[j, 0] * play + p.seat[j, 1] * z.rate[i, a]


@inlined
def push(p, w, i, h, load):
    """Order i + 1 of the motion from order i of all forces."""
    n_all = w.v.shape[1]
    for k in range(n_all):
        w.v[i + 1, k] = load[i, k]
    for a in range(4 * len(p.classes)):
        w.force[a] = w.forces[i, a]
    accelerate(p, w.force, w.v[i + 1])
    push_series(p, w, i, w.v[i + 1])
    scale = h * w.inverse[i + 1]
    for k in range(n_all):
        w.v[i + 1, k] *= scale
        w.q[i + 1, k] = w.v[i, k] * scale


@compiled
def expand_any_motion(p, w, y, h):
    """Series of the motion over one step in the state of its switches; see ``series``."""
    order = w.k.shape[0] - 1
    begin_series(p, w, y)
    for i in range(order):
        deflect(p, w, i, (i + 1) / h, w.error)
        for a in range(4 * len(p.classes)):
            mesh_force(p, w, i, a, 1.0)
        for j in range(p.seat.shape[0]):
            hold_force(p, w, i, j)
        if i == 0:
            know_signs(p, w)
        push(p, w, i, h, w.load)
    last_deflection(p, w)


@inlined
def last_deflection(p, w):
    """Highest order of the deflections; that of their rates is left at zero."""
    order = w.k.shape[0] - 1
    c = len(p.classes)
    for a in range(4 * c):
        side = (a // c) % 2
        r = w.q[order, 2 + side * c + a % c]
        x = w.q[order, side] - r if a < 2 * c else r
        w.x[order, a] = x - w.error[order, a]
    shift_series(p, w, order, w.any.rate[order])
    for a in range(w.x.shape[1]):
        w.any.rate[order, a] = 0.0
        w.forces[order, a] = 0.0


@compiled
def expand_derivatives(p, w):
    """Series of the derivatives of all forces by deflections and rates, for tangent vectors."""
    order = w.k.shape[0] - 1
    z = w.any
    for a in range(4 * len(p.classes)):
        contact = w.contact[a]
        if z.deep[a] != 0.0:
            strength = p.law[1, a] * p.law[0, a] ** (1.0 - p.law[1, a])
            share = p.damping[a] * p.law[2, a] * p.law[4, a] ** -p.law[3, a]
            for i in range(order + 1):
                power_of(z.depth, z.power, i, a, p.law[1, a] - 1.0)
                total = 0.0
                for j in range(i + 1):
                    total += w.k[j, a] * z.power[i - j, a]
                z.soft[i, a] = strength * total
                z.damp[i, a] = share * z.damper[i, a]
            z.damp[0, a] += p.damping[a] * (1.0 - p.law[2, a])
            if share != 0.0 and p.law[3, a] != 0.0:
                for i in range(order + 1):
                    power_of(z.depth, z.power, i, a, p.law[3, a] - 1.0)
                    for j in range(i + 1):
                        more = z.rate[j, a] * z.power[i - j, a]
                        z.soft[i, a] += contact * share * p.law[3, a] * more
        else:
            spring, damper = linear_law(p, a, abs(contact))
            for i in range(order + 1):
                z.soft[i, a] = abs(contact) * spring * w.k[i, a]
                z.damp[i, a] = 0.0
            z.damp[0, a] = p.damping[a] * damper
    for j in range(p.seat.shape[0]):
        for i in range(order + 1):
            z.give[i, j] = 0.0
            if p.seat[j, 3] != 0.0:
                z.give[i, j] = p.seat[j, 0] * (z.corner[0, i, j] + z.corner[3, i, j])
        if p.seat[j, 3] == 0.0:
            z.give[0, j] = p.seat[j, 0] * abs(w.contact[4 * len(p.classes) + j])


@compiled
def expand_any_tangent(p, w, tangent, h, load):
    """Series of a tangent vector over the step of ``expand_derivatives``.

    Args:
        load: (p + 1, m + s) series of the acceleration that drives it; zeros for a perturbation.
    """
    order = w.k.shape[0] - 1
    n = 4 * len(p.classes)
    z = w.any
    begin_series(p, w, tangent)
    for i in range(order):
        deflect(p, w, i, (i + 1) / h, w.none_n)
        for a in range(n):
            total = 0.0
            for j in range(i + 1):
                total += z.soft[j, a] * w.x[i - j, a] + z.damp[j, a] * z.rate[i - j, a]
            w.forces[i, a] = total
        for j in range(p.seat.shape[0]):
            total = p.seat[j, 1] * z.rate[i, n + j]
            for r in range(i + 1):
                total += z.give[r, j] * w.x[i - r, n + j]
            w.forces[i, n + j] = total
        push(p, w, i, h, load)


@inlined
def share_that_holds(w):
    """Share of the step, at most 1, over which the series of the motion hold."""
    last = w.v.shape[0] - 1
    end = 0.0
    before = 0.0
    for k in range(w.v.shape[1]):
        end = max(end, abs(w.v[last, k]), abs(w.q[last, k]))
        before = max(before, abs(w.v[last - 1, k]), abs(w.q[last - 1, k]))
    share = 1.0
    if end > TAIL:
        share = min(share, (TAIL / end) ** (1.0 / last))
    if before > TAIL:
        share = min(share, (TAIL / before) ** (1.0 / (last - 1)))
    return share


@inlined
def shorten(w, share):
    """Rewrite all series for a shorter step."""
    z = w.any
    scale = 1.0
    for i in range(w.q.shape[0]):
        for k in range(w.q.shape[1]):
            w.q[i, k] *= scale
            w.v[i, k] *= scale
        for a in range(w.x.shape[1]):
            w.x[i, a] *= scale
            w.forces[i, a] *= scale
            z.rate[i, a] *= scale
        for a in range(w.k.shape[1]):
            w.k[i, a] *= scale
            z.depth[i, a] *= scale
            z.damper[i, a] *= scale
        for j in range(z.give.shape[1]):
            for which in range(6):
                z.corner[which, i, j] *= scale
        scale *= share
    for t in range(w.mix.shape[1]):
        w.mix[1, t] *= share
