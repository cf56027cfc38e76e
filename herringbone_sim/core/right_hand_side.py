"""Right-hand side at a phase, including the kinks, and the classical Runge-Kutta step with it.

Dimensionless arguments: ``p`` is ``Packed``, ``w`` ``Work``, ``y`` coordinates, rates, then added
ones, ``phase`` [rad] that of mesh cycle ``cycle``, ``event`` a row of ``Packed.events``.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.packed import TWO_PI, compiled, exposed, inlined

ON_EDGE = 1e-12  # mesh cycles: bound of the rounding error of a phase after some thousand cycles


@inlined
def deflections(p, coordinate, x):
    """Write x = G q of Eqs. (15), (16), without errors: sun meshes q - r, ring meshes r."""
    c = len(p.classes)
    for side in range(2):
        for i in range(c):
            m = side * c + i
            x[m] = coordinate[side] - coordinate[2 + m]
            x[2 * c + m] = coordinate[2 + m]


@exposed
def accelerate(p, force, acceleration):
    """Add the accelerations by mesh forces (n_mesh,), Eqs. (12)-(14) as in (18), in place."""
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
def angle_of(order, phase, cycle):
    """Return the angle [rad] of a harmonic of any order, whole turns of ``cycle`` removed."""
    turns = order * cycle
    return TWO_PI * (turns - np.floor(turns)) + order * phase


@inlined
def control_angle(p, phase, cycle):
    """Return the argument [rad] of the control, order * phase + control_phase (Eq. 20)."""
    return angle_of(p.control_order, phase, cycle) + p.control_phase


@inlined
def cycles_from_event(event, phase, cycle):
    """Return the mesh cycles since the middle of the nearest event, negative before it."""
    s = cycle + phase / TWO_PI - event[1]
    return s - event[0] * np.floor(s / event[0] + 0.5)


@inlined
def cycles_to_edge(event, phase, cycle):
    """Return the mesh cycles to the next edge of an event that is not within ``ON_EDGE``."""
    s = cycles_from_event(event, phase, cycle)
    half = 0.5 * event[2]
    if s < -half - ON_EDGE:
        return -half - s
    if s < half - ON_EDGE:
        return half - s
    return event[0] - half - s


@inlined
def excite(p, w, phase, cycle):
    """Write k, e and de/dtau of all meshes (Eqs. 7-10, with effects) into ``w``."""
    n = 4 * len(p.classes)
    for m in range(n):
        w.k[m] = p.stiffness[m]
        w.error[m] = p.e_mean[m]
        w.error_rate[m] = 0.0
    for j in range(p.orders.size):
        angle = angle_of(p.orders[j], phase, cycle)
        cos = np.cos(angle)
        sin = np.sin(angle)
        for m in range(n):
            w.k[m] += p.k_cos[j, m] * cos + p.k_sin[j, m] * sin
            w.error[m] += p.e_cos[j, m] * cos + p.e_sin[j, m] * sin
            rate = p.e_sin[j, m] * cos - p.e_cos[j, m] * sin
            w.error_rate[m] += p.orders[j] * p.Omega * rate
    for j in range(p.events.shape[0]):
        bump, slope = event_height(p, j, phase, cycle)
        for m in range(n):
            w.k[m] *= 1.0 - p.event_k[j, m] * bump
            w.error[m] -= p.event_d[j, m] * bump
            w.error_rate[m] -= p.event_d[j, m] * slope


@inlined
def event_height(p, j, phase, cycle):
    """Return the height of event j, 1 at its middle and 0 outside, and its derivative by tau."""
    s = cycles_from_event(p.events[j], phase, cycle)
    width = p.events[j, 2]
    if abs(s) < 0.5 * width:
        angle = TWO_PI * s / width
        return 0.5 + 0.5 * np.cos(angle), -0.5 * p.Omega / width * np.sin(angle)
    return 0.0, 0.0


@inlined
def hide_displacement(p, w, y, phase, cycle):
    """Subtract the displacements that effects add, and their rates, from ``w.x`` and ``w.v``."""
    n = 4 * len(p.classes)
    shift_by_added(p, y, -1.0, w.x, w.v)
    for m in range(n):
        w.x[m] -= p.d_mean[m]
    for j in range(p.d_cos.shape[0]):
        angle = angle_of(p.orders[j], phase, cycle)
        cos = np.cos(angle)
        sin = np.sin(angle)
        for m in range(n):
            w.x[m] -= p.d_cos[j, m] * cos + p.d_sin[j, m] * sin
            rate = p.d_sin[j, m] * cos - p.d_cos[j, m] * sin
            w.v[m] -= p.orders[j] * p.Omega * rate
    for j in range(p.events.shape[0]):
        bump, slope = event_height(p, j, phase, cycle)
        for m in range(n):
            w.x[m] -= p.event_d[j, m] * bump
            w.v[m] -= p.event_d[j, m] * slope


@inlined
def shift_by_added(p, y, sign, x, v):
    """Add (sign 1) or subtract (-1) the mesh displacement by added coordinates, and its rate."""
    s = p.seat.shape[0]
    first = 4 + 4 * len(p.classes)
    for j in range(s):
        for m in range(4 * len(p.classes)):
            x[m] += sign * p.added_shift[j, m] * y[first + j]
            v[m] += sign * p.added_shift[j, m] * y[first + s + j]


@inlined
def force_law(p, m, k, f, v):
    """Return the force of mesh m at deflection f beyond the backlash and rate v, by
    ``Packed.law``.
    """
    spring = f
    damper = 1.0
    if f != 0.0 and p.law[1, m] != 1.0:
        spring = f * (abs(f) / p.law[0, m]) ** (p.law[1, m] - 1.0)
    if p.law[2, m] != 0.0:
        share = (abs(f) / p.law[4, m]) ** p.law[3, m] if f != 0.0 else 0.0
        damper = 1.0 - p.law[2, m] + p.law[2, m] * share
    return k * spring + p.damping[m] * damper * v


@inlined
def pitch_side(phase, step_cycles):
    """Return the mesh cycles from the pitch point, -0.5 to 0.5, and the side (1 after, -1 before).

    The step that begins at ``phase`` takes ``step_cycles`` mesh cycles and never crosses a pitch
    point, so its middle determines the side.
    """
    start = phase / TWO_PI
    middle = start + 0.5 * step_cycles
    whole = np.floor(middle + 0.5)
    return start - whole, 1.0 if middle > whole else -1.0


@inlined
def seat_force(p, j, displacement, rate):
    """Return the force of the spring and damper of added coordinate j, by ``Packed.seat``."""
    half = p.seat[j, 2]
    play = max(displacement - half, 0.0) + min(displacement + half, 0.0)
    if p.seat[j, 3] != 0.0:
        u = (displacement - p.seat[j, 2]) / p.seat[j, 3]
        d = (-displacement - p.seat[j, 2]) / p.seat[j, 3]
        rise = max(u, 0.0) + np.log1p(np.exp(-abs(u)))
        play = p.seat[j, 3] * (rise - max(d, 0.0) - np.log1p(np.exp(-abs(d))))
    return p.seat[j, 0] * play + p.seat[j, 1] * rate


@inlined
def add_push(p, w, y, phase, acceleration):
    """Add the accelerations by ``Packed.push`` (friction, seats) to those of all coordinates."""
    s = p.seat.shape[0]
    m = 2 + 2 * len(p.classes)
    n = 4 * len(p.classes)
    for j in range(s):
        w.force[n + j] = seat_force(p, j, y[2 * m + j], y[2 * m + s + j])
    start, side = pitch_side(phase, 0.0)
    carrier = 0.0
    for t in range(p.pairs.shape[0]):
        k, a = p.pairs[t, 0], p.pairs[t, 1]
        rub = side * (p.push[1, k, a] + start * p.push[2, k, a])
        added = p.push[0, k, a] * w.force[a] + rub * abs(w.force[a])
        if k < m + s:
            acceleration[k] += added
        else:
            carrier += added
    subtract_carrier(p, carrier, acceleration)


@inlined
def subtract_carrier(p, carrier, acceleration):
    """Apply an acceleration of the carrier to all coordinates, which are relative to it."""
    for side in range(2):
        acceleration[side] -= 2.0 * carrier
    for k in range(2, 2 + 2 * len(p.classes)):
        acceleration[k] -= carrier


@inlined
def mesh_forces(p, w, y, phase, cycle):
    """Write deflections x, rates v and forces of all meshes into ``w.x``, ``w.v``, ``w.force``.

    x and v are without mesh error; the force is k f(x) + c v (Eqs. 1, 4, 12), by ``Packed.law``
    unless ``p.plain``. Writes ``w.k``, ``w.error`` and ``w.error_rate`` too, see ``excite``.
    """
    excite(p, w, phase, cycle)
    m_coordinate = 2 + 2 * len(p.classes)
    deflections(p, y[:m_coordinate], w.x)
    deflections(p, y[m_coordinate : 2 * m_coordinate], w.v)
    shift_by_added(p, y, 1.0, w.x, w.v)
    for m in range(4 * len(p.classes)):
        x = w.x[m] - w.error[m]
        v = w.v[m] - w.error_rate[m]
        f = x - p.b[m] if x > p.b[m] else (x + p.b[m] if x < -p.b[m] else 0.0)
        w.x[m] = x
        w.v[m] = v
        if p.plain:
            w.force[m] = w.k[m] * f + p.damping[m] * v
        else:
            w.force[m] = force_law(p, m, w.k[m], f, v)


@exposed
def right_hand_side(p, w, y, phase, cycle, dy):
    """Write dy/dtau of Eqs. (18), (22) into ``dy``, including the kinks of f."""
    m = 2 + 2 * len(p.classes)
    s = p.seat.shape[0]
    mesh_forces(p, w, y, phase, cycle)
    control = p.K * np.cos(control_angle(p, phase, cycle))
    push = w.push
    for side in range(2):
        push[side] = p.load_q[side] - control * p.control_q[side]
        for i in range(len(p.classes)):
            push[2 + side * len(p.classes) + i] = p.load_r - control * p.control_r[side]
    for j in range(s):
        push[m + j] = 0.0
    for j in range(p.load_orders.size):
        angle = angle_of(p.load_orders[j], phase, cycle)
        cos = np.cos(angle)
        sin = np.sin(angle)
        for k in range(m + s):
            push[k] += p.load_cos[j, k] * cos + p.load_sin[j, k] * sin
    accelerate(p, w.force, push)
    if not p.plain:
        add_push(p, w, y, phase, push)
    for k in range(m):
        dy[k] = y[m + k]
        dy[m + k] = push[k]
    for j in range(s):
        dy[2 * m + j] = y[2 * m + s + j]
        dy[2 * m + s + j] = push[m + j]


@compiled
def rk4_step(p, w, y, phase, cycle, h):
    """Advance y in place by h (tau) with the classical Runge-Kutta method, that of the paper.

    It does not locate contact changes.
    """
    half = 0.5 * h
    middle = phase + p.Omega * half
    right_hand_side(p, w, y, phase, cycle, w.slope[0])
    for k in range(y.size):
        w.stage[k] = y[k] + half * w.slope[0, k]
    right_hand_side(p, w, w.stage, middle, cycle, w.slope[1])
    for k in range(y.size):
        w.stage[k] = y[k] + half * w.slope[1, k]
    right_hand_side(p, w, w.stage, middle, cycle, w.slope[2])
    for k in range(y.size):
        w.stage[k] = y[k] + h * w.slope[2, k]
    right_hand_side(p, w, w.stage, phase + p.Omega * h, cycle, w.slope[3])
    for k in range(y.size):
        inner = w.slope[1, k] + w.slope[2, k]
        y[k] += h / 6.0 * (w.slope[0, k] + 2.0 * inner + w.slope[3, k])
