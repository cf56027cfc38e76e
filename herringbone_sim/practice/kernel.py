"""Compiled right-hand side of the practice rig: Eqs. (12)-(16) and all effects."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.practice.rig_model import RigModel
from herringbone_sim.practice.shapes import (
    TWO_PI,
    compiled,
    damper,
    displaced,
    flank,
    random_function,
    rub,
    spring,
)

CYCLES_PER_TURN = 27.0 * 77.0 / (27.0 + 77.0)  # mesh cycles per turn of the sun to ground
SHOCK_PEAK = 0.4**2 * 0.6**3  # largest value of z^2 (1 - z)^3


@compiled
def random_cause(
    p: RigModel,
    m: int,
    f: float,
    v: float,
    phase: float,
    t: float,
    own: float,
    force: Array,
    extra: Array,
    depth: Array,
) -> None:
    """Add the random function at mesh m to the quantity that it changes, in place.

    ``depth[12 + m]`` gets the input of the memory state. Displacements are added in ``forces``.
    """
    load = depth[m]
    followed = p.random.own_input
    depth[12 + m] = f * 1e5 if followed == 0 else (v * 2.0 if followed == 1 else load * 1e-4)
    if p.random.size[m] == 0.0 or p.random.target == 4:
        return
    by = p.random.size[m] * random_function(p, f, v, load, phase, t, own)[0]
    if p.random.target == 1:
        depth[m] *= 1.0 + by
    elif p.random.target == 2:
        force[m] += p.damping[m] * by * v
    elif p.random.target == 3:
        force[m] += by
    elif p.random.target == 5:
        extra[p.random.body] += by


@compiled
def forces(
    p: RigModel, t: float, phase0: float, y: Array, force: Array, extra: Array, depth: Array
) -> None:
    """Compute mesh forces (12,) and additional forces on the coordinates (15,) [N], in place.

    Additional (``extra``) are all but mesh forces, T_1, T_2, K and the springs of moving parts.

    Args:
        t, phase0: time [s]; mesh phase [rad] at t = 0.
        y: (30,) or (42,): coordinates [m], their rates, memory states of the meshes.
        depth: (24,) output: spring forces [N], then inputs of the memory states.
    """
    n = p.mass.size
    phase = phase0 + p.omega * t
    cos0, sin0 = np.cos(phase), np.sin(phase)
    for k in range(n):
        extra[k] = 0.0
    for m in range(12):
        side, i = (m // 3) % 2, m % 3
        planet = 3 + 3 * side + i
        seat = 11 + i if p.free[11 + i] > 0.0 else (14 if side == 1 and p.free[14] > 0.0 else 2)
        if m < 6:
            x, v = y[side] - y[planet] - y[seat], y[n + side] - y[n + planet] - y[n + seat]
        else:
            x = y[planet] - y[seat] + y[9 + side]
            v = y[n + planet] - y[n + seat] + y[n + 9 + side]
        cos = cos0 * p.shift_cos[m] - sin0 * p.shift_sin[m]
        sin = sin0 * p.shift_cos[m] + cos0 * p.shift_sin[m]
        e, slope = displaced(p, m, phase, cos, sin)
        v = v * p.cos_beta - slope * p.omega
        own = y[2 * n + m] if y.size > 2 * n else 0.0
        if p.random.target == 4 and p.random.size[m] != 0.0:
            more, steep = random_function(p, 0.0, 0.0, 0.0, phase, t, 0.0)
            e -= p.random.size[m] * more
            v += p.random.size[m] * steep * p.omega
        f = flank(x * p.cos_beta - e, p.half_backlash[m], p.half_back[m], p.rounding[m])
        depth[m] = spring(p, m, f, phase, cos, sin, t)
        force[m] = damper(p, m, f, v)
        if p.random.target != 0:
            random_cause(p, m, f, v, phase, t, own, force, extra, depth)
        if p.hysteresis[m] != 0.0:
            depth[m] *= 1.0 + p.hysteresis[m] * np.tanh(v * np.sign(f) / 0.02)
        if p.c_square[m] != 0.0:
            force[m] += p.damping[m] * p.c_square[m] * abs(v) * v
        if p.film[m] != 0.0:
            gap = abs(abs(x * p.cos_beta - e) - p.half_backlash[m])
            force[m] += p.damping[m] * p.film[m] * np.exp(-gap / 4e-6) * v
    for m in range(12):
        other = m + 3 if (m // 3) % 2 == 0 else m - 3
        force[m] += depth[m] + p.cross[m] * depth[other]
        if p.friction[m] != 0.0:
            rub(p, m, force[m], phase, extra)
    if p.ripple.shape[1] > 0:
        turn = p.ripple_order * phase / CYCLES_PER_TURN
        for h in range(p.ripple.shape[1]):
            cos, sin = np.cos((h + 1) * turn), np.sin((h + 1) * turn)
            wave = p.drive * (p.ripple[0, h] * cos + p.ripple[1, h] * sin)
            extra[0] += wave
            extra[1] += wave
    if p.output[0] != 0.0:
        u = y[n + 2] / p.output[1]
        extra[2] -= p.output[0] * np.tanh(u) * (0.6 + 0.8 * np.exp(-u * u / 9.0))
    if p.shock[0] != 0.0:
        z = min((phase / TWO_PI) % p.shock[1] / p.shock[2], 1.0)
        extra[2] += p.shock[0] * z**2 * (1.0 - z) ** 3 / SHOCK_PEAK
    if p.gyro != 0.0:
        extra[0] += p.gyro * y[n + 3]
        extra[3] -= p.gyro * y[n]
    if p.bar != 0.0:
        twist = p.bar * (y[0] - y[1] + 1e-5)
        extra[0] -= twist
        extra[1] += twist
    if p.windage != 0.0:
        for k in range(3, 9):
            extra[k] -= p.windage * abs(y[n + k]) * y[n + k]


@compiled
def rate(
    p: RigModel,
    t: float,
    phase0: float,
    y: Array,
    dy: Array,
    force: Array,
    extra: Array,
    depth: Array,
) -> None:
    """Write dy/dt (30,) of Eqs. (12)-(14), or (42,) with memory states, to ``dy``."""
    n = p.mass.size
    forces(p, t, phase0, y, force, extra, depth)
    carrier = 0.0
    for k in range(n):
        dy[k] = y[n + k]
        dy[n + k] = extra[k]
    for side in range(2):
        dy[n + side] += p.drive
    for m in range(12):
        side, i = (m // 3) % 2, m % 3
        push = force[m] * p.cos_beta
        planet = 3 + 3 * side + i
        if m < 6:
            dy[n + side] -= push
            dy[n + planet] += push
        else:
            dy[n + planet] -= push
            dy[n + 9 + side] -= push
        if p.free[11 + i] > 0.0:
            dy[n + 11 + i] += push
        elif side == 1 and p.free[14] > 0.0:
            dy[n + 14] += push
        else:
            carrier += push
    for side in range(2):
        u, w = y[9 + side], y[n + 9 + side]
        hold = p.ring[0] * u * (1.0 + p.ring[2] * u * u)
        dy[n + 9 + side] -= hold + p.ring[1] * w * (1.0 + p.ring[3] * abs(w))
    for i in range(3):
        if p.free[11 + i] > 0.0:
            give = flank(y[11 + i] - y[2], p.support[0], p.support[0], p.support[3])
            hold = p.support[1] * give * (1.0 + p.support[4] * give * give)
            loaded = abs(y[11 + i] - y[2]) > p.support[0]
            damper = p.support[2] * (1.0 if loaded else p.support[5])
            hold += damper * (y[n + 11 + i] - y[n + 2])
            dy[n + 11 + i] -= hold
            carrier += hold
    if p.free[14] > 0.0:
        hold = p.plate[0] * (y[14] - y[2]) + p.plate[1] * (y[n + 14] - y[n + 2])
        dy[n + 14] -= hold
        carrier += hold
    dy[n + 2] += carrier - p.brake + p.control * np.cos(phase0 + p.omega * t)
    for k in range(n):
        dy[k] *= p.free[k]
        dy[n + k] *= p.free[k] / p.mass[k]
    for m in range(y.size - 2 * n):
        dy[2 * n + m] = p.random.own_rate * (depth[12 + m] - y[2 * n + m])
