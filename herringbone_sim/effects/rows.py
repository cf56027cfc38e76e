"""Compiled integration by laws over the phase grid, with samples or without."""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.packed import LIMIT, TWO_PI, called
from herringbone_sim.core.run import orthonormalise, write_bodies
from herringbone_sim.effects.instant import FREE
from herringbone_sim.effects.law import PHASE, law
from herringbone_sim.effects.located import grid_step
from herringbone_sim.effects.run import FREQUENCY_N, LENGTH, U_UNIT, forces_of_state


@called
def write_row(m, t, y, row):
    """Write a sample (``Layout.channels``) of state y at time t [s] into row.

    Phase, K, delta_T and T_1 are those in ``m.now``: the caller sets ``m.now[PHASE]`` before.
    Work arrays of m are overwritten.

    Returns the largest deflection |x| / b_c, effects included; NaN if any is NaN.
    """
    w, g, now = m.w, m.g, m.now
    n = w.force.size
    for j in range(n):
        w.contact_state[j], w.clamp_shift[j] = FREE, 0.0
    for k in range(y.size):
        m.r.z[k] = y[k] * m.unit[k]
    forces_of_state(m.e, m.site, m.theta, m.gear, m.p, m.si, now, m.r.z, w, g)
    row[0], row[1], row[2], row[3], row[4] = t, now[0], now[4], now[2], now[3]
    largest = 0.0
    for j in range(n):
        row[5 + j] = g.x[j]
        row[5 + n + j] = g.v[j]
        row[5 + 2 * n + j] = w.force[j]
        size = abs(w.x[j]) / m.si[LENGTH]
        if size > largest or np.isnan(size):
            largest = size
    write_bodies(y, m.carrier, m.si[U_UNIT], 5 + 3 * n, row)
    return largest


@law
def run(m, y, tangents, growth, grid_point, t, steps, stride, rows):
    """Fill rows with samples ``stride`` grid steps apart, as ``core.run.sample``.

    ``y``, ``tangents``, ``growth`` and ``grid_point`` (cycle, index) are advanced in place; y
    becomes NaN if the motion diverges. Returns (time [s], rows filled, switches).
    """
    h = TWO_PI / (m.p.Omega * steps)
    switches = 0
    for i in range(rows.shape[0]):
        m.now[PHASE] = TWO_PI * grid_point[0] + TWO_PI * grid_point[1] / steps
        if not write_row(m, t, y, rows[i]) < LIMIT:
            return t, i + 1, switches
        for _ in range(stride):
            new_switches = grid_step(
                m, grid_point[0], TWO_PI * grid_point[1] / steps, h, y, tangents
            )
            if new_switches < 0:
                y[:] = np.nan
                return t, i + 1, switches
            switches += new_switches
            t += h / m.si[FREQUENCY_N]
            grid_point[1] += 1
            if grid_point[1] == steps:
                grid_point[1] = 0
                grid_point[0] += 1
                orthonormalise(tangents, growth)
    return t, rows.shape[0], switches


@law
def advance_cycles(m, y, tangents, cycle, cycles, steps):
    """Advance y, NaN if it diverges, and tangents over cycles, as ``core.run.over_cycles``."""
    h = TWO_PI / (m.p.Omega * steps)
    for c in range(cycle, cycle + cycles):
        for index in range(steps):
            if grid_step(m, c, TWO_PI * index / steps, h, y, tangents) < 0:
                y[:] = np.nan
                return
