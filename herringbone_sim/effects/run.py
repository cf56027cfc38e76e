"""Compiled mesh forces and state derivative of a gear that is integrated by laws."""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.packed import TWO_PI, exposed
from herringbone_sim.core.right_hand_side import accelerate, control_angle, deflections
from herringbone_sim.effects.instant import added_state_rates, forces_of_motion
from herringbone_sim.effects.law import HARMONICS, MEAN_E, PHASE

LENGTH, RATE, FORCE, U_UNIT, FREQUENCY_N = range(5)


@exposed
def forces_of_state(e, site, theta, gear, p, si, now, y, w, g):
    """Compute ``forces_of_motion`` of a state; its deflections and rates go to ``g``, in SI.

    ``y`` is dimensionless but for the effects' states, which are in SI units. ``si`` holds
    b_c [m], b_c omega_n [m/s], the unit of mesh forces [N] (which accelerates a mass M by 1 / M in
    units of b_c omega_n^2), b_c / cos beta [m] and omega_n [rad/s].
    """
    n = w.force.size
    m = 2 + n // 2
    deflections(p, y[:m], g.x)
    deflections(p, y[m : 2 * m], g.v)
    omega = p.Omega * si[FREQUENCY_N]
    for j in range(n):
        g.x[j] = g.x[j] * si[LENGTH] - gear[MEAN_E, j]
        g.v[j] *= si[RATE]
    for j in range((gear.shape[0] - HARMONICS) // 4):
        cos, sin = np.cos((j + 1) * now[PHASE]), np.sin((j + 1) * now[PHASE])
        row = HARMONICS + 4 * j + 2
        for i in range(n):
            g.x[i] -= gear[row, i] * cos + gear[row + 1, i] * sin
            g.v[i] -= omega * (j + 1) * (gear[row + 1, i] * cos - gear[row, i] * sin)
    forces_of_motion(e, site, theta, gear, now, y[2 * m :], g.x, g.v, w)


@exposed
def slope_of(e, site, theta, gear, p, si, now, cycle, phase, y, w, g, dy):
    """Write dy/dtau (s,): Eqs. (18), (22) with effects, then the effects' states in SI per tau."""
    now[PHASE] = TWO_PI * cycle + phase
    forces_of_state(e, site, theta, gear, p, si, now, y, w, g)
    n = w.force.size
    half = n // 2
    m = 2 + half
    control = p.K * np.cos(control_angle(p, phase, cycle)) if p.K != 0.0 else 0.0
    carrier = w.torque[2] * p.inv_M_c
    unit = si[LENGTH] / (si[U_UNIT] * si[FORCE] * g.projection)
    for k in range(m):
        dy[k] = y[m + k]
    for side in range(2):
        push = w.torque[side] * p.inv_M_s[side] - 2.0 * carrier
        dy[m + side] = p.load_q[side] - control * p.control_q[side] + unit * push
        for i in range(half // 2):
            k = side * (half // 2) + i
            push = w.torque[3 + k] * p.inv_M_p[side, i] - carrier
            dy[m + 2 + k] = p.load_r - control * p.control_r[side] + unit * push
    for j in range(n):
        g.scaled[j] = w.force[j] / si[FORCE]
    accelerate(p, g.scaled, dy[m:])
    added_state_rates(e, site, theta, gear, now, y[2 * m :], w.force, dy[2 * m :])
    for k in range(2 * m, y.size):
        dy[k] /= si[FREQUENCY_N]
