"""Slope dy/dtau in sixteen lanes, as ``effects.instant`` and ``effects.run`` for one gear."""

from __future__ import annotations

from herringbone_sim.core.lanes.nonlinear_series import most
from herringbone_sim.core.lanes.run import least
from herringbone_sim.core.lanes.series import sine_cosine
from herringbone_sim.core.lanes.vector import LANES, choose, fma, give, load, store, take
from herringbone_sim.core.packed import TWO_PI, called, inlined
from herringbone_sim.effects.instant import BEYOND
from herringbone_sim.effects.lanes.gear import (
    CONTROL,
    CONTROL_ORDER,
    CONTROL_Q,
    CONTROL_R,
    INV_CARRIER,
    INV_PLANET,
    INV_SUN,
    LOAD_Q,
    LOAD_R,
    MULTIPLICITY,
    OMEGA,
    PROJECTION,
    SI,
)
from herringbone_sim.effects.lanes.progress import ANGLE, BOUND_HIGH, BOUND_LOW, CYCLE, NOW
from herringbone_sim.effects.law import (
    DAMPING,
    HARMONICS,
    MEAN_E,
    MEAN_K,
    NOMINAL_B,
    NOMINAL_C,
    PHASE,
    PLAY,
    SHIFT,
    SHIFT_RATE,
    STIFFNESS,
)
from herringbone_sim.effects.run import FORCE, FREQUENCY_N, LENGTH, RATE, U_UNIT


@inlined
def inside(x, b, contact_state, margin):
    """Clamp deflections into contact states, as ``instant.clamp_to_contact`` in each lane."""
    edge = most(b - margin, b * 0.0)
    within = least(most(x, 0.0 - edge), edge)
    closed = choose(contact_state > 0.0, most(x, b + margin), least(x, 0.0 - b - margin))
    return choose(contact_state == 0.0, within, closed)


