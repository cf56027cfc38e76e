"""Taylor series of the excitation and of the motion over an interval in one contact state.

Between two switches of contact the model is linear with periodic coefficients, so the series
follows from a short recurrence: the stiffness series times the deflection series (a Cauchy product
per mesh), then Newton's law. Arguments: see ``lanes.packed``; ``interval_angle`` is an angle
per interval: of the mesh phase, in ``expand_scale`` and ``expand_control`` of a harmonic.

Over 300 lines: the series of the excitation and of the motion are one recurrence.
"""

from __future__ import annotations

from herringbone_sim.core.lanes.extended import (
    keep_forces,
    set_damping,
    shift_forces,
)
from herringbone_sim.core.lanes.packed import (
    ANGLE,
    BORDER,
    CARRIER,
    CONTACT,
    CONTROL_ORDER,
    CONTROL_Q,
    CONTROL_R,
    CYCLE,
    DAMP,
    DAMPING,
    E_COS,
    E_MEAN,
    E_SIN,
    EVENT_D,
    EVENT_K,
    HARMONICS,
    K_COS,
    K_SIN,
    LEFT,
    LOAD_COS,
    LOAD_ORDER,
    LOAD_Q,
    LOAD_R,
    LOAD_SIN,
    MOVE,
    OMEGA,
    ORDER,
    PERIOD,
    PHASE,
    PLANET,
    POSITION,
    ROWS_A_HARMONIC,
    STIFFNESS,
    SUN,
    WIDTH,
)
from herringbone_sim.core.lanes.rows import event_row, load_row
from herringbone_sim.core.lanes.vector import (
    absolute,
    bits,
    choose,
    fma,
    load,
    nearest,
    store,
    without,
)
from herringbone_sim.core.packed import TWO_PI, called, exposed, inlined

HALF_PI_HIGH, HALF_PI_LOW = 1.5707963267948966, 6.123233995736766e-17


@exposed
def sine_cosine(angle):
    """Return sine and cosine of angles [rad] up to some thousand, to the last bit or two."""
    quarter = nearest(angle * 0.6366197723675814)
    r = fma(quarter, -HALF_PI_HIGH, angle)
    r = fma(quarter, -HALF_PI_LOW, r)
    z = r * r
    s = fma(z, 1.58969099521155010221e-10, -2.50507602534068634195e-08)
    s = fma(s, z, 2.75573137070700676789e-06)
    s = fma(s, z, -1.98412698298579493134e-04)
    s = fma(s, z, 8.33333333332248946124e-03)
    s = fma(s, z, -1.66666666666666324348e-01)
    sine = fma(s * z, r, r)
    c = fma(z, -1.13596475577881948265e-11, 2.08757232129817482790e-09)
    c = fma(c, z, -2.75573143513906633035e-07)
    c = fma(c, z, 2.48015872894767294178e-05)
    c = fma(c, z, -1.38888888888741095749e-03)
    c = fma(c, z, 4.16666666666666019037e-02)
    cosine = fma(z * z, c, fma(z, -0.5, 1.0))
    turned = quarter - nearest(quarter * 0.25) * 4.0
    odd = absolute(turned) == 1.0
    first, second = choose(odd, cosine, sine), choose(odd, sine, cosine)
    back = absolute(turned) == 2.0
    minus_sine = (turned == -1.0) | back
    minus_cosine = (turned == 1.0) | back
    return choose(minus_sine, 0.0 - first, first), choose(minus_cosine, 0.0 - second, second)


@inlined
def expand_scale(w, interval_angle, inverse):
    """Write the coefficients interval_angle^i / i! into ``w.scale``."""
    scale = 1.0
    for i in range(w.scale.shape[0]):
        store(w.scale, i, 0, scale)
        scale = scale * interval_angle * inverse[i + 1]


@inlined
def add_harmonic(w, out, m, cosine, sine, fresh):
    """Add the series of cosine cos(A s) + sine sin(A s) to column m of ``out``.

    ``w.scale`` is that of the angle A per interval. If ``fresh``, ``out`` holds nothing above
    order 0.
    """
    for i in range(out.shape[0]):
        scale = load(w.scale, i, 0)
        if fresh and i > 0:
            store(out, i, m, scale * cosine)
        else:
            store(out, i, m, fma(scale, cosine, load(out, i, m)))
        cosine, sine = sine, 0.0 - cosine


