"""The practice rig's own right-hand side, compiled: Eqs. (12)-(16) and every effect it can have.

Nothing here is shared with the simulator's kernel: absolute coordinates in SI units. The numbers
in the shapes are chosen to differ from what a textbook would write.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from herringbone_sim.core.cache import forget_stale
from herringbone_sim.core.numba_private import COMPILED
from herringbone_sim.practice.machine import Array, Machine

TWO_PI = 2.0 * np.pi
CYCLES_PER_TURN = 27.0 * 77.0 / (27.0 + 77.0)  # mesh cycles a turn of the sun to ground
SECOND_TOUCHES = 8e-6  # deflection [m] at which a second pair touches
forget_stale(Path(__file__).parent, Path(__file__).parent)

# As in core.packed: no reference counting, all scratch comes from outside.
compiled: Any = njit(cache=True, **COMPILED)


def _crack_shape(z: float, skew: float) -> float:
    """Raised cosine over z in 0..1, its peak moved by ``skew``; 0 outside."""
    if z <= 0.0 or z >= 1.0:
        return 0.0
    value: float = 0.5 * (1.0 - np.cos(TWO_PI * z**skew))
    return value


def _spall_shape(z: float, skew: float) -> tuple[float, float]:
    """z^2 (1 - z)^q with peak 1, q = 2 + skew, and its slope; 0 outside 0..1."""
    if z <= 0.0 or z >= 1.0:
        return 0.0, 0.0
    q = 2.0 + skew
    top = 2.0 / (2.0 + q)
    peak = top**2 * (1.0 - top) ** q
    value = z**2 * (1.0 - z) ** q / peak
    slope = (2.0 * z * (1.0 - z) ** q - q * z**2 * (1.0 - z) ** (q - 1.0)) / peak
    return value, slope


crack_shape: Any = compiled(_crack_shape)
spall_shape: Any = compiled(_spall_shape)


def _displaced(p: Machine, m: int, phase: float, cos: float, sin: float) -> tuple[float, float]:
    """What is taken off the deflection of mesh m [m], and its slope by phase [m/rad].

    That is e(t), less the displacements that no encoder sees, which add to the deflection.
    """
    value, slope = p.error[m] * sin - p.offset[m], p.error[m] * cos
    c, s = cos, sin
    for h in range(p.p_cos.shape[0]):
        a, b = p.p_cos[h, m], p.p_sin[h, m]
        if a != 0.0 or b != 0.0:
            value -= a * c + b * s
            slope -= (h + 1) * (b * c - a * s)
        c, s = c * cos - s * sin, s * cos + c * sin
    if p.runout[0, m] != 0.0:
        rate = 1.0 / p.runout[1, m]
        first = phase * rate + p.runout[2, m]
        second = 2.0 * first + p.runout[4, m]
        value -= p.runout[0, m] * (np.cos(first) + p.runout[3, m] * np.cos(second))
        down = np.sin(first) + 2.0 * p.runout[3, m] * np.sin(second)
        slope += p.runout[0, m] * rate * down
    if p.event[5, m] != 0.0:
        z = ((phase / TWO_PI - p.event[1, m]) % p.event[0, m]) / p.event[2, m]
        bump, steep = spall_shape(z, p.event[3, m])
        value -= p.event[5, m] * bump
        slope -= p.event[5, m] * steep / (TWO_PI * p.event[2, m])
    return value, slope


displaced: Any = compiled(_displaced)


def _flank(x: float, b: float, rounding: float) -> float:
    """Backlash function of Eq. (1), its corners rounded over a width [m]."""
    if rounding == 0.0:
        return x - b if x > b else (x + b if x < -b else 0.0)
    drive: float = x - b + np.sqrt((x - b) ** 2 + rounding**2)
    back: float = -x - b + np.sqrt((x + b) ** 2 + rounding**2)
    return 0.5 * (drive - back)


flank: Any = compiled(_flank)


def _spring(p: Machine, m: int, f: float, phase: float, cos: float, sin: float, t: float) -> float:
    """Spring force [N] of mesh m at the deflection f [m]."""
    if p.phase_by_load[m] != 0.0:
        turn = p.phase_by_load[m] * np.tanh(abs(f) / 1e-5)
        cos, sin = cos * np.cos(turn) - sin * np.sin(turn), sin * np.cos(turn) + cos * np.sin(turn)
    share, c, s = 1.0, cos, sin
    for h in range(p.k_cos.shape[0]):
        share += p.k_cos[h, m] * c + p.k_sin[h, m] * s
        c, s = c * cos - s * sin, s * cos + c * sin
    if p.k_half[m] != 0.0:
        share += p.k_half[m] * np.cos(0.5 * phase)
    if p.k_turn[m] != 0.0:
        share += p.k_turn[m] * np.cos(phase / 27.0)
    if p.k_second[m] != 0.0 and abs(f) > SECOND_TOUCHES:
        share += p.k_second[m] * (1.0 - SECOND_TOUCHES / abs(f))
    if p.k_drift[m] != 0.0:
        share *= 1.0 + p.k_drift[m] * (t / p.span) ** 1.5
    if p.event[4, m] != 0.0:
        z = ((phase / TWO_PI - p.event[1, m]) % p.event[0, m]) / p.event[2, m]
        share *= 1.0 - p.event[4, m] * crack_shape(z, p.event[3, m])
    if p.hertz[m] != 1.0:
        share *= ((f * f + 1e-14) / 1e-10) ** (0.5 * (p.hertz[m] - 1.0))
    force: float = p.stiffness[m] * share * f
    return force


spring: Any = compiled(_spring)


def _damper(p: Machine, m: int, f: float, v: float) -> float:
    """Damping force [N], a share of which lives by contact or by load."""
    if p.c_share[m] == 0.0:
        return float(p.damping[m] * v)
    depth = abs(f)
    contact = depth / (depth + 2e-7)
    load = 2.0 * np.tanh(depth / 2e-5)
    lives = (1.0 - p.c_load) * contact + p.c_load * load
    return float(p.damping[m] * (1.0 - p.c_share[m] * (1.0 - lives)) * v)


damper: Any = compiled(_damper)


def _rub(p: Machine, m: int, force: float, phase: float, extra: Array) -> None:
    """Sliding friction of mesh m onto the bodies (coordinates of ``extra``) [N]."""
    s = np.sin(phase - p.pitch) + 0.2 * np.sin(2.0 * (phase - p.pitch))
    stribeck = 0.8 + 0.35 * np.exp(-abs(s) / 0.25)
    rub = p.friction[m] * abs(force) * stribeck * np.tanh(s / 0.12) * p.cos_beta
    kind, side, i = m // 6, (m // 3) % 2, m % 3
    walk = 0.12 * s
    planet = 3 + 3 * side + i
    if kind == 0:
        extra[side] -= rub * (0.378 + walk)
        extra[planet] += rub * (0.378 - walk)
        extra[2] += rub * 0.378
    else:
        extra[planet] -= rub * (0.378 + walk)
        extra[2] += rub * (0.378 + 0.4 * walk)


rub: Any = compiled(_rub)


def _forces(
    p: Machine, t: float, phase0: float, y: Array, force: Array, extra: Array, depth: Array
) -> None:
    """Mesh forces (12,) [N], and what else acts on the coordinates (15,) [N] but T_1, T_2, K.

    Args:
        y: (30,) coordinates [m], then their rates.
        depth: (12,) left with the springs' forces [N].
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
        f = flank(x * p.cos_beta - e, p.half_backlash[m], p.rounding[m])
        depth[m] = spring(p, m, f, phase, cos, sin, t)
        force[m] = damper(p, m, f, v)
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
    if p.ripple[0] != 0.0:
        turn = p.ripple[1] * phase / CYCLES_PER_TURN + p.ripple[2]
        wave = p.ripple[0] * p.drive * (np.cos(turn) + p.ripple[3] * np.cos(2.0 * turn + 0.7))
        extra[0] += wave
        extra[1] += wave
    if p.output[0] != 0.0:
        u = y[n + 2] / p.output[1]
        extra[2] -= p.output[0] * np.tanh(u) * (0.6 + 0.8 * np.exp(-u * u / 9.0))
    if p.shock[0] != 0.0:
        z = (phase / TWO_PI) % p.shock[1] / p.shock[2]
        extra[2] += p.shock[0] * spall_shape(z, 1.0)[0]
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


forces: Any = compiled(_forces)


def _seat(y: float, clearance: float) -> float:
    """Deflection of a support with play, its ends rounded over a tenth of the play."""
    return float(flank(y, clearance, 0.1 * clearance))


seat_deflection: Any = compiled(_seat)


def _rate(
    p: Machine,
    t: float,
    phase0: float,
    y: Array,
    dy: Array,
    force: Array,
    extra: Array,
    depth: Array,
) -> None:
    """dy/dt (30,) of Eqs. (12)-(14) with whatever coordinates are free."""
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
        dy[n + 9 + side] -= p.ring[0] * y[9 + side] + p.ring[1] * y[n + 9 + side]
    for i in range(3):
        if p.free[11 + i] > 0.0:
            give = seat_deflection(y[11 + i] - y[2], p.support[0])
            hold = p.support[1] * give + p.support[2] * (y[n + 11 + i] - y[n + 2])
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


rate: Any = compiled(_rate)
