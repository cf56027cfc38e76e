"""The compiled run: step by step over a grid of the mesh phase, a row of samples at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from herringbone_sim.core.any_step import any_step
from herringbone_sim.core.packed import TWO_PI, compiled, embedded
from herringbone_sim.core.right_hand_side import hide_displacement, mesh_forces, rk4_step
from herringbone_sim.core.taylor import taylor_step

LIMIT = 1e6


@compiled
def write_row(p, w, y, phase, cycle, head, si, carrier, row):
    """One sample: head, then x, v, F of the meshes, then u of the bodies; returns max |x|.

    ``w`` is as ``mesh_forces`` leaves it; x and v are shown without the displacement of effects.
    ``carrier (n_coordinate,)`` gives u_c, which all other bodies share: left and right see the
    same operations. The largest |x| is NaN when any is.
    """
    hide_displacement(p, w, y, phase, cycle)
    n = 4 * len(p.classes)
    for k in range(head.size):
        row[k] = head[k]
    row[1] = TWO_PI * cycle + phase
    largest = 0.0
    for m in range(n):
        row[5 + m] = w.end[m] * si[0]
        row[5 + n + m] = w.at[m] * si[1]
        row[5 + 2 * n + m] = w.force[m] * si[2]
        if abs(w.end[m]) > largest or np.isnan(w.end[m]):
            largest = abs(w.end[m])
    u_c = 0.0
    for k in range(carrier.size):
        u_c += carrier[k] * y[k]
    first = 5 + 3 * n
    for side in range(2):
        row[first + side] = y[side] * si[3] + 2.0 * u_c
    row[first + 2] = u_c
    for k in range(2, carrier.size):
        row[first + 1 + k] = y[k] * si[3] + u_c
    return largest


@compiled
def orthonormalise(tangents, growth):
    """Gram-Schmidt in place; adds the logarithms of the lengths to growth."""
    for i in range(tangents.shape[0]):
        for j in range(i):
            dot = 0.0
            for k in range(tangents.shape[1]):
                dot += tangents[i, k] * tangents[j, k]
            for k in range(tangents.shape[1]):
                tangents[i, k] -= dot * tangents[j, k]
        norm = 0.0
        for k in range(tangents.shape[1]):
            norm += tangents[i, k] * tangents[i, k]
        norm = np.sqrt(norm)
        growth[i] += np.log(norm)
        for k in range(tangents.shape[1]):
            tangents[i, k] /= norm


@embedded
def sample(
    step,
    p,
    w,
    y,
    tangents,
    near,
    growth,
    place,
    t,
    omega_n,
    steps,
    stride,
    head,
    si,
    carrier,
    rows,
    contact,
):
    """Fill rows with samples ``stride`` steps apart; returns (time, rows filled, switches).

    ``step`` is the method, ``near`` None or the columns that run along, see ``columns.Near``.
    ``place`` is (cycle, index) and moves on. The run stops after the row that is out of range.
    """
    h = TWO_PI / (p.Omega * steps)
    dt = h / omega_n
    switches = 0
    for i in range(rows.shape[0]):
        phase = TWO_PI * place[1] / steps
        head[0] = t
        mesh_forces(p, w, y, phase, place[0])
        for m in range(contact.shape[0]):
            contact[m, 1 + (w.end[m] > p.b[m]) - (w.end[m] < -p.b[m])] += 1
        largest = write_row(p, w, y, phase, place[0], head, si, carrier, rows[i])
        if not largest < LIMIT:
            return t, i + 1, switches
        for _ in range(stride):
            phase = TWO_PI * place[1] / steps
            switches += step(p, w, y, tangents, near, phase, place[0], h)
            t += dt
            place[1] += 1
            if place[1] == steps:
                place[1] = 0
                place[0] += 1
                orthonormalise(tangents, growth)
    return t, rows.shape[0], switches


@embedded
def over_cycles(step, p, w, y, tangents, near, cycle, cycles, steps):
    """Advance y and tangents (k, n_state) in place over whole mesh cycles; no samples.

    Tangents keep their length: those of the unit matrix become the monodromy matrix, transposed.
    RK4 leaves them alone. Same steps as ``sample``: the same state to the bit.
    """
    h = TWO_PI / (p.Omega * steps)
    for c in range(cycle, cycle + cycles):
        for index in range(steps):
            step(p, w, y, tangents, near, TWO_PI * index / steps, c, h)


# Each method is compiled by itself, when it is first used.
@compiled
def run_plain(
    p,
    w,
    y,
    tangents,
    near,
    growth,
    place,
    t,
    omega_n,
    steps,
    stride,
    head,
    si,
    carrier,
    rows,
    contact,
):
    """``sample`` of a gear that is plain, by series."""
    return sample(
        taylor_step,
        p,
        w,
        y,
        tangents,
        near,
        growth,
        place,
        t,
        omega_n,
        steps,
        stride,
        head,
        si,
        carrier,
        rows,
        contact,
    )


@compiled
def run_any(
    p,
    w,
    y,
    tangents,
    near,
    growth,
    place,
    t,
    omega_n,
    steps,
    stride,
    head,
    si,
    carrier,
    rows,
    contact,
):
    """``sample`` of any gear, by series."""
    return sample(
        any_step,
        p,
        w,
        y,
        tangents,
        near,
        growth,
        place,
        t,
        omega_n,
        steps,
        stride,
        head,
        si,
        carrier,
        rows,
        contact,
    )


@compiled
def run_rk4(
    p,
    w,
    y,
    tangents,
    near,
    growth,
    place,
    t,
    omega_n,
    steps,
    stride,
    head,
    si,
    carrier,
    rows,
    contact,
):
    """``sample`` by the classical Runge-Kutta method."""
    return sample(
        rk4_step,
        p,
        w,
        y,
        tangents,
        near,
        growth,
        place,
        t,
        omega_n,
        steps,
        stride,
        head,
        si,
        carrier,
        rows,
        contact,
    )


@compiled
def cross_plain(p, w, y, tangents, near, cycle, cycles, steps):
    """``over_cycles`` of a gear that is plain, by series."""
    over_cycles(taylor_step, p, w, y, tangents, near, cycle, cycles, steps)


@compiled
def cross_any(p, w, y, tangents, near, cycle, cycles, steps):
    """``over_cycles`` of any gear, by series."""
    over_cycles(any_step, p, w, y, tangents, near, cycle, cycles, steps)


@compiled
def cross_rk4(p, w, y, tangents, near, cycle, cycles, steps):
    """``over_cycles`` by the classical Runge-Kutta method."""
    over_cycles(rk4_step, p, w, y, tangents, near, cycle, cycles, steps)


@compiled
def read_rows(p, w, states, places, steps, head, si, carrier, rows):
    """Samples of given states (n, n_state) at places (n, 2), (cycle, index) each, into rows."""
    for i in range(states.shape[0]):
        phase = TWO_PI * places[i, 1] / steps
        mesh_forces(p, w, states[i], phase, places[i, 0])
        write_row(p, w, states[i], phase, places[i, 0], head, si, carrier, rows[i])


def runner(method: str, plain: bool) -> Any:
    """The compiled ``sample`` for a method and a kind of gear."""
    return run_rk4 if method == "rk4" else run_plain if plain else run_any


def crosser(method: str, plain: bool) -> Any:
    """The compiled ``over_cycles`` for a method and a kind of gear."""
    return cross_rk4 if method == "rk4" else cross_plain if plain else cross_any
