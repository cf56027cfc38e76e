"""The compiled run of a gear with effects: Runge-Kutta of order 4 over a grid of mesh phases."""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.core.right_hand_side import accelerate, control_angle, deflections
from herringbone_sim.core.run import LIMIT
from herringbone_sim.effects.instant import instant, own_slopes
from herringbone_sim.effects.law import PHASE, PLAY, error_at, error_slope_at, law

LENGTH, RATE, FORCE, TILT, FREQUENCY_N = range(5)


@law
def at_instant(e, site, theta, gear, p, si, now, y, w, g):
    """Deflections, rates, forces and torques of a state, left in ``g`` and ``w``, SI units.

    ``si`` holds b_c [m], b_c omega_n [m/s], the unit of the mesh forces [N] (a mesh force of one
    such unit accelerates by 1 / M), b_c / cos beta [m] and omega_n [rad/s].
    """
    n = w.force.size
    m = 2 + n // 2
    deflections(p, y[:m], g.x)
    deflections(p, y[m : 2 * m], g.v)
    omega = p.Omega * si[FREQUENCY_N]
    for j in range(n):
        g.x[j] = g.x[j] * si[LENGTH] - error_at(gear, j, now[PHASE])
        g.v[j] = g.v[j] * si[RATE] - omega * error_slope_at(gear, j, now[PHASE])
    instant(e, site, theta, gear, now, y[2 * m :], g.x, g.v, w)


@law
def slope_of(e, site, theta, gear, p, si, now, cycle, phase, y, w, g, dy):
    """dy/dtau: Eqs. (18), (22) with the effects' forces and torques, then their own states."""
    now[PHASE] = TWO_PI * cycle + phase
    at_instant(e, site, theta, gear, p, si, now, y, w, g)
    n = w.force.size
    half = n // 2
    m = 2 + half
    control = p.K * np.cos(control_angle(p, phase, cycle))
    carrier = w.torque[2] * p.inv_M_c
    unit = si[LENGTH] / (si[TILT] * si[FORCE] * g.projection)
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
    own_slopes(e, site, theta, gear, now, y[2 * m :], w.force, dy[2 * m :])
    for k in range(2 * m, y.size):
        dy[k] /= si[FREQUENCY_N]


@law
def rk4(e, site, theta, gear, p, si, now, cycle, phase, h, y, w, g):
    """Advance y by h in dimensionless time, in place."""
    for stage in range(4):
        part = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        for k in range(y.size):
            g.stage[k] = y[k] + (part * h * g.rate[stage - 1, k] if stage > 0 else 0.0)
        at = phase + part * h * p.Omega
        slope_of(e, site, theta, gear, p, si, now, cycle, at, g.stage, w, g, g.rate[stage])
    for k in range(y.size):
        inner = g.rate[1, k] + g.rate[2, k]
        y[k] += h / 6.0 * (g.rate[0, k] + 2.0 * inner + g.rate[3, k])


@law
def write_row(p, si, carrier, t, now, y, w, g, row):
    """One sample: head, x, v, F of the meshes, u of the bodies; returns the largest |x| / b_c."""
    n = w.force.size
    m = carrier.size
    row[0] = t
    row[1] = now[0]
    row[2] = now[4]
    row[3] = now[2]
    row[4] = now[3]
    largest = 0.0
    for j in range(n):
        row[5 + j] = g.x[j]
        row[5 + n + j] = g.v[j]
        row[5 + 2 * n + j] = w.force[j]
        size = abs(w.x[j]) / si[LENGTH]
        if size > largest or np.isnan(size):
            largest = size
    u_c = 0.0
    for k in range(m):
        u_c += carrier[k] * y[k]
    first = 5 + 3 * n
    for side in range(2):
        row[first + side] = y[side] * si[TILT] + 2.0 * u_c
    row[first + 2] = u_c
    for k in range(2, m):
        row[first + 1 + k] = y[k] * si[TILT] + u_c
    return largest


@law
def run(
    e,
    site,
    theta,
    gear,
    p,
    si,
    carrier,
    now,
    y,
    place,
    t,
    steps,
    stride,
    parts,
    w,
    g,
    rows,
    contact,
):
    """Fill rows with samples ``stride`` steps apart, each of ``parts`` steps of the method.

    ``place`` is (cycle, index) and moves on; returns (time, rows filled). The run stops after the
    row that is out of range. ``contact (n, 3)`` counts samples in back contact, separated, in
    drive contact.
    """
    h = TWO_PI / (p.Omega * steps) / parts
    for i in range(rows.shape[0]):
        now[PHASE] = TWO_PI * place[0] + TWO_PI * place[1] / steps
        at_instant(e, site, theta, gear, p, si, now, y, w, g)
        largest = write_row(p, si, carrier, t, now, y, w, g, rows[i])
        for j in range(contact.shape[0]):
            b = w.law[PLAY, j]
            contact[j, 1 + (w.x[j] > b) - (w.x[j] < -b)] += 1
        if not largest < LIMIT:
            return t, i + 1
        for _ in range(stride):
            phase = TWO_PI * place[1] / steps
            for part in range(parts):
                at = phase + part * h * p.Omega
                rk4(e, site, theta, gear, p, si, now, place[0], at, h, y, w, g)
            t += h * parts / si[FREQUENCY_N]
            place[1] += 1
            if place[1] == steps:
                place[1] = 0
                place[0] += 1
    return t, rows.shape[0]
