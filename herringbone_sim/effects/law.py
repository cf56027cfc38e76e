"""Arguments of the compiled laws of effects: one instant, all meshes, SI units.

An effect has up to three laws, each compiled by ``law``, with one of these signatures. They work
in place: excite changes ``law``, react changes ``force`` and ``torque``, drive writes ``slope``::

    excite(theta, site, gear, now, own, law)
    react(theta, site, gear, now, own, x, v, law, force, torque)
    drive(theta, site, gear, now, own, force, slope)

Arrays, with n = n_mesh in the order of ``core.layout``:

    theta (p,): parameters of the effect, in its order.
    site (rows, n): computed by its ``place``; row 0 is 1 on the meshes of the locus, else 0.
    gear (rows, n): constants of the meshes without effects, see below.
    now (5,): unwrapped mesh phase [rad], mesh frequency [rad/s], delta_T [K], T_1 [N m], K.
    own (s,): states of the effect, displacement and rate alternating; ``slope (s,)``: their rates.
    law (5, n): stiffness k [N/m], damping c [N s/m], half-backlash b [m], and a displacement
        d [m] with its rate [m/s] that are added to the deflection: F = k f(x + d) + c (v + d').
    x, v (n,): deflection [m] and its rate [m/s], d and its rate included.
    force (n,): mesh forces [N]. torque (n_bodies,): torque over base radius [N] on s_L, s_R, c,
        p1_L, ..., positive like the rotations u.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from herringbone_sim.core.numba_private import COMPILED
from herringbone_sim.core.packed import TWO_PI

STIFFNESS, DAMPING, PLAY, SHIFT, SHIFT_RATE = range(5)
PHASE, FREQUENCY, DELTA_T, TORQUE, CONTROL = range(5)
MEAN_K, OWN_C, OWN_B, MEAN_E, HARMONICS = range(5)

law: Any = njit(cache=True, **COMPILED)


@law
def stiffness_at(gear, m, phase):
    """k [N/m] of mesh m without effects at a phase [rad], Eq. (7).

    From row ``HARMONICS`` on, ``gear`` has four rows per order: cosine and sine of k, then of e.
    """
    k = gear[MEAN_K, m]
    for j in range((gear.shape[0] - HARMONICS) // 4):
        angle = (j + 1) * phase
        row = HARMONICS + 4 * j
        k += gear[row, m] * np.cos(angle) + gear[row + 1, m] * np.sin(angle)
    return k


@law
def error_at(gear, m, phase):
    """e [m] of mesh m without effects at a phase [rad], Eq. (9)."""
    e = gear[MEAN_E, m]
    for j in range((gear.shape[0] - HARMONICS) // 4):
        angle = (j + 1) * phase
        row = HARMONICS + 4 * j
        e += gear[row + 2, m] * np.cos(angle) + gear[row + 3, m] * np.sin(angle)
    return e


@law
def error_slope_at(gear, m, phase):
    """de/dphase [m/rad] of mesh m without effects at a phase [rad]."""
    slope = 0.0
    for j in range((gear.shape[0] - HARMONICS) // 4):
        angle = (j + 1) * phase
        row = HARMONICS + 4 * j
        rate = gear[row + 3, m] * np.cos(angle) - gear[row + 2, m] * np.sin(angle)
        slope += (j + 1) * rate
    return slope


@law
def shift_phase(gear, now, m, angle, own_law):
    """Advance k and e of mesh m by an angle [rad]: order j shifts by j times the angle."""
    phase = now[PHASE]
    ahead = phase + angle
    own_law[STIFFNESS, m] += stiffness_at(gear, m, ahead) - stiffness_at(gear, m, phase)
    own_law[SHIFT, m] -= error_at(gear, m, ahead) - error_at(gear, m, phase)
    slope = error_slope_at(gear, m, ahead) - error_slope_at(gear, m, phase)
    own_law[SHIFT_RATE, m] -= now[FREQUENCY] * slope


@law
def bent_temperature(delta_T, curvature):
    """delta_T [1 + curvature (delta_T / 50 K - 1)] [K]: that at 50 K, not in proportion to it."""
    return delta_T * (1.0 + curvature * (delta_T / 50.0 - 1.0))


@law
def cycles_from_event(now, period, late, position):
    """Mesh cycles from the nearest event, which recurs every ``period`` cycles from position +
    late.
    """
    s = now[PHASE] / TWO_PI - position - late
    return s - period * np.floor(s / period + 0.5)


@law
def bump(s, width):
    """Raised cosine of height 1 around s = 0, zero beyond width / 2; s and width in the same
    unit.
    """
    return 0.5 + 0.5 * np.cos(TWO_PI * s / width) if abs(s) < 0.5 * width else 0.0


@law
def bump_slope(s, width):
    """Derivative of ``bump`` with respect to s."""
    inside = abs(s) < 0.5 * width
    return -0.5 * TWO_PI / width * np.sin(TWO_PI * s / width) if inside else 0.0


@law
def play(x, b):
    """Backlash function f(x), Eqs. (1), (4)."""
    return x - b if x > b else (x + b if x < -b else 0.0)


@law
def no_excite(theta, site, gear, now, own, law):
    """Law without excitation."""


@law
def no_react(theta, site, gear, now, own, x, v, law, force, torque):
    """Law that changes no force."""


@law
def no_drive(theta, site, gear, now, own, force, slope):
    """Law without states."""
