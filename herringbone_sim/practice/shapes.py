"""Compiled functions of a mesh of the practice rig: displacement, backlash, spring, damper.

They share nothing with the kernel of ``core``: absolute coordinates in SI units.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from herringbone_sim.arrays import Array
from herringbone_sim.core.cache import forget_stale
from herringbone_sim.core.numba_private import COMPILED
from herringbone_sim.practice.rig_model import RigModel
from herringbone_sim.practice.tables import HALFWAY, LARGEST

TWO_PI = 2.0 * np.pi
SECOND_TOUCHES = 8e-6  # deflection [m] at which a second tooth pair comes into contact
forget_stale(Path(__file__).parent, Path(__file__).parent)

# As in core.packed: without reference counting, so callers allocate all arrays.
compiled: Any = njit(cache=True, **COMPILED)


@compiled
def read(table: Array, z: float) -> tuple[float, float]:
    """Return value and slope d/dz of a ``tables.table`` at z, clamped to 0..1."""
    cells = table.shape[1] - 1
    at = min(max(z, 0.0), 1.0) * cells
    i = min(int(at), cells - 1)
    u = at - i
    low, high = table[0, i], table[0, i + 1]
    p, q = table[1, i], table[1, i + 1]
    bend = p + q - 2.0 * (high - low)
    turn = 3.0 * (high - low) - 2.0 * p - q
    value = low + u * (p + u * (turn + u * bend))
    return value, cells * (p + u * (2.0 * turn + 3.0 * u * bend))


@compiled
def by_depth(table: Array, depth: float) -> float:
    """Return the value of a table at a deflection [m]."""
    value: float = read(table, depth / (depth + HALFWAY) / LARGEST)[0]
    return value


@compiled
def window(p: RigModel, m: int, phase: float) -> tuple[float, float]:
    """Return the strength of the tooth event of mesh m and its derivative by phase [1/rad].

    The strength is 0 outside of the event and 1 at its peak, whatever the size of the event.

    Args:
        phase: mesh phase [rad], counted on over all mesh cycles, not wrapped: an event recurs once
            a revolution, after ``p.event[0, m]`` mesh cycles.
    """
    z = ((phase / TWO_PI - p.event[1, m]) % p.event[0, m]) / p.event[2, m]
    if z >= 1.0:
        return 0.0, 0.0
    value, slope = read(p.window, z)
    return value, slope / (TWO_PI * p.event[2, m])


@compiled
def displaced(p: RigModel, m: int, phase: float, cos: float, sin: float) -> tuple[float, float]:
    """Return the displacement [m] subtracted from the deflection of mesh m, and its slope [m/rad].

    It is e(t) plus the displacements by effects, which encoders do not measure; the slope is by
    mesh phase. ``cos`` and ``sin`` are of the phase with the shift of the mesh.
    """
    value, slope = p.error[m] * sin + p.offset[m], p.error[m] * cos
    c, s = cos, sin
    for h in range(p.p_cos.shape[0]):
        a, b = p.p_cos[h, m], p.p_sin[h, m]
        value += a * c + b * s
        slope += (h + 1) * (b * c - a * s)
        c, s = c * cos - s * sin, s * cos + c * sin
    if p.turn_cos.shape[0] > 0:
        rate = 1.0 / p.turn_cycles[m]
        first, second = np.cos(phase * rate), np.sin(phase * rate)
        c, s = first, second
        for h in range(p.turn_cos.shape[0]):
            a, b = p.turn_cos[h, m], p.turn_sin[h, m]
            value += a * c + b * s
            slope += (h + 1) * rate * (b * c - a * s)
            c, s = c * first - s * second, s * first + c * second
    if p.event[4, m] != 0.0:
        bump, steep = window(p, m, phase)
        value += p.event[4, m] * bump
        slope += p.event[4, m] * steep
    return value, slope


@compiled
def flank(x: float, drive: float, back: float, rounding: float) -> float:
    """Return the backlash function, Eq. (1), of x [m], its corners rounded over a width [m]."""
    if rounding == 0.0:
        return x - drive if x > drive else (x + back if x < -back else 0.0)
    ahead: float = x - drive + np.sqrt((x - drive) ** 2 + rounding**2)
    behind: float = -x - back + np.sqrt((x + back) ** 2 + rounding**2)
    return 0.5 * (ahead - behind)


@compiled
def spring(p: RigModel, m: int, f: float, phase: float, cos: float, sin: float, t: float) -> float:
    """Return the spring force [N] of mesh m at the deflection f [m]."""
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
    if p.event[3, m] != 0.0:
        share *= 1.0 - p.event[3, m] * window(p, m, phase)[0]
    if p.hertz[m] != 1.0 and f != 0.0:
        share *= (abs(f) / 1e-5) ** (p.hertz[m] - 1.0)
    if p.bent[m] != 0.0:
        share *= by_depth(p.bend, abs(f))
    force: float = p.stiffness[m] * share * f
    return force


@compiled
def damper(p: RigModel, m: int, f: float, v: float) -> float:
    """Return the damping force [N] of mesh m at deflection f [m] and rate v [m/s]."""
    if p.c_share[m] == 0.0:
        return float(p.damping[m] * v)
    depth = abs(f)
    if depth == 0.0:
        lives = p.c_out
    elif p.c_curve.shape[1] > 0:
        lives = by_depth(p.c_curve, depth)
    else:
        lives = (depth / p.c_power[1]) ** p.c_power[0]
    return float(p.damping[m] * (1.0 - p.c_share[m] * (1.0 - lives)) * v)


@compiled
def random_function(
    p: RigModel,
    f: float,
    v: float,
    load: float,
    phase: float,
    t: float,
    own: float,
) -> tuple[float, float]:
    """Return the random function [-], before ``size``, and its slope by phase [1/rad].

    The slope is 0 unless the function is a displacement; then phase and time count.

    Args:
        f: deflection [m]; v: its rate [m/s].
        load: spring force [N].
        phase: mesh phase [rad], unwrapped.
        t: time [s].
        own: memory state [-].
    """
    q = p.random
    value, slope = -q.mean, 0.0
    turn, share = phase / q.cycles, t / p.span
    for h in range(q.heights.size):
        w = q.weights[h]
        at = w[0] * f * 1e5 + w[1] * v * 2.0 + w[2] * phase + w[3] * load * 1e-4
        at += w[4] * q.temperature + w[5] * turn + w[6] * share + w[7] * own + q.angles[h]
        value += q.heights[h] * np.cos(at)
        if q.target == 4:
            steep = w[2] + w[5] / q.cycles + w[6] / (p.omega * p.span)
            slope -= q.heights[h] * steep * np.sin(at)
    return value, slope


@compiled
def rub(p: RigModel, m: int, force: float, phase: float, extra: Array) -> None:
    """Add the sliding friction of mesh m to the forces ``extra`` on the coordinates, in place.

    It is the coefficient ``p.friction[m]`` times |force|, with the sign of sliding, or with the
    factor ``p.rub``; sliding changes sign once a mesh cycle, at ``p.pitch``. Lever arms over the
    base radius, of involute flanks: tan alpha_t and the distance from the pitch point.

    Args:
        force: mesh force [N]; its sign does not matter.
        phase: mesh phase [rad], need not be wrapped.
        extra: (15,) [N]: suns L and R, carrier, planets L, planets R, then moving parts.
    """
    turn = (phase - p.pitch) / TWO_PI
    s = turn - np.floor(turn + 0.5)
    way = np.sign(s) if p.rub.shape[1] == 0 else read(p.rub, s + 0.5)[0]
    rub = p.friction[m] * abs(force) * way * p.cos_beta
    kind, side, i = m // 6, (m // 3) % 2, m % 3
    planet = 3 + 3 * side + i
    tan, on_planet = 0.37864, s * TWO_PI / 25.0
    if kind == 0:
        extra[side] -= rub * (tan + s * TWO_PI / 27.0)
        extra[planet] += rub * (tan - on_planet)
        extra[2] += rub * tan
    else:
        extra[planet] -= rub * (tan + on_planet)
        extra[2] += rub * tan
