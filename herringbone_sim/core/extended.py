"""What effects add to the recurrences of a gear that stays linear between switches.

Friction on the flanks, further coordinates on seats of their own (a ring or pins that move), and
damping that hangs on contact; a gear without them, see ``Packed.extended``, compiles without it.
A seat is one more row like a mesh, of constant stiffness; see ``Packed.push`` for its forces.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.packed import TWO_PI, inlined
from herringbone_sim.core.right_hand_side import ON_EDGE, accelerate, pitch_side, turn_carrier


@inlined
def n_own(p):
    """How many further coordinates there are."""
    return p.seat.shape[0] if len(p.extended) > 0 else 0


@inlined
def up_to_pitch(p, w, phase, part):
    """A part of a step, or as much of it as lies before the flanks next change their slide."""
    if p.rubs.size > 0:
        half = phase / np.pi + 2.0 * ON_EDGE
        to_pitch = (np.floor(half) + 1.0 - phase / np.pi) * np.pi / p.Omega
        if to_pitch < part - TWO_PI * ON_EDGE / p.Omega:
            part = to_pitch
        set_pitch(p, w, phase, part)
    return part


@inlined
def set_pitch(p, w, phase, part):
    """Turn of the flanks from the pitch point at a phase, its side, and turn of the step."""
    turn = p.Omega * part / TWO_PI
    w.pitch[0], w.pitch[1] = pitch_side(phase, turn)
    w.pitch[2] = turn


@inlined
def set_seats(p, w, y):
    """Contact of the seats from the state; signs of the mesh forces are not known yet.

    Seats without play are always in contact.
    """
    n = 4 * len(p.classes)
    first = 4 + n
    for a in range(n):
        w.sign[a] = 0.0
    for j in range(n_own(p)):
        half = p.seat[j, 2]
        back = -1.0 if y[first + j] < -half else 0.0
        w.contact[n + j] = 1.0 if half == 0.0 or y[first + j] > half else back


@inlined
def shift_deflections(p, y, x):
    """Add what further coordinates displace the meshes by to deflections x."""
    n = 4 * len(p.classes)
    for j in range(n_own(p)):
        for a in range(n):
            x[a] += p.own_shift[j, a] * y[4 + n + j]


@inlined
def set_damping(p, w):
    """Damping and half of the play of meshes and seats in their present contact."""
    n = 4 * len(p.classes)
    for a in range(n):
        w.damping[a] = p.damping[a] * (1.0 - p.law[2, a] * (1.0 - abs(w.contact[a])))
        w.border[a] = p.b[a]
    for j in range(n_own(p)):
        w.damping[n + j] = p.seat[j, 1]
        w.border[n + j] = p.seat[j, 2]


@inlined
def shift_series(p, w, i, rate):
    """Order i of deflections and their rates: the parts of further coordinates, and the seats."""
    n = 4 * len(p.classes)
    m = 2 + 2 * len(p.classes)
    for j in range(n_own(p)):
        for a in range(n):
            w.x[i, a] += p.own_shift[j, a] * w.q[i, m + j]
            rate[a] += p.own_shift[j, a] * w.v[i, m + j]
        w.x[i, n + j] = w.q[i, m + j]
        rate[n + j] = w.v[i, m + j]


@inlined
def know_signs(p, w):
    """Signs of the forces, where not known yet, and the shares in which forces push."""
    for r in range(p.rubs.size):
        a = p.rubs[r]
        if w.sign[a] == 0.0:
            w.sign[a] = 1.0 if w.forces[0, a] >= 0.0 else -1.0
    for t in range(p.pairs.shape[0]):
        k, a = p.pairs[t, 0], p.pairs[t, 1]
        w.mix[0, t] = p.push[0, k, a]
        w.mix[1, t] = 0.0
        if a < w.sign.size:
            g = w.pitch[1] * w.sign[a]
            w.mix[0, t] += g * (p.push[1, k, a] + w.pitch[0] * p.push[2, k, a])
            w.mix[1, t] = g * w.pitch[2] * p.push[2, k, a]


@inlined
def push_series(p, w, i, acceleration):
    """Add order i of the accelerations of ``Packed.push`` from ``w.forces``."""
    n_all = 2 + 2 * len(p.classes) + n_own(p)
    carrier = 0.0
    for t in range(p.pairs.shape[0]):
        k, a = p.pairs[t, 0], p.pairs[t, 1]
        added = w.mix[0, t] * w.forces[i, a]
        if i > 0:
            added += w.mix[1, t] * w.forces[i - 1, a]
        if k < n_all:
            acceleration[k] += added
        else:
            carrier += added
    turn_carrier(p, carrier, acceleration)


@inlined
def set_jumps(p, w):
    """Jump of every mesh force at a switch of contact, over the rate of deflection.

    The sign of a force that jumps is that of the rate: into contact, or out of it.
    """
    for a in range(w.jump.size):
        w.jump[a] = 0.0
        if p.law[2, a] != 0.0:
            closes = abs(w.contact[a]) - abs(w.now[a])
            w.jump[a] = p.damping[a] * p.law[2, a] * closes
            if closes != 0.0:
                w.sign[a] = w.contact[a] - w.now[a]


@inlined
def jump_tangents(p, w, tangents, s):
    """Saltation of tangent vectors where a mesh force jumps at s: the other motion jumps later."""
    c = len(p.classes)
    n = 4 * c
    m = 2 + 2 * c
    own = n_own(p)
    for a in range(n):
        if w.jump[a] == 0.0:
            continue
        for b in range(n):
            w.force[b] = 0.0
        w.force[a] = w.jump[a]
        for k in range(m + own):
            w.push[k] = 0.0
        accelerate(p, w.force, w.push)
        carrier = 0.0
        for t in range(p.pairs.shape[0]):
            if p.pairs[t, 1] == a:
                k = p.pairs[t, 0]
                rub = p.push[1, k, a] + (w.pitch[0] + s * w.pitch[2]) * p.push[2, k, a]
                added = w.jump[a] * (p.push[0, k, a] + w.pitch[1] * w.sign[a] * rub)
                if k < m + own:
                    w.push[k] += added
                else:
                    carrier += added
        turn_carrier(p, carrier, w.push)
        side = (a // c) % 2
        for t in range(tangents.shape[0]):
            y = tangents[t]
            r = y[2 + side * c + a % c]
            x = y[side] - r if a < 2 * c else r
            for j in range(own):
                x += p.own_shift[j, a] * y[2 * m + j]
            for k in range(m):
                y[m + k] += w.push[k] * x
            for j in range(own):
                y[2 * m + own + j] += w.push[m + j] * x
