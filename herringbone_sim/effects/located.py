"""Integration of a gear by laws, with steps that end at every kink or jump of a law.

Known in advance are the edges of the events in the gear's slots, and every half mesh cycle, where
flanks pass the pitch point; the stretch between two of these, or of grid points, is a piece.
Contact changes and sign changes of mesh forces within it are located by repeated trial steps.
"""

from __future__ import annotations

import math

from herringbone_sim.core.packed import TWO_PI, called, inlined
from herringbone_sim.core.right_hand_side import ON_EDGE, cycles_to_edge
from herringbone_sim.effects.crossing import (
    END,
    HIGH,
    LOW,
    ON_BORDER,
    START,
    dip,
    guess,
    keep,
    passed,
)
from herringbone_sim.effects.dormand_prince import APART, FAR, attempt, carry, length, slope, stage
from herringbone_sim.effects.law import PLAY, SHIFT
from herringbone_sim.effects.run import FORCE, LENGTH, RATE

# Lengths of steps are dimensionless times tau.
FIRST = 0.06  # first trial step of a piece, a hundredth of a natural period
SHORTEST = 1e-9  # step that is accepted with any error
INSIDE = 1e-9  # rad: laws may jump at the ends of a piece and are evaluated this far inside
JUMP = 1e-7  # largest difference of slopes that counts as rounding
TRIALS = 40  # of ``locate``
RESIDUE = 1e-13  # remaining length that counts as rounding


@inlined
def margins(m, row):
    """Write the margins (see ``crossing``) of the last evaluated slope into a row of ``margin``.

    A margin is negative beyond the edge of the contact state, or where a force differs in sign
    from ``sign``; force margins are 1 if no law reads forces. Rates go into ``margin_rate``.
    """
    r, w = m.r, m.w
    n = w.x.size
    for j in range(n):
        x, b, v = m.g.x[j] + w.law[SHIFT, j], w.law[PLAY, j], w.v[j]
        contact_state = w.contact_state[j]
        if contact_state != 0:
            margin, margin_rate = contact_state * x - b, contact_state * v
        else:
            outward = 1.0 if x > 0.0 or (x == 0.0 and v > 0.0) else -1.0
            margin, margin_rate = b - abs(x), -outward * v
        r.margin[row, j] = margin / m.si[LENGTH]
        r.margin_rate[row, j] = margin_rate / m.si[RATE]
        r.margin[row, n + j] = r.sign[j] * w.force[j] / m.si[FORCE] if m.reacts else 1.0


@called
def contact_now(m, cycle, phase, y):
    """Set every mesh to the contact state that follows from its deflection in state y."""
    w = m.w
    for j in range(w.contact_state.size):
        w.contact_state[j] = 0
    slope(m, cycle, phase, y, m.r.rate[0])
    for j in range(w.contact_state.size):
        x, b = m.g.x[j] + w.law[SHIFT, j], w.law[PLAY, j]
        w.contact_state[j] = 0 + (x > b) - (x < -b)


@called
def margin_along(m, cycle, phase, j, v):
    """Derivative [b_c] of the deflection margin of mesh j along v (s,), which is not normalised.

    It is a central difference about the state before the step, ``r.y[0]``, in the present contact
    states. It overwrites ``r.was``, ``r.along[6]``, row LOW of the margins and the forces in
    ``m.w``: call ``stage(m, 0, ...)`` afterwards.
    """
    r, size, derivative = m.r, length(v), 0.0
    if size == 0.0:
        return derivative
    for sign in (1.0, -1.0):
        for k in range(v.size):
            r.was[k] = r.y[0, k] + sign * APART / size * v[k]
        slope(m, cycle, phase, r.was, r.along[6])
        margins(m, LOW)
        derivative += sign * r.margin[LOW, j] * size / (2.0 * APART)
    return derivative


@called
def begin(m, cycle, phase, tangents):
    """Prepare stage 0: slope, margins, and a switch of each mesh that leaves its contact state.

    Where a switch makes the slope jump, the saltation matrix is applied to the tangents (k, s).
    Returns 1 if any mesh switched, else 0.
    """
    r, w = m.r, m.w
    n, switches = w.contact_state.size, 0
    stage(m, 0, cycle, phase)
    for _ in range(3 * n):
        margins(m, START)
        for j in range(n):
            margin, margin_rate = r.margin[START, j], r.margin_rate[START, j]
            if (margin <= 0.0 and margin_rate < 0.0) or margin < -10.0 * ON_BORDER:
                break
        else:
            break
        old = w.contact_state[j]
        x = m.g.x[j] + w.law[SHIFT, j]
        new = 0 if old != 0 else (1 if x > 0.0 or (x == 0.0 and w.v[j] > 0.0) else -1)
        for k in range(r.z.size):
            r.direction[k] = r.rate[0, k]
        w.contact_state[j] = new
        stage(m, 0, cycle, phase)
        largest = 0.0
        for k in range(r.z.size):
            r.direction[k] = r.rate[0, k] - r.direction[k]
            largest = max(largest, abs(r.direction[k]))
        if largest > JUMP and margin_rate < 0.0:
            for a in range(tangents.shape[0]):
                w.contact_state[j] = old
                share = margin_along(m, cycle, phase, j, tangents[a]) / margin_rate
                for k in range(r.z.size):
                    tangents[a, k] += share * r.direction[k]
            w.contact_state[j] = new
        stage(m, 0, cycle, phase)
        switches = 1
    for j in range(n):
        r.sign[j] = 1.0 if w.force[j] >= 0.0 else -1.0
    margins(m, START)
    return switches


