"""Right-hand side at a phase, kinks and all, and the classical Runge-Kutta step on it."""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.packed import TWO_PI, compiled, inlined


@inlined
def deflections(p, coordinate, x):
    """x = G q of Eqs. (15), (16), without the errors: sun meshes q - r, ring meshes r."""
    c = len(p.classes)
    for side in range(2):
        for i in range(c):
            m = side * c + i
            x[m] = coordinate[side] - coordinate[2 + m]
            x[2 * c + m] = coordinate[2 + m]


@inlined
def accelerate(p, force, acceleration):
    """Subtract the accelerations that the mesh forces give (Eqs. 12-14, as 18): in place."""
    c = len(p.classes)
    half = 2 * c
    sun_left = 0.0
    sun_right = 0.0
    ring_left = 0.0
    ring_right = 0.0
    for i in range(c):
        sun_left += force[i]
        sun_right += force[c + i]
        ring_left += force[half + i]
        ring_right += force[half + c + i]
    left = sun_left + ring_left
    right = sun_right + ring_right
    carrier = p.multiplicity * (left + right) * p.inv_M_c
    acceleration[0] -= p.multiplicity * sun_left * p.inv_M_s[0] + 2.0 * carrier
    acceleration[1] -= p.multiplicity * sun_right * p.inv_M_s[1] + 2.0 * carrier
    for side in range(2):
        for i in range(c):
            m = side * c + i
            planet = (force[m] - force[half + m]) * p.inv_M_p[side, i]
            acceleration[2 + m] -= carrier - planet


@inlined
def control_angle(p, phase, cycle):
    """Argument of the control, order * phase + control_phase (Eq. 20), cycles taken modulo one."""
    turns = p.control_order * cycle
    return TWO_PI * (turns - np.floor(turns)) + p.control_order * phase + p.control_phase


@inlined
def excite(p, w, phase):
    """k, e and de/dtau of all meshes at a phase into order 0 of the series (Eqs. 7-10)."""
    n = 4 * len(p.classes)
    for m in range(n):
        w.k[0, m] = p.stiffness[m]
        w.error[0, m] = p.e_mean[m]
        w.error_rate[m] = 0.0
    for j in range(p.k_cos.shape[0]):
        cos = np.cos((j + 1) * phase)
        sin = np.sin((j + 1) * phase)
        for m in range(n):
            w.k[0, m] += p.k_cos[j, m] * cos + p.k_sin[j, m] * sin
    for j in range(p.e_cos.shape[0]):
        cos = np.cos((j + 1) * phase)
        sin = np.sin((j + 1) * phase)
        for m in range(n):
            w.error[0, m] += p.e_cos[j, m] * cos + p.e_sin[j, m] * sin
            rate = p.e_sin[j, m] * cos - p.e_cos[j, m] * sin
            w.error_rate[m] += (j + 1) * p.Omega * rate


@inlined
def mesh_forces(p, w, y, phase):
    """Deflection, its rate and the force k f(x) + c v of all meshes at a phase (Eqs. 1, 4, 12).

    Leaves them in ``w.end``, ``w.at`` and ``w.force``, in the kernel's units.
    """
    excite(p, w, phase)
    m_coordinate = 2 + 2 * len(p.classes)
    deflections(p, y[:m_coordinate], w.end)
    deflections(p, y[m_coordinate:], w.at)
    for m in range(4 * len(p.classes)):
        x = w.end[m] - w.error[0, m]
        v = w.at[m] - w.error_rate[m]
        f = x - p.b[m] if x > p.b[m] else (x + p.b[m] if x < -p.b[m] else 0.0)
        w.end[m] = x
        w.at[m] = v
        w.force[m] = w.k[0, m] * f + p.damping[m] * v


@inlined
def right_hand_side(p, w, y, phase, cycle, dy):
    """dy/dtau of Eqs. (18), (22) at a phase; the kinks of f are in it."""
    m_coordinate = 2 + 2 * len(p.classes)
    mesh_forces(p, w, y, phase)
    control = p.K * np.cos(control_angle(p, phase, cycle))
    for k in range(m_coordinate):
        dy[k] = y[m_coordinate + k]
    for side in range(2):
        dy[m_coordinate + side] = p.load_q[side] - control * p.control_q[side]
        for i in range(len(p.classes)):
            k = m_coordinate + 2 + side * len(p.classes) + i
            dy[k] = p.load_r - control * p.control_r[side]
    accelerate(p, w.force, dy[m_coordinate:])


@compiled
def rk4_step(p, w, y, phase, cycle, h):
    """Advance y by h with the classical Runge-Kutta method of order 4, as the paper did."""
    half = 0.5 * h
    middle = phase + p.Omega * half
    right_hand_side(p, w, y, phase, cycle, w.rate[0])
    for k in range(y.size):
        w.stage[k] = y[k] + half * w.rate[0, k]
    right_hand_side(p, w, w.stage, middle, cycle, w.rate[1])
    for k in range(y.size):
        w.stage[k] = y[k] + half * w.rate[1, k]
    right_hand_side(p, w, w.stage, middle, cycle, w.rate[2])
    for k in range(y.size):
        w.stage[k] = y[k] + h * w.rate[2, k]
    right_hand_side(p, w, w.stage, phase + p.Omega * h, cycle, w.rate[3])
    for k in range(y.size):
        inner = w.rate[1, k] + w.rate[2, k]
        y[k] += h / 6.0 * (w.rate[0, k] + 2.0 * inner + w.rate[3, k])
