"""Taylor series of the excitation and of the motion over one step in one contact state.

Between two switches of contact the model is linear with periodic coefficients, so the series
follows from a short recurrence: the stiffness series times the deflection series (a Cauchy product
per mesh), then Newton's law. The series is dense output at no cost.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.extended import (
    know_signs,
    n_own,
    push_series,
    set_damping,
    shift_series,
)
from herringbone_sim.core.packed import TWO_PI, inlined
from herringbone_sim.core.right_hand_side import (
    accelerate,
    angle_of,
    control_angle,
    cycles_from_event,
)


@inlined
def expand_excitation(p, w, phase, cycle, h):
    """Series over one step of length h of k(t) (Eq. 7), e(t) (Eq. 9) and the control."""
    order = w.k.shape[0] - 1
    n = 4 * len(p.classes)
    for m in range(n):
        w.k[0, m] = p.stiffness[m]
        w.error[0, m] = p.e_mean[m]
    for i in range(1, order + 1):
        for m in range(n):
            w.k[i, m] = 0.0
            w.error[i, m] = 0.0
    for j in range(p.orders.size):
        expand_harmonic(w, angle_of(p.orders[j], phase, cycle), p.orders[j] * p.Omega * h)
        for four in range(len(p.classes)):
            add_harmonic(w, w.k, p.k_cos[j], p.k_sin[j], 4 * four)
            add_harmonic(w, w.error, p.e_cos[j], p.e_sin[j], 4 * four)
    for j in range(p.windows.shape[0]):
        expand_window(p, w, j, phase, cycle, h)
    expand_load(p, w, phase, cycle, h)


@inlined
def expand_window(p, w, j, phase, cycle, h):
    """Apply event j to the series of k and e, if the step, which never crosses an edge, is in it.

    The event is a raised cosine, 0.5 + 0.5 cos(2 pi s / width), of the mesh cycles s from its
    middle.
    """
    width = p.windows[j, 2]
    s = cycles_from_event(p.windows[j], phase, cycle)
    turn = p.Omega * h
    if abs(s + 0.5 * turn / TWO_PI) < 0.5 * width:
        expand_harmonic(w, TWO_PI * s / width, turn / width)
        for i in range(w.cos.size):
            w.cos[i] *= 0.5
        w.cos[0] += 0.5
        for m in range(4 * len(p.classes)):
            if p.window_k[j, m] != 0.0:
                for i in range(w.cos.size):
                    w.product[i] = w.k[i, m]
                    for k in range(i + 1):
                        w.product[i] -= p.window_k[j, m] * w.cos[k] * w.k[i - k, m]
                for i in range(w.cos.size):
                    w.k[i, m] = w.product[i]
            if p.window_d[j, m] != 0.0:
                for i in range(w.cos.size):
                    w.error[i, m] -= p.window_d[j, m] * w.cos[i]


@inlined
def expand_harmonic(w, angle, turn):
    """Series of cos(angle + s turn) and sin(angle + s turn) in s into ``w.cos`` and ``w.sin``."""
    cos = np.cos(angle)
    sin = np.sin(angle)
    scale = 1.0
    for i in range(w.cos.size):
        w.cos[i] = scale * cos
        w.sin[i] = scale * sin
        cos, sin = -sin, cos
        scale *= turn * w.inverse[i + 1]


@inlined
def add_harmonic(w, out, in_cos, in_sin, m):
    """Add one harmonic to the series of meshes m to m + 3, side by side in vector lanes."""
    c0, c1, c2, c3 = in_cos[m], in_cos[m + 1], in_cos[m + 2], in_cos[m + 3]
    s0, s1, s2, s3 = in_sin[m], in_sin[m + 1], in_sin[m + 2], in_sin[m + 3]
    for i in range(w.cos.size):
        cos = w.cos[i]
        sin = w.sin[i]
        a0 = out[i, m] + (c0 * cos + s0 * sin)
        a1 = out[i, m + 1] + (c1 * cos + s1 * sin)
        a2 = out[i, m + 2] + (c2 * cos + s2 * sin)
        a3 = out[i, m + 3] + (c3 * cos + s3 * sin)
        out[i, m] = a0
        out[i, m + 1] = a1
        out[i, m + 2] = a2
        out[i, m + 3] = a3


@inlined
def expand_load(p, w, phase, cycle, h):
    """Series of the torques and of the control K cos(order * phase + control_phase), Eq. (20)."""
    last = w.load.shape[0] - 1
    c = len(p.classes)
    if p.K != 0.0:
        expand_harmonic(w, control_angle(p, phase, cycle), p.control_order * p.Omega * h)
        for i in range(last + 1):
            for k in range(2 + 2 * c, w.load.shape[1]):
                w.load[i, k] = 0.0
            control = p.K * w.cos[i]
            for side in range(2):
                w.load[i, side] = -control * p.control_q[side]
                for k in range(c):
                    w.load[i, 2 + side * c + k] = -control * p.control_r[side]
    else:
        for i in range(last + 1):
            for k in range(w.load.shape[1]):
                w.load[i, k] = 0.0
    for j in range(p.load_orders.size):
        order = p.load_orders[j]
        expand_harmonic(w, angle_of(order, phase, cycle), order * p.Omega * h)
        for i in range(w.cos.size):
            for k in range(w.load.shape[1]):
                w.load[i, k] += p.load_cos[j, k] * w.cos[i] + p.load_sin[j, k] * w.sin[i]
    for side in range(2):
        w.load[0, side] += p.load_q[side]
        for k in range(c):
            w.load[0, 2 + side * c + k] += p.load_r


@inlined
def cauchy(w, i, m):
    """Add order i of the product k f for meshes m to m + 3, side by side in vector lanes."""
    a0 = a1 = a2 = a3 = 0.0
    for j in range(i + 1):
        a0 += w.k[j, m] * w.f[i - j, m]
        a1 += w.k[j, m + 1] * w.f[i - j, m + 1]
        a2 += w.k[j, m + 2] * w.f[i - j, m + 2]
        a3 += w.k[j, m + 3] * w.f[i - j, m + 3]
    w.force[m] += a0
    w.force[m + 1] += a1
    w.force[m + 2] += a2
    w.force[m + 3] += a3


@inlined
def expand_motion(p, w, y, h, error, load, border):
    """Series of the motion over one step in the contact state ``w.contact``.

    The same recurrence serves the motion (all inputs) and a tangent vector (zero inputs,
    border 0): the tangent of a motion that is linear between switches is the linear part.
    """
    order = w.k.shape[0] - 1
    c = len(p.classes)
    n = 4 * c
    m_coordinate = 2 + 2 * c
    own = n_own(p)
    damping = p.damping
    b = p.b
    begin_series(p, w, y)
    if len(p.extended) > 0:
        set_damping(p, w)
        damping = w.damping
        b = w.border
    for m in range(n + own):
        w.closed[m] = abs(w.contact[m])
    for i in range(order):
        rate = (i + 1) / h
        for side in range(2):
            for k in range(c):
                m = side * c + k
                r = w.q[i, 2 + m]
                dr = w.v[i, 2 + m]
                w.x[i, m] = w.q[i, side] - r - error[i, m]
                w.x[i, n // 2 + m] = r - error[i, n // 2 + m]
                w.force[m] = w.v[i, side] - dr - rate * error[i + 1, m]
                w.force[n // 2 + m] = dr - rate * error[i + 1, n // 2 + m]
        if len(p.extended) > 0:
            shift_series(p, w, i, w.force)
        for m in range(n + own):
            w.force[m] *= damping[m]
            w.f[i, m] = w.closed[m] * w.x[i, m]
        if i == 0:
            for m in range(n + own):
                w.f[0, m] -= w.contact[m] * border * b[m]
        for four in range(c):
            cauchy(w, i, 4 * four)
        for j in range(own):
            w.force[n + j] += p.seat[j, 0] * w.f[i, n + j]
        for k in range(m_coordinate + own):
            w.v[i + 1, k] = load[i, k]
        accelerate(p, w.force, w.v[i + 1])
        if len(p.extended) > 0:
            for m in range(n + own):
                w.forces[i, m] = w.force[m]
            if i == 0 and border != 0.0:
                know_signs(p, w)
            push_series(p, w, i, w.v[i + 1])
        scale = h * w.inverse[i + 1]
        for k in range(m_coordinate + own):
            w.v[i + 1, k] *= scale
            w.q[i + 1, k] = w.v[i, k] * scale
    for side in range(2):
        for k in range(c):
            m = side * c + k
            r = w.q[order, 2 + m]
            w.x[order, m] = w.q[order, side] - r - error[order, m]
            w.x[order, n // 2 + m] = r - error[order, n // 2 + m]
    if len(p.extended) > 0:
        shift_series(p, w, order, w.force)
        for m in range(n):
            w.forces[order, m] = 0.0


@inlined
def begin_series(p, w, y):
    """Order 0 of all coordinates from a state or a tangent vector."""
    m = 2 + 2 * len(p.classes)
    own = n_own(p)
    for k in range(m):
        w.q[0, k] = y[k]
        w.v[0, k] = y[m + k]
    for j in range(own):
        w.q[0, m + j] = y[2 * m + j]
        w.v[0, m + j] = y[2 * m + own + j]
