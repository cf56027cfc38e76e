"""The compiled kernel: Taylor steps of any order with located switching of contact, and RK4.

Between two switches of contact the model is linear with periodic coefficients, so the Taylor
series of the motion follows from a short recurrence: the stiffness series times the deflection
series (a Cauchy product per mesh), then Newton's law. The series is dense output at no cost: a
switch is a root of one of its polynomials, and the step goes on from there. Kinks are never
stepped over, so the order holds (measured in ``test/test_integrate.py``).

All is dimensionless (Eq. 17). ``y (n_state,)`` holds displacements then velocities as
``layout.Layout.state_names`` says. Left and right see the same operations in the same order, or
rounding breaks their symmetry in a chaotic transient; no fused or reordered arithmetic therefore.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAX_SUBSTEPS = 400
TWO_PI = 2.0 * np.pi


class Packed(NamedTuple):
    """The model as the kernel reads it; n = n_mesh, c = n_classes, all dimensionless.

    Attributes:
        classes: c zeros: a tuple's length is part of its type, so loops over c are unrolled.
        multiplicity: planets that one class stands for.
        stiffness: (n,) mean mesh stiffness times the projection over omega_n^2 [kg].
        damping: (n,) mesh damping times the projection over omega_n [kg].
        k_cos: (h, n) cosine amplitudes of the harmonics of k (Eq. 7), as stiffness.
        k_sin: (h, n) sine amplitudes.
        e_mean: (n,) mean error (Eq. 9).
        e_cos: (g, n) cosine amplitudes of the harmonics of e.
        e_sin: (g, n) sine amplitudes.
        b: (n,) half-backlash b' in force (Eq. 3).
        inv_M_s: (2,) of the sun halves [1/kg].
        inv_M_p: (2, c) of the planet halves [1/kg].
        inv_M_c: of the carrier [1/kg].
        load_q: (2,) constant acceleration of q_S by T_1 and T_2.
        load_r: constant acceleration of r by T_2.
        control_q: (2,) share of K cos(...) taken off the acceleration of q_S.
        control_r: (2,) share taken off the acceleration of r_S.
        control_order: control frequency over mesh frequency.
        control_phase: rad.
        K: control amplitude.
        Omega: mesh frequency over omega_n.
    """

    classes: tuple[int, ...]
    multiplicity: float
    stiffness: Array
    damping: Array
    k_cos: Array
    k_sin: Array
    e_mean: Array
    e_cos: Array
    e_sin: Array
    b: Array
    inv_M_s: Array
    inv_M_p: Array
    inv_M_c: float
    load_q: Array
    load_r: float
    control_q: Array
    control_r: Array
    control_order: float
    control_phase: float
    K: float
    Omega: float


class Work(NamedTuple):
    """Scratch of one integration, made once outside the loop; p = order, n, m = coordinates."""

    k: Array  # (p + 1, n) series of the stiffness
    error: Array  # (p + 1, n) series of e, taken off G q to get the deflection
    error_rate: Array  # (n,) de/dtau at one phase
    cos: Array  # (p + 1,) series of one harmonic
    sin: Array  # (p + 1,)
    inverse: Array  # (p + 2,) 1 / i
    load: Array  # (p + 1, m) series of the outer acceleration
    none_n: Array  # (p + 1, n) zeros
    none_m: Array  # (p + 1, m) zeros
    q: Array  # (p + 1, m) series of the displacements
    v: Array  # (p + 1, m) series of the velocities
    x: Array  # (p + 1, n) series of the deflections
    f: Array  # (p + 1, n) the same where in contact, else 0
    contact: Array  # (n,) -1 back, 0 separated, 1 drive
    now: Array  # (n,) contact during the step, when ``contact`` has switched already
    next: Array  # (n,) contact after the switch
    at: Array  # (n,) where in the step a mesh switches, 2 when it does not
    end: Array  # (n,) deflection at the end of the step
    end_slope: Array  # (n,) its rate
    closed: Array  # (n,) 1 in contact, 0 separated
    force: Array  # (n,) one order of the mesh forces
    rate: Array  # (4, n_state) stages of RK4
    stage: Array  # (n_state,)


def make_work(n_mesh: int, n_coordinate: int, order: int) -> Work:
    """Scratch for ``advance`` (order is that of the Taylor series; RK4 takes any)."""
    p = order + 1

    def zeros(*shape: int) -> Array:
        return np.zeros(shape)

    return Work(
        k=zeros(p, n_mesh),
        error=zeros(p, n_mesh),
        error_rate=zeros(n_mesh),
        cos=zeros(p),
        sin=zeros(p),
        inverse=1.0 / np.maximum(np.arange(p + 1.0), 1.0),
        load=zeros(p, n_coordinate),
        none_n=zeros(p, n_mesh),
        none_m=zeros(p, n_coordinate),
        q=zeros(p, n_coordinate),
        v=zeros(p, n_coordinate),
        x=zeros(p, n_mesh),
        f=zeros(p, n_mesh),
        contact=zeros(n_mesh),
        now=zeros(n_mesh),
        next=zeros(n_mesh),
        at=zeros(n_mesh),
        end=zeros(n_mesh),
        end_slope=zeros(n_mesh),
        closed=zeros(n_mesh),
        force=zeros(n_mesh),
        rate=zeros(4, 2 * n_coordinate),
        stage=zeros(2 * n_coordinate),
    )


compiled: Any = njit(cache=True, nogil=True, error_model="numpy")
inlined: Any = njit(cache=True, nogil=True, error_model="numpy", forceinline=True)


@inlined
def deflections(p, coordinate, x):  # type: ignore[no-untyped-def]
    """x = G q of Eqs. (15), (16), without the errors: sun meshes q - r, ring meshes r."""
    c = len(p.classes)
    for side in range(2):
        for i in range(c):
            m = side * c + i
            x[m] = coordinate[side] - coordinate[2 + m]
            x[2 * c + m] = coordinate[2 + m]


@inlined
def accelerate(p, force, acceleration):  # type: ignore[no-untyped-def]
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
def expand_excitation(p, w, phase, cycle, h):  # type: ignore[no-untyped-def]
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
    harmonics = max(p.k_cos.shape[0], p.e_cos.shape[0])
    for j in range(harmonics):
        expand_harmonic(w, (j + 1) * phase, (j + 1) * p.Omega * h)
        for four in range(len(p.classes)):
            if j < p.k_cos.shape[0]:
                add_harmonic(w, w.k, p.k_cos[j], p.k_sin[j], 4 * four)
            if j < p.e_cos.shape[0]:
                add_harmonic(w, w.error, p.e_cos[j], p.e_sin[j], 4 * four)
    expand_load(p, w, phase, cycle, h)


@inlined
def expand_harmonic(w, angle, turn):  # type: ignore[no-untyped-def]
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
def add_harmonic(w, out, in_cos, in_sin, m):  # type: ignore[no-untyped-def]
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
def expand_load(p, w, phase, cycle, h):  # type: ignore[no-untyped-def]
    """Series of the torques and of the control K cos(order * phase + control_phase), Eq. (20)."""
    order = w.load.shape[0] - 1
    c = len(p.classes)
    if p.K != 0.0:
        turns = p.control_order * cycle
        angle = TWO_PI * (turns - np.floor(turns)) + p.control_order * phase + p.control_phase
        expand_harmonic(w, angle, p.control_order * p.Omega * h)
        for i in range(order + 1):
            control = p.K * w.cos[i]
            for side in range(2):
                w.load[i, side] = -control * p.control_q[side]
                for k in range(c):
                    w.load[i, 2 + side * c + k] = -control * p.control_r[side]
    else:
        for i in range(order + 1):
            for k in range(2 + 2 * c):
                w.load[i, k] = 0.0
    for side in range(2):
        w.load[0, side] += p.load_q[side]
        for k in range(c):
            w.load[0, 2 + side * c + k] += p.load_r


@inlined
def cauchy(w, i, m):  # type: ignore[no-untyped-def]
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
def expand_motion(p, w, y, h, error, load, border):  # type: ignore[no-untyped-def]
    """Series of the motion over one step in the contact state ``w.contact``.

    The same recurrence serves the motion (all inputs) and a tangent vector (zero inputs,
    border 0): the tangent of a motion that is linear between switches is the linear part.
    """
    order = w.k.shape[0] - 1
    c = len(p.classes)
    n = 4 * c
    m_coordinate = 2 + 2 * c
    for k in range(m_coordinate):
        w.q[0, k] = y[k]
        w.v[0, k] = y[m_coordinate + k]
    for m in range(n):
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
        for m in range(n):
            w.force[m] *= p.damping[m]
            w.f[i, m] = w.closed[m] * w.x[i, m]
        if i == 0:
            for m in range(n):
                w.f[0, m] -= w.contact[m] * border * p.b[m]
        for four in range(c):
            cauchy(w, i, 4 * four)
        for k in range(m_coordinate):
            w.v[i + 1, k] = load[i, k]
        accelerate(p, w.force, w.v[i + 1])
        scale = h * w.inverse[i + 1]
        for k in range(m_coordinate):
            w.v[i + 1, k] *= scale
            w.q[i + 1, k] = w.v[i, k] * scale
    for side in range(2):
        for k in range(c):
            m = side * c + k
            r = w.q[order, 2 + m]
            w.x[order, m] = w.q[order, side] - r - error[order, m]
            w.x[order, n // 2 + m] = r - error[order, n // 2 + m]


@inlined
def polynomial(a, m, s):  # type: ignore[no-untyped-def]
    """Value at s of the series in column m."""
    value = a[a.shape[0] - 1, m]
    for i in range(a.shape[0] - 2, -1, -1):
        value = value * s + a[i, m]
    return value


@inlined
def value_and_slope(a, m, s):  # type: ignore[no-untyped-def]
    """Value and derivative at s of the series in column m."""
    value = a[a.shape[0] - 1, m]
    ds = 0.0
    for i in range(a.shape[0] - 2, -1, -1):
        ds = ds * s + value
        value = value * s + a[i, m]
    return value, ds


@inlined
def slope(a, m, s):  # type: ignore[no-untyped-def]
    """Derivative at s of the series in column m."""
    last = a.shape[0] - 1
    value = last * a[last, m]
    for i in range(last - 1, 0, -1):
        value = value * s + i * a[i, m]
    return value


@inlined
def curvature(a, m, s):  # type: ignore[no-untyped-def]
    """Second derivative at s of the series in column m."""
    last = a.shape[0] - 1
    value = last * (last - 1) * a[last, m]
    for i in range(last - 1, 1, -1):
        value = value * s + i * (i - 1) * a[i, m]
    return value


@compiled
def root(a, m, level, low, at_low, high, at_high):  # type: ignore[no-untyped-def]
    """Where the series in column m takes a level between low and high: Newton in a bracket."""
    below = at_low < 0.0
    s = low + (high - low) * at_low / (at_low - at_high) if at_low != at_high else low
    for _ in range(60):
        value, ds = value_and_slope(a, m, s)
        value -= level
        if (value < 0.0) == below:
            low = s
        else:
            high = s
        new = s - value / ds if ds != 0.0 else low
        if not low <= new <= high:
            new = 0.5 * (low + high)
        elif abs(new - s) < 1e-9:
            return new
        s = new
    return s


@compiled
def turning_point(a, m, low, high):  # type: ignore[no-untyped-def]
    """Where the series in column m stands still between low and high: Newton in a bracket."""
    falling = slope(a, m, low) < 0.0
    s = 0.5 * (low + high)
    for _ in range(60):
        value = slope(a, m, s)
        if (value < 0.0) == falling:
            low = s
        else:
            high = s
        dd = curvature(a, m, s)
        new = s - value / dd if dd != 0.0 else low
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - s) < 1e-12:
            return new
        s = new
    return s


@inlined
def leaves_at(a, m, level, sign, end, end_slope, before):  # type: ignore[no-untyped-def]
    """First s in [0, 1] at which sign * (x - level) turns negative; 2 when it does not.

    A step is short against the fastest oscillation, so x has at most one turning point in it.
    A crossing known to lie after ``before`` may be left out (then 2): another switch comes first.
    """
    start = sign * (a[0, m] - level)
    start_slope = sign * a[1, m]
    stop = sign * (end - level)
    stop_slope = sign * end_slope
    if stop < 0.0:
        if start > 0.0:
            if before < 1.0 and sign * (polynomial(a, m, before) - level) > 1e-12:
                return 2.0
            return root(a, m, level, 0.0, a[0, m] - level, 1.0, end - level)
        if start_slope <= 0.0:
            return 0.0
        top = turning_point(a, m, 0.0, 1.0)
        at_top = polynomial(a, m, top) - level
        if sign * at_top <= 0.0:
            return 0.0
        return root(a, m, level, top, at_top, 1.0, end - level)
    if start_slope < 0.0 and stop_slope > 0.0:
        corner = (stop - stop_slope - start) / (start_slope - stop_slope)
        if start + start_slope * corner < 0.1 * (stop_slope - start_slope):
            bottom = turning_point(a, m, 0.0, 1.0)
            at_bottom = polynomial(a, m, bottom) - level
            if sign * at_bottom < 0.0:
                if start <= 0.0:
                    return 0.0
                return root(a, m, level, 0.0, a[0, m] - level, bottom, at_bottom)
    return 2.0


@inlined
def set_contact(p, w, y):  # type: ignore[no-untyped-def]
    """Contact of every mesh (Eqs. 1, 4) from the state and ``w.error``."""
    deflections(p, y[: 2 + 2 * len(p.classes)], w.end)
    for m in range(4 * len(p.classes)):
        x = w.end[m] - w.error[0, m]
        w.contact[m] = 1.0 if x > p.b[m] else (-1.0 if x < -p.b[m] else 0.0)


@inlined
def next_switch(p, w):  # type: ignore[no-untyped-def]
    """First switching within the step, s = 2 when there is none; new contacts in ``w.contact``.

    All meshes that switch at that very s switch together: identical halves and planets do.
    """
    n = 4 * len(p.classes)
    for m in range(n):
        w.end[m] = w.x[0, m]
        w.end_slope[m] = 0.0
    for i in range(1, w.x.shape[0]):
        for m in range(n):
            w.end[m] += w.x[i, m]
            w.end_slope[m] += i * w.x[i, m]
    first = 2.0
    for m in range(n):
        side = w.contact[m]
        end = w.end[m]
        end_slope = w.end_slope[m]
        w.next[m] = 0.0
        if side != 0.0:
            w.at[m] = leaves_at(w.x, m, side * p.b[m], side, end, end_slope, first)
        else:
            up = leaves_at(w.x, m, p.b[m], -1.0, end, end_slope, first)
            down = leaves_at(w.x, m, -p.b[m], 1.0, end, end_slope, first)
            w.at[m] = min(up, down)
            w.next[m] = 1.0 if up < down else -1.0
        first = min(first, w.at[m])
    if first < 1.0:
        for m in range(n):
            if w.at[m] == first:
                w.contact[m] = w.next[m]
    return first


@inlined
def take_state(w, y, s):  # type: ignore[no-untyped-def]
    """State of the series at s into y."""
    m = w.q.shape[1]
    for k in range(m):
        y[k] = polynomial(w.q, k, s)
        y[m + k] = polynomial(w.v, k, s)


@inlined
def take_end(w, y):  # type: ignore[no-untyped-def]
    """State at the end of the step into y."""
    m = w.q.shape[1]
    last = w.q.shape[0] - 1
    for k in range(m):
        y[k] = w.q[last, k]
        y[m + k] = w.v[last, k]
    for i in range(last - 1, -1, -1):
        for k in range(m):
            y[k] += w.q[i, k]
            y[m + k] += w.v[i, k]


@compiled
def taylor_step(p, w, y, tangents, phase, cycle, h):  # type: ignore[no-untyped-def]
    """Advance y, and tangents (k, n_state) if any, by h; returns the switches passed.

    At a switch the force is continuous in the displacement, so the saltation matrix is the
    identity: tangents go through unchanged and see the new stiffness from there on.
    """
    left = h
    at = phase
    switches = 0
    while True:
        expand_excitation(p, w, at, cycle, left)
        if switches == 0:
            set_contact(p, w, y)
        expand_motion(p, w, y, left, w.error, w.load, 1.0)
        for m in range(4 * len(p.classes)):
            w.now[m] = w.contact[m]
        s = next_switch(p, w) if switches < MAX_SUBSTEPS else 2.0
        if s >= 1.0:
            take_end(w, y)
            move_tangents(p, w, tangents, left, 1.0)
            return switches
        take_state(w, y, s)
        move_tangents(p, w, tangents, left, s)
        at += p.Omega * left * s
        left -= left * s
        switches += 1


@compiled
def move_tangents(p, w, tangents, h, s):  # type: ignore[no-untyped-def]
    """Advance tangent vectors by s * h with the series of the step just taken."""
    if tangents.shape[0] == 0:
        return
    for m in range(4 * len(p.classes)):
        w.contact[m], w.now[m] = w.now[m], w.contact[m]
    for k in range(tangents.shape[0]):
        expand_motion(p, w, tangents[k], h, w.none_n, w.none_m, 0.0)
        take_state(w, tangents[k], s)
    for m in range(4 * len(p.classes)):
        w.contact[m], w.now[m] = w.now[m], w.contact[m]


@inlined
def excite(p, w, phase):  # type: ignore[no-untyped-def]
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
def mesh_forces(p, w, y, phase):  # type: ignore[no-untyped-def]
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
def right_hand_side(p, w, y, phase, cycle, dy):  # type: ignore[no-untyped-def]
    """dy/dtau of Eqs. (18), (22) at a phase; the kinks of f are in it."""
    m_coordinate = 2 + 2 * len(p.classes)
    mesh_forces(p, w, y, phase)
    turns = p.control_order * cycle
    angle = TWO_PI * (turns - np.floor(turns)) + p.control_order * phase + p.control_phase
    control = p.K * np.cos(angle)
    for k in range(m_coordinate):
        dy[k] = y[m_coordinate + k]
    for side in range(2):
        dy[m_coordinate + side] = p.load_q[side] - control * p.control_q[side]
        for i in range(len(p.classes)):
            k = m_coordinate + 2 + side * len(p.classes) + i
            dy[k] = p.load_r - control * p.control_r[side]
    accelerate(p, w.force, dy[m_coordinate:])


@compiled
def rk4_step(p, w, y, phase, cycle, h):  # type: ignore[no-untyped-def]
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
