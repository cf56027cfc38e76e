"""Signatures of the compiled laws of effects, and functions that laws share; SI units.

An effect has up to three laws, each compiled by the decorator ``law`` and called for one instant
with all meshes. They work in place: excite changes ``law``, react changes ``force`` and
``torque``, drive writes ``slope``::

    excite(theta, site, gear, now, added_states, law)
    react(theta, site, gear, now, added_states, x, v, law, force, torque)
    drive(theta, site, gear, now, added_states, force, slope)

Arrays, with n = n_mesh in the order of ``core.layout``:

    theta (p,): parameter values, in the order of ``Effect.parameters``.
    site (rows, n): from ``Effect.place``; row 0 is 1 on the meshes of the locus, else 0.
    gear (rows, n): constants of the meshes without effects, see ``gear.gear_table``.
    now (5,): unwrapped mesh phase [rad], mesh frequency [rad/s], delta_T [K], T_1 [N m], K.
    added_states (s,): states of the effect, displacement and rate alternating; ``slope (s,)``:
        their rates.
    law (5, n): stiffness k [N/m], damping c [N s/m], half-backlash b [m], and a displacement
        d [m] with its rate d' [m/s]: the mesh force is k f(x + d) + c (v + d').
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
MEAN_K, NOMINAL_C, NOMINAL_B, MEAN_E, HARMONICS = range(5)

law: Any = njit(cache=True, **COMPILED)


@law
def harmonics_at(gear, m, phase, first):
    """Return the sum of the harmonics of mesh m, without effects, and its derivative by the phase.

    ``phase``: mesh phase [rad]; the derivative is per rad, not per second.
    ``first`` 0: of k [N/m], Eq. (7); 2: of e [m], Eq. (9); the mean is left out. From row
    ``HARMONICS`` on, ``gear`` has four rows per order: cosine and sine of k, then of e.
    """
    value, slope = 0.0, 0.0
    for j in range((gear.shape[0] - HARMONICS) // 4):
        angle = (j + 1) * phase
        row = HARMONICS + 4 * j + first
        value += gear[row, m] * np.cos(angle) + gear[row + 1, m] * np.sin(angle)
        slope += (j + 1) * (gear[row + 1, m] * np.cos(angle) - gear[row, m] * np.sin(angle))
    return value, slope


@law
def shift_phase(gear, now, m, angle, own_law):
    """Advance k and e of mesh m in ``own_law`` by an angle [rad], harmonic j by j angles."""
    phase = now[PHASE]
    ahead = phase + angle
    own_law[STIFFNESS, m] += (
        harmonics_at(gear, m, ahead, 0)[0] - harmonics_at(gear, m, phase, 0)[0]
    )
    e_ahead, slope_ahead = harmonics_at(gear, m, ahead, 2)
    e, slope = harmonics_at(gear, m, phase, 2)
    own_law[SHIFT, m] -= e_ahead - e
    own_law[SHIFT_RATE, m] -= now[FREQUENCY] * (slope_ahead - slope)


@law
def bent_temperature(delta_T, curvature):
    """Return delta_T [1 + curvature (delta_T / 50 K - 1)] [K], which is delta_T at 50 K."""
    return delta_T * (1.0 + curvature * (delta_T / 50.0 - 1.0))


@law
def cycles_from_event(now, period, late, position):
    """Return the mesh cycles since the middle of the nearest event, negative before it.

    Events lie at position + late and recur every ``period`` mesh cycles.
    """
    s = now[PHASE] / TWO_PI - position - late
    return s - period * np.floor(s / period + 0.5)


@law
def bump(s, width):
    """Return a raised cosine at s: 1 at s = 0, zero beyond +-width / 2."""
    return 0.5 + 0.5 * np.cos(TWO_PI * s / width) if abs(s) < 0.5 * width else 0.0


@law
def bump_slope(s, width):
    """Return the derivative of ``bump`` with respect to s."""
    inside = abs(s) < 0.5 * width
    return -0.5 * TWO_PI / width * np.sin(TWO_PI * s / width) if inside else 0.0


@law
def play(x, b):
    """Return the backlash function f(x) [m] for half-backlash b [m], Eqs. (1), (4)."""
    return x - b if x > b else (x + b if x < -b else 0.0)


@law
def no_excite(theta, site, gear, now, added_states, law):
    """Change nothing; the default ``Effect.excite``."""


@law
def no_react(theta, site, gear, now, added_states, x, v, law, force, torque):
    """Change nothing; the default ``Effect.react``."""


@law
def no_drive(theta, site, gear, now, added_states, force, slope):
    """Write nothing; the default ``Effect.drive``, of an effect without states."""