@inlined
def nominal(m, phase):
    """Write mesh motion and law without effects at a phase to ``plain``, ``rate`` and ``law``."""
    w, scalars, gear = m.w, m.scalars, m.gear
    n = w.x.shape[0]
    half, length, rate = n // 2, take(scalars, SI + LENGTH), take(scalars, SI + RATE)
    size = 2 + half
    for j in range(n):
        ring = 2 + j - (half if j >= half else 0)
        x, v = take(m.r.z, ring), take(m.r.z, size + ring)
        if j < half:
            side = j // (half // 2)
            x, v = take(m.r.z, side) - x, take(m.r.z, size + side) - v
        give(w.plain, j, x * length - load(gear, MEAN_E, j))
        give(w.rate, j, v * rate)
        store(w.law, STIFFNESS, j, load(gear, MEAN_K, j))
        store(w.law, DAMPING, j, load(gear, NOMINAL_C, j))
        store(w.law, PLAY, j, load(gear, NOMINAL_B, j))
        store(w.law, SHIFT, j, length * 0.0)
        store(w.law, SHIFT_RATE, j, length * 0.0)
    omega = take(scalars, OMEGA) * take(scalars, SI + FREQUENCY_N)
    for i in range((gear.shape[0] - HARMONICS) // 4):
        order = i + 1.0
        sin, cos = sine_cosine(phase * order)
        row = HARMONICS + 4 * i
        for j in range(n):
            k = fma(load(gear, row, j), cos, load(w.law, STIFFNESS, j))
            store(w.law, STIFFNESS, j, fma(load(gear, row + 1, j), sin, k))
            a, b = load(gear, row + 2, j), load(gear, row + 3, j)
            give(w.plain, j, take(w.plain, j) - (a * cos + b * sin))
            give(w.rate, j, take(w.rate, j) - omega * order * (b * cos - a * sin))


@called
def excite_singly(m, i, first, last):
    """Call ``excite`` of effect i, not written for lanes, for one lane after another.

    ``first`` and ``last`` delimit its states among those of all effects.
    """
    single, w, single_constants = m.single, m.w, m.single_constants
    for lane in range(LANES):
        for row in range(5):
            for j in range(w.x.shape[0]):
                single.law[lane, row, j] = w.law[row, j, lane]
        m.e.excite[i](
            single_constants.theta[i][lane],
            single_constants.site[i][lane],
            single_constants.gear[lane],
            single_constants.now[lane],
            single.added_states[lane, first:last],
            single.law[lane],
        )
    for row in range(5):
        for j in range(w.x.shape[0]):
            for lane in range(LANES):
                w.law[row, j, lane] = single.law[lane, row, j]


@called
def react_singly(m, i, first, last):
    """Call ``react`` of effect i for one lane after another, see ``excite_singly``."""
    single, w, single_constants = m.single, m.w, m.single_constants
    n, bodies = w.x.shape[0], w.torque.shape[0]
    for lane in range(LANES):
        for j in range(n):
            for row in range(5):
                single.law[lane, row, j] = w.law[row, j, lane]
            single.x[lane, j], single.v[lane, j] = w.x[j, lane], w.v[j, lane]
            single.force[lane, j] = w.force[j, lane]
        for k in range(bodies):
            single.torque[lane, k] = w.torque[k, lane]
        m.e.react[i](
            single_constants.theta[i][lane],
            single_constants.site[i][lane],
            single_constants.gear[lane],
            single_constants.now[lane],
            single.added_states[lane, first:last],
            single.x[lane],
            single.v[lane],
            single.law[lane],
            single.force[lane],
            single.torque[lane],
        )
        for j in range(n):
            w.force[j, lane] = single.force[lane, j]
        for k in range(bodies):
            w.torque[k, lane] = single.torque[lane, k]


@called
def drive_singly(m, i, first, last, dy):
    """Write the rates of the states of effect i lane by lane, see ``excite_singly``.

    ``dy`` (states of all effects, lanes) is in SI units.
    """
    single, single_constants = m.single, m.single_constants
    for lane in range(LANES):
        for j in range(m.w.x.shape[0]):
            single.force[lane, j] = m.w.force[j, lane]
        m.e.drive[i](
            single_constants.theta[i][lane],
            single_constants.site[i][lane],
            single_constants.gear[lane],
            single_constants.now[lane],
            single.added_states[lane, first:last],
            single.force[lane],
            single.slope[lane, first:last],
        )
        for k in range(first, last):
            dy[k, lane] = single.slope[lane, k]


@called
def tell_singly(m):
    """Copy phase and effects' states to the arrays of laws that are not written for lanes."""
    for lane in range(LANES):
        m.single_constants.now[lane, PHASE] = m.now[PHASE, lane]
        for k in range(m.single.added_states.shape[1]):
            m.single.added_states[lane, k] = m.r.z[m.n_state + k, lane]


@inlined
def forces(m, free):
    """Compute mesh forces and torques of effects in ``m.w``, as ``instant.forces_of_motion``.

    ``free``: contact follows from the deflection plus ``clamp_shift``; else it is that in
    ``m.w.contact_state``.
    """
    e, w, added_states = m.e, m.w, m.r.z[m.n_state :]
    for i in range(e.n_active):
        first, last = e.first[i], e.first[i + 1]
        if e.acts[i, 0] and m.written[i]:
            m.vector[0][i](m.theta[i], m.site[i], m.gear, m.now, added_states[first:last], w.law)
        elif e.acts[i, 0]:
            excite_singly(m, i, first, last)
    zero = take(m.scalars, OMEGA) * 0.0
    for j in range(w.x.shape[0]):
        shown, b = take(w.plain, j) + load(w.law, SHIFT, j), load(w.law, PLAY, j)
        v = take(w.rate, j) + load(w.law, SHIFT_RATE, j)
        if free:
            x = shown + take(w.clamp_shift, j)
            f = choose(x > b, x - b, choose(x < zero - b, x + b, zero))
        else:
            contact_state = take(w.contact_state, j)
            x = inside(shown, b, contact_state, BEYOND)
            f = choose(contact_state == zero, zero, shown - contact_state * b)
        give(w.x, j, x)
        give(w.v, j, v)
        give(w.force, j, fma(load(w.law, DAMPING, j), v, load(w.law, STIFFNESS, j) * f))
    for k in range(w.torque.shape[0]):
        give(w.torque, k, zero)
    for i in range(e.n_active):
        first, last = e.first[i], e.first[i + 1]
        if e.acts[i, 1] and m.written[i]:
            head = m.theta[i], m.site[i], m.gear, m.now, added_states[first:last]
            m.vector[1][i](*head, w.x, w.v, w.law, w.force, w.torque)
        elif e.acts[i, 1]:
            react_singly(m, i, first, last)


@inlined
def accelerate(m, phase, dy):
    """Write velocities and accelerations of the layout's coordinates to dy, Eqs. (18), (22)."""
    scalars, w = m.scalars, m.w
    n = w.x.shape[0]
    half, c = n // 2, n // 4
    size, multiplicity = 2 + half, take(scalars, MULTIPLICITY)
    newton = 1.0 / take(scalars, SI + FORCE)
    unit = (
        take(scalars, SI + LENGTH)
        / (take(scalars, SI + U_UNIT) * take(scalars, PROJECTION))
        * newton
    )
    control = newton * 0.0
    if m.controlled:
        angle = fma(take(scalars, CONTROL_ORDER), phase, take(m.r.progress, ANGLE))
        control = take(scalars, CONTROL) * sine_cosine(angle)[1]
    carrier, total = take(w.torque, 2) * take(scalars, INV_CARRIER), newton * 0.0
    for j in range(n):
        total = total + take(w.force, j)
    common = multiplicity * total * newton * take(scalars, INV_CARRIER)
    for side in range(2):
        inv, sun = take(scalars, INV_SUN + side), newton * 0.0
        for i in range(c):
            sun = sun + take(w.force, side * c + i)
        push = take(w.torque, side) * inv - 2.0 * carrier
        applied = take(scalars, LOAD_Q + side) - control * take(scalars, CONTROL_Q + side)
        mesh = multiplicity * sun * newton * inv + 2.0 * common
        give(dy, size + side, fma(unit, push, applied) - mesh)
        for i in range(c):
            k = side * c + i
            inv = take(scalars, INV_PLANET + k)
            push = take(w.torque, 3 + k) * inv - carrier
            applied = take(scalars, LOAD_R) - control * take(scalars, CONTROL_R + side)
            mesh = common - (take(w.force, k) - take(w.force, half + k)) * newton * inv
            give(dy, size + 2 + k, fma(unit, push, applied) - mesh)
    for k in range(size):
        give(dy, k, take(m.r.z, size + k))


@inlined
def drive(m, dy):
    """Write the rates of the effects' states (states, lanes) to dy, in SI units."""
    e, added_states = m.e, m.r.z[m.n_state :]
    for i in range(e.n_active):
        first, last = e.first[i], e.first[i + 1]
        if last > first and m.written[i]:
            head = m.theta[i], m.site[i], m.gear, m.now, added_states[first:last]
            m.vector[2][i](*head, m.w.force, dy[first:last])
        elif last > first:
            drive_singly(m, i, first, last, dy)


@inlined
def slope_of(m, y, dy, free):
    """Write dy/dtau (s, lanes) at phase ``NOW`` of each lane, clipped to the bounds of its piece.

    Mesh forces, deflections and laws remain in ``m.w``; ``free`` as for ``forces``.
    """
    bound = take(m.r.progress, BOUND_LOW), take(m.r.progress, BOUND_HIGH)
    at = least(most(take(m.r.progress, NOW), bound[0]), bound[1])
    for k in range(y.shape[0]):
        give(m.r.z, k, take(y, k) * take(m.unit, k))
    give(m.now, PHASE, take(m.r.progress, CYCLE) * TWO_PI + at)
    if m.singly:
        tell_singly(m)
    nominal(m, at)
    forces(m, free)
    accelerate(m, at, dy)
    drive(m, dy[m.n_state :])
    per_second = take(m.scalars, SI + FREQUENCY_N)
    for k in range(m.n_state, y.shape[0]):
        give(dy, k, take(dy, k) / (per_second * take(m.unit, k)))


@called
def slope(m, y, dy, free):
    """``slope_of`` that is called, not inlined: less to compile where speed matters less."""
    slope_of(m, y, dy, free)
