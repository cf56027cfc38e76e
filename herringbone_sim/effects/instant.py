"""Compiled force law with effects at one instant, and along recorded motion; SI units."""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.packed import called, inlined
from herringbone_sim.effects.law import (
    DAMPING,
    HARMONICS,
    MEAN_K,
    NOMINAL_B,
    NOMINAL_C,
    PHASE,
    PLAY,
    SHIFT,
    SHIFT_RATE,
    STIFFNESS,
    law,
    play,
)

FREE = 2  # value of ``Scratch.contact_state``: the contact state follows from the deflection
BEYOND = 1e-15  # m: margin by which a deflection on an edge is moved into its contact state


@inlined
def clamp_to_contact(x, b, contact_state, margin):
    """Clamp a deflection x [m] into a contact state, ``margin`` [m] away from its border.

    Args:
        b: half backlash [m]; the borders are -b and b.
        contact_state: 1 drive contact (x >= b + margin), -1 back contact (x <= -b - margin), 0
            separated (abs(x) <= b - margin, or 0 where b < margin).
    """
    if contact_state == 0:
        edge = max(b - margin, 0.0)
        return min(max(x, -edge), edge)
    return max(x, b + margin) if contact_state > 0 else min(x, -b - margin)


@inlined
def forces_of_motion(e, site, theta, gear, now, added_states, x, v, w):
    """Compute the law of the meshes, mesh forces and torques of effects at one instant.

    Results are ``w.law``, ``w.force`` and ``w.torque``. ``e`` is ``gear.Laws.kernel``; x, v (n,)
    are deflections and rates without the displacements of effects, which are added to give ``w.x``
    and ``w.v``. If ``w.contact_state`` imposes a contact state (-1, 0, 1) on a mesh, its force is
    continued smoothly beyond the edge of the backlash, and ``react`` gets a deflection inside that
    state, so that jumps and kinks only occur between steps.
    """
    for m in range(x.size):
        w.law[STIFFNESS, m] = gear[MEAN_K, m]
        w.law[DAMPING, m] = gear[NOMINAL_C, m]
        w.law[PLAY, m] = gear[NOMINAL_B, m]
        w.law[SHIFT, m] = 0.0
        w.law[SHIFT_RATE, m] = 0.0
    for j in range((gear.shape[0] - HARMONICS) // 4):
        cos, sin = np.cos((j + 1) * now[PHASE]), np.sin((j + 1) * now[PHASE])
        row = HARMONICS + 4 * j
        for m in range(x.size):
            w.law[STIFFNESS, m] += gear[row, m] * cos + gear[row + 1, m] * sin
    for i in range(e.n_active):
        if e.acts[i, 0]:
            mine = added_states[e.first[i] : e.first[i + 1]]
            e.excite[i](theta[i], site[i], gear, now, mine, w.law)
    for m in range(x.size):
        shown, b, contact_state = x[m] + w.law[SHIFT, m], w.law[PLAY, m], w.contact_state[m]
        w.v[m] = v[m] + w.law[SHIFT_RATE, m]
        if contact_state == FREE:
            w.x[m] = shown + w.clamp_shift[m]
            f = play(w.x[m], b)
        else:
            w.x[m] = clamp_to_contact(shown, b, contact_state, BEYOND)
            f = shown - contact_state * b if contact_state != 0 else 0.0
        w.force[m] = w.law[STIFFNESS, m] * f + w.law[DAMPING, m] * w.v[m]
    w.torque[:] = 0.0
    for i in range(e.n_active):
        if e.acts[i, 1]:
            mine = added_states[e.first[i] : e.first[i + 1]]
            e.react[i](theta[i], site[i], gear, now, mine, w.x, w.v, w.law, w.force, w.torque)


@inlined
def added_state_rates(e, site, theta, gear, now, added_states, force, slope):
    """Write the time derivatives (s,) of the effects' states at mesh forces (n,) to ``slope``."""
    for i in range(e.n_active):
        a, b = e.first[i], e.first[i + 1]
        if b > a:
            e.drive[i](theta[i], site[i], gear, now, added_states[a:b], force, slope[a:b])


@called
def follow(e, site, theta, gear, now, added_states, here, there, w, h, substeps):
    """Advance ``added_states`` (s,) in place over h [s] by RK4 in ``substeps`` steps.

    Mesh forces (n,) vary linearly from ``here`` to ``there``; ``now`` is constant.
    """
    step = h / substeps
    for k in range(substeps):
        for stage in range(4):
            part = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            at = (k + part) / substeps
            for m in range(here.size):
                w.driving[m] = here[m] + at * (there[m] - here[m])
            for j in range(added_states.size):
                before = part * step * w.slope[max(stage - 1, 0), j] if stage > 0 else 0.0
                w.stage[j] = added_states[j] + before
            added_state_rates(e, site, theta, gear, now, w.stage, w.driving, w.slope[stage])
        for j in range(added_states.size):
            inner = w.slope[1, j] + w.slope[2, j]
            added_states[j] += step / 6.0 * (w.slope[0, j] + 2.0 * inner + w.slope[3, j])


@law
def recorded(
    e, site, theta, gear, times, now, x, v, measured, added_states, w, substeps, force, torque
):
    """Evaluate the force law with effects along a recorded motion, into ``force`` and ``torque``.

    Args:
        e, site, theta: ``kernel``, ``site`` and ``theta`` of ``gear.Laws``.
        gear: (rows, n) constants of the meshes, see ``gear.gear_table``.
        times: (samples,) [s].
        now: (samples, 5) operating point, as in ``effects.law``.
        x, v: (samples, n) deflections [m] and rates [m/s] without displacements of effects.
        measured: (samples, n) mesh forces [N] that drive the states of effects; not read without
            such states.
        added_states: (s,) states of effects at the first sample; overwritten, at the end those at
            the last.
        w: ``gear.Scratch``.
        substeps: RK4 steps from one sample to the next.
        force: (samples, n) result: mesh forces [N].
        torque: (samples, bodies) result: torques of effects over base radius [N].
    """
    for i in range(x.shape[0]):
        forces_of_motion(e, site, theta, gear, now[i], added_states, x[i], v[i], w)
        for m in range(w.force.size):
            force[i, m] = w.force[m]
        for k in range(w.torque.size):
            torque[i, k] = w.torque[k]
        if added_states.size > 0 and i + 1 < x.shape[0]:
            h = times[i + 1] - times[i]
            follow(
                e,
                site,
                theta,
                gear,
                now[i],
                added_states,
                measured[i],
                measured[i + 1],
                w,
                h,
                substeps,
            )