@called
def locate(m, cycle, phase, h):
    """Shorten the tried step so that it ends just beyond its first edge; returns its length."""
    r = m.r
    low, high, last = 0.0, h, h
    keep(r.margin, r.margin_rate, START, LOW)
    keep(r.margin, r.margin_rate, END, HIGH)
    for count in range(TRIALS):
        part, worst = guess(r.margin, r.margin_rate, high - low)
        if worst <= 2.0:
            break
        if count % 4 == 3:
            part = 0.5
        last = low + min(max(part, 1e-12), 1.0 - 1e-12) * (high - low)
        attempt(m, cycle, phase, last)
        margins(m, END)
        if passed(m.r.margin):
            high = last
            keep(r.margin, r.margin_rate, END, HIGH)
        else:
            low = last
            keep(r.margin, r.margin_rate, END, LOW)
    if last != high:
        attempt(m, cycle, phase, high)
        margins(m, END)
    return high


@called
def cut(m, cycle, phase, h):
    """Return the length of the tried step: h, or shorter if it passes an edge."""
    if passed(m.r.margin):
        return locate(m, cycle, phase, h)
    part = dip(m.r.margin, m.r.margin_rate, h)
    if part < 1.0:
        attempt(m, cycle, phase, part * h)
        margins(m, END)
        if passed(m.r.margin):
            return locate(m, cycle, phase, part * h)
        attempt(m, cycle, phase, h)
        margins(m, END)
    return h


@called
def piece(m, cycle, phase, piece_length, tangents):
    """Integrate from stage 0 over a piece, in which no edge is known in advance.

    The state at stage 0, contact states and ``tangents`` (k, s) are advanced in place; the time in
    each contact state is added to ``m.r.spent``.

    Args:
        cycle: mesh cycle.
        phase: mesh phase at the beginning [rad].
        piece_length: length of the piece [tau].

    Returns:
        Number of instants at which one or more meshes switch contact; -1 if the motion diverged.
    """
    r, n, Omega = m.r, m.w.contact_state.size, m.p.Omega
    middle = phase + 0.5 * piece_length * Omega
    r.bound[0] = min(phase + INSIDE, middle)
    r.bound[1] = max(phase + piece_length * Omega - INSIDE, middle)
    contact_now(m, cycle, phase, r.y[0])
    switches = begin(m, cycle, phase, tangents)
    done, want = 0.0, FIRST
    while piece_length - done > RESIDUE:
        at, pieces = phase + done * Omega, math.ceil((piece_length - done) / want)
        h = (piece_length - done) / pieces
        error = attempt(m, cycle, at, h)
        if not error <= 1.0 and h > SHORTEST:
            want = h * (max(0.2, 0.9 * error**-0.2) if error < 1e30 else 0.2)
            continue
        margins(m, END)
        taken = cut(m, cycle, at, h)
        if tangents.shape[0] > 0:
            carry(m, cycle, at, taken, tangents)
        for j in range(n):
            r.spent[j, 1 + m.w.contact_state[j]] += taken
        for k in range(m.n_state):
            if not abs(r.y[6, k]) < FAR:
                return -1
        for k in range(r.z.size):
            r.y[0, k], r.rate[0, k] = r.y[6, k], r.rate[6, k]
        done += taken
        want = h * min(5.0, 0.9 * max(error, 1e-9) ** -0.2)
        if taken < h or passed(m.r.margin):
            switches += begin(m, cycle, phase + done * Omega, tangents)
        else:
            keep(r.margin, r.margin_rate, END, START)
            for j in range(n):
                r.clamp_shift[0, j] = r.clamp_shift[6, j]
    return switches


@called
def to_edge(events, Omega, cycle, phase):
    """Return the time [tau] to the next edge of an event or the next half mesh cycle."""
    cycles = phase / TWO_PI
    least = 0.5 * (math.floor(2.0 * (cycles + ON_EDGE)) + 1.0) - cycles
    for i in range(events.shape[0]):
        least = min(least, cycles_to_edge(events[i], phase, cycle))
    return least * TWO_PI / Omega


@called
def grid_step(m, cycle, phase, h, y, tangents):
    """Advance y (s,) and tangents (k, s) in place over a step of the phase grid.

    Step control restarts at every grid point, so that a run is bitwise independent of its
    division into blocks. The time in each contact state is added to ``m.r.spent``.

    Args:
        m: ``dormand_prince.CompiledGear``.
        cycle: mesh cycle.
        phase: mesh phase at the start of the step [rad].
        h: length of the step [tau].

    Returns:
        Number of instants at which one or more meshes switch contact; -1 if the motion diverged,
        then with y unchanged and tangents partly advanced.
    """
    r, done, switches = m.r, 0.0, 0
    for k in range(y.size):
        r.y[0, k] = y[k]
    while h - done > RESIDUE:
        at = phase + done * m.p.Omega
        piece_length = to_edge(m.p.events, m.p.Omega, cycle, at)
        if done + piece_length > h - RESIDUE:
            piece_length = h - done
        new_switches = piece(m, cycle, at, piece_length, tangents)
        if new_switches < 0:
            return -1
        switches += new_switches
        done += piece_length
    for k in range(y.size):
        y[k] = r.y[0, k]
    return switches