@called
def expand_excitation(w, inverse, controlled):
    """Write the series of k (Eq. 7), e (Eq. 9) and, if ``controlled``, control and torques."""
    n = w.k.shape[1]
    for m in range(n):
        store(w.k, 0, m, load(w.constants, STIFFNESS, m))
        store(w.error, 0, m, load(w.constants, E_MEAN, m))
    interval_angle = load(w.constants, OMEGA, 0) * load(w.progress, LEFT, 0)
    for j in range(w.sizes[0]):
        row = HARMONICS + ROWS_A_HARMONIC * j
        order = load(w.constants, row + ORDER, 0)
        sine, cosine = sine_cosine(
            fma(order, load(w.progress, PHASE, 0), load(w.start_angles, j, 0))
        )
        expand_scale(w, interval_angle * order, inverse)
        for m in range(n):
            a, b = load(w.constants, row + K_COS, m), load(w.constants, row + K_SIN, m)
            c, d = load(w.constants, row + E_COS, m), load(w.constants, row + E_SIN, m)
            add_harmonic(w, w.k, m, a * cosine + b * sine, b * cosine - a * sine, j == 0)
            add_harmonic(w, w.error, m, c * cosine + d * sine, d * cosine - c * sine, j == 0)
    for j in range(w.sizes[2]):
        expand_event(w, event_row(w, j), interval_angle, inverse)
    if controlled:
        expand_control(w, inverse)
        for j in range(w.sizes[1]):
            expand_load(w, j, interval_angle, inverse)


@inlined
def cycles_from_event(w, row):
    """Return the mesh cycles since the middle of the nearest event, negative before it."""
    period = load(w.constants, row + PERIOD, 0)
    s = fma(load(w.progress, PHASE, 0), (1.0 / TWO_PI), load(w.progress, CYCLE, 0))
    s = s - load(w.constants, row + POSITION, 0)
    return s - period * nearest(s / period)


@called
def expand_event(w, row, interval_angle, inverse):
    """Apply an event to the series of k and e in the lanes whose interval lies in it."""
    width = load(w.constants, row + WIDTH, 0)
    s = cycles_from_event(w, row)
    middle = fma(interval_angle, (0.5 / TWO_PI), s)
    inside = absolute(middle) < width * 0.5
    if not bits(inside):
        return
    width = choose(inside, width, 1.0)
    height = choose(inside, 0.5, 0.0)
    sine, cosine = sine_cosine(choose(inside, s, 0.0) * TWO_PI / width)
    expand_scale(w, interval_angle / width, inverse)
    slope = 0.0 - sine
    for i in range(w.bump.shape[0]):
        store(w.bump, i, 0, height * load(w.scale, i, 0) * cosine)
        cosine, slope = slope, 0.0 - cosine
    store(w.bump, 0, 0, load(w.bump, 0, 0) + height)
    for m in range(w.k.shape[1]):
        share = load(w.constants, row + EVENT_K, m)
        displacement = load(w.constants, row + EVENT_D, m)
        some = bits(without(share == 0.0)) != 0
        for i in range(w.k.shape[0] - 1, -1, -1):
            if some:
                product = 0.0
                for j in range(i + 1):
                    product = fma(load(w.bump, i - j, 0), load(w.k, j, m), product)
                store(w.k, i, m, load(w.k, i, m) - share * product)
            error = load(w.error, i, m)
            store(w.error, i, m, error - displacement * load(w.bump, i, 0))


@called
def expand_load(w, j, interval_angle, inverse):
    """Subtract the series of the accelerations by added torque j from ``w.load``."""
    row = load_row(w, j)
    order = load(w.constants, row + LOAD_ORDER, 0)
    angle = fma(order, load(w.progress, PHASE, 0), load(w.start_angles, w.sizes[0] + j, 0))
    sine, cosine = sine_cosine(angle)
    expand_scale(w, interval_angle * order, inverse)
    for k in range(w.load.shape[1]):
        a, b = load(w.constants, row + LOAD_COS, k), load(w.constants, row + LOAD_SIN, k)
        value, slope = a * cosine + b * sine, b * cosine - a * sine
        for i in range(w.load.shape[0]):
            store(w.load, i, k, load(w.load, i, k) - value * load(w.scale, i, 0))
            value, slope = slope, 0.0 - value


