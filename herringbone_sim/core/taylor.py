"""The Taylor step: of any order, with located switching of contact.

A switch is a root of one of the polynomials of the step, and the step goes on from there. Kinks
are never stepped over, so the order holds (measured in ``test/test_integrate.py``).
"""

from __future__ import annotations

from herringbone_sim.core.columns import move_columns
from herringbone_sim.core.packed import TWO_PI, compiled, inlined
from herringbone_sim.core.right_hand_side import cycles_to_edge
from herringbone_sim.core.series import expand_excitation, expand_motion
from herringbone_sim.core.switching import next_switch, polynomial, set_contact

MAX_SUBSTEPS = 400


@inlined
def take_state(w, y, s):
    """State of the series at s into y."""
    m = w.q.shape[1]
    for k in range(m):
        y[k] = polynomial(w.q, k, s)
        y[m + k] = polynomial(w.v, k, s)


@inlined
def take_end(w, y):
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
def move_tangents(p, w, tangents, h, s):
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
def up_to_edge(p, phase, cycle, left):
    """What is left of a step, or as much of it as lies before the next edge of an event."""
    part = left
    for j in range(p.windows.shape[0]):
        part = min(part, cycles_to_edge(p.windows[j], phase, cycle) * TWO_PI / p.Omega)
    return part


@compiled
def taylor_step(p, w, y, tangents, near, phase, cycle, h):
    """Advance y, and tangents (k, n_state) if any, by h; returns the switches passed.

    ``near`` is None, or columns that run along, see ``columns.Near``.

    At a switch the force is continuous in the displacement, so the saltation matrix is the
    identity: tangents go through unchanged and see the new stiffness from there on.
    """
    left = h
    at = phase
    switches = 0
    begins = True
    while True:
        part = up_to_edge(p, at, cycle, left)
        expand_excitation(p, w, at, cycle, part)
        if begins:
            set_contact(p, w, y)
            begins = False
        expand_motion(p, w, y, part, w.error, w.load, 1.0)
        for m in range(4 * len(p.classes)):
            w.now[m] = w.contact[m]
        s = next_switch(p, w) if switches < MAX_SUBSTEPS else 2.0
        if near is not None:
            move_columns(w, near, y, at, cycle, part, min(s, 1.0))
        if s >= 1.0:
            take_end(w, y)
            move_tangents(p, w, tangents, part, 1.0)
            if part == left:
                return switches
            at += p.Omega * part
            left -= part
        else:
            take_state(w, y, s)
            move_tangents(p, w, tangents, part, s)
            at += p.Omega * part * s
            left -= part * s
            switches += 1