@inlined
def expand_control(w, inverse):
    """Write the series of K cos(order * phase + control_phase), Eq. (20), into ``w.load``."""
    order = load(w.constants, CONTROL_ORDER, 0)
    angle = fma(order, load(w.progress, PHASE, 0), load(w.progress, ANGLE, 0))
    interval_angle = order * load(w.constants, OMEGA, 0) * load(w.progress, LEFT, 0)
    sine, cosine = sine_cosine(angle)
    expand_scale(w, interval_angle, inverse)
    sides = w.q.shape[1] - w.sizes[4] - w.k.shape[1] // 2
    c = w.k.shape[1] // (2 * sides)
    slope = 0.0 - sine
    for i in range(w.load.shape[0]):
        control = load(w.scale, i, 0) * cosine
        for side in range(sides):
            store(w.load, i, side, control * load(w.constants, CONTROL_Q, side))
            for k in range(c):
                push = control * load(w.constants, CONTROL_R, side)
                store(w.load, i, sides + side * c + k, push)
        for k in range(w.q.shape[1] - w.sizes[4], w.q.shape[1]):
            store(w.load, i, k, 0.0)
        cosine, slope = slope, 0.0 - cosine


@inlined
def cauchy(w, i, m):
    """Add order i of the product k f to ``w.force`` of meshes m and m + 1, two sums in parallel.

    ``w.force`` holds one order of the forces at a time; ``w.k`` and ``w.f`` must be known to
    order i.
    """
    even, odd = load(w.force, 0, m), load(w.force, 0, m + 1)
    for j in range(i + 1):
        even = fma(load(w.k, i - j, m), load(w.f, j, m), even)
        odd = fma(load(w.k, i - j, m + 1), load(w.f, j, m + 1), odd)
    store(w.force, 0, m, even)
    store(w.force, 0, m + 1, odd)


@called
def expand_motion(unrolled, w, row, forced, coupled, controlled, inverse):
    """Compute the series of row ``row`` of ``w.y``, state or tangent vector, over the interval.

    An antisymmetric perturbation leaves the carrier at rest, so its halves are not ``coupled``.
    """
    sides, c = len(unrolled[0]), len(unrolled[1])
    half = sides * c
    last = w.k.shape[0] - 1
    step = load(w.progress, LEFT, 0)
    begin_series(unrolled, w, row)
    if len(unrolled[2]) > 0 and forced:
        set_damping(w)
    per_step = 1.0 / step
    for i in range(last):
        rate = per_step * float(i + 1)
        for side in range(sides):
            for k in range(c):
                a = side * c + k
                r, dr = load(w.q, i, sides + a), load(w.v, i, sides + a)
                x, v = load(w.q, i, side) - r, load(w.v, i, side) - dr
                if forced:
                    x = x - load(w.error, i, a)
                    v = v - rate * load(w.error, i + 1, a)
                    r = r - load(w.error, i, half + a)
                    dr = dr - rate * load(w.error, i + 1, half + a)
                place_mesh(unrolled, w, i, a, x, v, forced)
                place_mesh(unrolled, w, i, half + a, r, dr, forced)
        if len(unrolled[2]) > 0:
            shift_forces(w, i, forced, coupled)
        for two in range(half):
            cauchy(w, i, 2 * two)
        if len(unrolled[2]) > 0:
            keep_forces(w, i, forced, coupled)
        accelerate(unrolled, w, i, forced, coupled, controlled, step * inverse[i + 1])
    if forced:
        for side in range(sides):
            for k in range(c):
                a = side * c + k
                r = load(w.q, last, sides + a)
                store(w.x, last, a, load(w.q, last, side) - r - load(w.error, last, a))
                store(w.x, last, half + a, r - load(w.error, last, half + a))
        if len(unrolled[2]) > 0:
            shift_forces(w, last, True, coupled)
            for a in range(2 * half):
                store(w.forces, last, a, 0.0)


@inlined
def begin_series(unrolled, w, row):
    """Copy row ``row`` of ``w.y`` into order 0 of the series of displacements and velocities.

    Row 0 is the state, the others are tangent vectors; coordinates that effects add are included.
    """
    m = len(unrolled[0]) * (1 + len(unrolled[1]))
    for k in range(m):
        store(w.q, 0, k, load(w.y, row, k))
        store(w.v, 0, k, load(w.y, row, m + k))
    if len(unrolled[2]) > 0:
        s = w.sizes[4]
        for j in range(s):
            store(w.q, 0, m + j, load(w.y, row, 2 * m + j))
            store(w.v, 0, m + j, load(w.y, row, 2 * m + s + j))


@inlined
def place_mesh(unrolled, w, i, a, x, v, forced):
    """Store order i of x, f and the damping force of mesh a, from order i of x and its rate v."""
    contact = load(w.mesh_state, CONTACT, a)
    f = absolute(contact) * x
    if forced:
        store(w.x, i, a, x)
        if i == 0:
            f = f - contact * load(w.constants, BORDER, a)
    store(w.f, i, a, f)
    damping = (
        load(w.mesh_state, DAMP, a) if len(unrolled[2]) > 0 else load(w.constants, DAMPING, a)
    )
    store(w.force, 0, a, v * damping)


@inlined
def accelerate(unrolled, w, i, forced, coupled, controlled, scale):
    """Compute order i + 1 of the motion from order i of all forces (Eqs. 12-14, as 18).

    ``scale`` is the length of the interval over i + 1.
    """
    sides, c = len(unrolled[0]), len(unrolled[1])
    half = sides * c
    carrier = 0.0
    if coupled:
        total = 0.0
        for side in range(sides):
            all_of_side = 0.0
            for k in range(c):
                a = side * c + k
                all_of_side = all_of_side + (load(w.force, 0, a) + load(w.force, 0, half + a))
            total = total + all_of_side
        carrier = load(w.constants, CARRIER, 0) * total
    if len(unrolled[2]) > 0:
        carrier = carrier + load(w.push, 0, w.q.shape[1])
    for side in range(sides):
        sun = 0.0
        for k in range(c):
            sun = sun + load(w.force, 0, side * c + k)
        q = 0.0 - (load(w.constants, SUN, side) * sun + carrier * 2.0)
        if len(unrolled[2]) > 0:
            q = q + load(w.push, 0, side)
        advance(w, i, side, q, LOAD_Q, side, forced, controlled, scale)
        for k in range(c):
            a = side * c + k
            difference = load(w.force, 0, a) - load(w.force, 0, half + a)
            r = fma(difference, load(w.constants, PLANET, a), 0.0 - carrier)
            if len(unrolled[2]) > 0:
                r = r + load(w.push, 0, sides + a)
            advance(w, i, sides + a, r, LOAD_R, 0, forced, controlled, scale)
    if len(unrolled[2]) > 0:
        for k in range(sides + half, w.q.shape[1]):
            added = load(w.push, 0, k)
            if forced and controlled:
                added = added - load(w.load, i, k)
            store(w.v, i + 1, k, added * scale)
            store(w.q, i + 1, k, load(w.v, i, k) * scale)


@inlined
def advance(w, i, coordinate, acceleration, row, entry, forced, controlled, scale):
    """Compute order i + 1 of a coordinate from order i of its acceleration.

    ``row`` and ``entry`` are where the constants hold its constant acceleration.
    """
    if forced:
        if i == 0:
            acceleration = acceleration + load(w.constants, row, entry)
        if controlled:
            acceleration = acceleration - load(w.load, i, coordinate)
    store(w.v, i + 1, coordinate, acceleration * scale)
    store(w.q, i + 1, coordinate, load(w.v, i, coordinate) * scale)


@called
def take_state(unrolled, w, row):
    """Evaluate the series of motion at the end of each lane's move, into a row of ``w.y``.

    ``w.q`` and ``w.v`` must hold the series of this row. The row becomes displacements, then
    velocities of the gear, then both of the added coordinates, as ``begin_series`` reads them.

    Args:
        unrolled, w: see ``lanes.packed``.
        row: 0 the state, above it the tangent vectors.
    """
    move = load(w.progress, MOVE, 0)
    m = len(unrolled[0]) * (1 + len(unrolled[1]))
    s = w.sizes[4] if len(unrolled[2]) > 0 else 0
    last = w.q.shape[0] - 1
    for j in range(m + s):
        q, v = load(w.q, last, j), load(w.v, last, j)
        for i in range(last - 1, -1, -1):
            q = fma(q, move, load(w.q, i, j))
            v = fma(v, move, load(w.v, i, j))
        store(w.y, row, j if j < m else m + j, q)
        store(w.y, row, m + j if j < m else m + s + j, v)
