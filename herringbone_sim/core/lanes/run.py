"""The compiled batch: the lanes integrate the models of a queue until it is empty.

A value is a model of the batch with its start state. Each lane has an independent phase and
independent switches, so none waits for another; after a value it begins the next of the queue.

Over 300 lines: all that a lane does with a value, from its start to its results, in order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from herringbone_sim.arrays import Array, Flags, Indices
from herringbone_sim.core.lanes.columns import (
    jump_columns,
    move_columns,
    take_columns,
    tell_columns,
)
from herringbone_sim.core.lanes.extended import jump_tangents, stop_at_pitch
from herringbone_sim.core.lanes.nonlinear_moves import move_nonlinear
from herringbone_sim.core.lanes.packed import (
    ANGLE,
    BACK,
    CONTROL_ORDER,
    CONTROL_PHASE,
    CYCLE,
    DONE,
    DRIVE,
    END,
    HARMONICS,
    LEFT,
    LOAD_ORDER,
    LONGEST,
    MOVE,
    OMEGA,
    ORDER,
    PERIOD,
    PHASE,
    ROWS_A_HARMONIC,
    SHARE,
    STEP,
    SWITCHES,
    WIDTH,
)
from herringbone_sim.core.lanes.rows import event_row, load_row
from herringbone_sim.core.lanes.series import (
    cycles_from_event,
    expand_excitation,
    expand_motion,
    take_state,
)
from herringbone_sim.core.lanes.switching import (
    count_contact,
    find_next_switches,
    switch_contact,
    touch,
)
from herringbone_sim.core.lanes.vector import bits, choose, get, load, n_lanes, put, store, without
from herringbone_sim.core.packed import LIMIT, TWO_PI, called, compiled, embedded, inlined
from herringbone_sim.core.right_hand_side import ON_EDGE, angle_of

IDLE = -1


class Values(NamedTuple):
    """Input of the n values (models with start states) of a batch."""

    table: Array  # (n, rows, entries) constants
    steps: Indices  # (n,) steps per mesh cycle
    starts: Array  # (n, 1 + tangents, n_state) initial states and tangents
    before: Indices  # (n,) mesh cycles before the start: the phase of slower forcing


class Results(NamedTuple):
    """Results of the n values of a batch, written by the lanes."""

    sections: Array  # (n, points, n_state)
    end: Array  # (n, n_state)
    growth: Array  # (n, batches + 1, tangents), see ``end_cycle``
    contact: Array  # (n, n_mesh, 2) time in back and in drive contact, in grid steps
    failed: Flags  # (n,) whether the motion diverged


@inlined
def begin_steps(w, index, steps):
    """Set the start phase and the length of the next interval of each lane (PHASE, LEFT, SHARE).

    It ends with the grid step, at the next edge of an event, or when it is as long as series of
    what effects add allow (LONGEST).
    """
    for lane in range(n_lanes(w.progress)):
        put(
            w.progress,
            PHASE,
            0,
            lane,
            TWO_PI * (index[lane] + get(w.progress, DONE, 0, lane)) / steps[lane],
        )
    left = load(w.constants, STEP, 0) * (1.0 - load(w.progress, DONE, 0))
    longest = load(w.constants, LONGEST, 0)
    part = choose(left < longest * (1.0 + ON_EDGE), left, longest)
    for j in range(w.sizes[2]):
        part = least(part, time_to_edge(w, event_row(w, j)))
    store(w.progress, LEFT, 0, part)
    store(w.progress, SHARE, 0, part / left)


@inlined
def time_to_edge(w, row):
    """Return the time (tau) to the next edge of an event, see ``right_hand_side``."""
    s = cycles_from_event(w, row)
    half = load(w.constants, row + WIDTH, 0) * 0.5
    near = ON_EDGE
    onset = s < 0.0 - half - near
    end = s < half - near
    cycles = choose(end, half - s, load(w.constants, row + PERIOD, 0) - half - s)
    cycles = choose(onset, 0.0 - half - s, cycles)
    return cycles * TWO_PI / load(w.constants, OMEGA, 0)


@inlined
def least(a, b):
    """Return the minimum of a and b, lane by lane."""
    return choose(b < a, b, a)


@called
def take_value(w, lane, value, table, starts):
    """Copy constants, initial state and tangents of model number ``value`` into a lane."""
    for row in range(table.shape[1]):
        for m in range(table.shape[2]):
            put(w.constants, row, m, lane, table[value, row, m])
    for t in range(starts.shape[1]):
        for j in range(starts.shape[2]):
            put(w.y, t, j, lane, starts[value, t, j])
    put(w.progress, DONE, 0, lane, 0.0)
    put(w.progress, SWITCHES, 0, lane, 0.0)


@called
def normalise(w, lane, growth, last):
    """Scale the tangents of a lane to length 1; add the logarithms to row ``last`` of growth."""
    for t in range(1, w.y.shape[0]):
        square = 0.0
        for j in range(w.y.shape[1]):
            square += get(w.y, t, j, lane) * get(w.y, t, j, lane)
        length = np.sqrt(square)
        growth[last, t - 1] += np.log(length)
        for j in range(w.y.shape[1]):
            put(w.y, t, j, lane, get(w.y, t, j, lane) / length)


@inlined
def out_of_range(w, lane):
    """Whether a deflection of a lane exceeds ``LIMIT``, or its state is not finite."""
    largest = 0.0
    for m in range(w.x.shape[1]):
        size = abs(get(w.mesh_state, END, m, lane))
        if size > largest or np.isnan(size):
            largest = size
    for j in range(w.y.shape[1]):
        if not np.isfinite(get(w.y, 0, j, lane)):
            largest = np.inf
    return not largest < LIMIT


@inlined
def forget(w, lane):
    """Reset the contact times of a lane to zero."""
    for m in range(w.mesh_state.shape[1]):
        put(w.mesh_state, DRIVE, m, lane, 0.0)
        put(w.mesh_state, BACK, m, lane, 0.0)


@inlined
def begin_cycle(w, lane, now):
    """Begin mesh cycle ``now`` in a lane: set its number and the angles at mesh phase 0.

    The angles of the control and of each harmonic [rad], whole turns removed. They are not zero
    for an order that is no whole number.
    """
    angle = angle_of(get(w.constants, CONTROL_ORDER, 0, lane), 0.0, now)
    put(w.progress, ANGLE, 0, lane, angle + get(w.constants, CONTROL_PHASE, 0, lane))
    put(w.progress, CYCLE, 0, lane, now)
    for j in range(w.sizes[0]):
        order = get(w.constants, HARMONICS + ROWS_A_HARMONIC * j + ORDER, 0, lane)
        put(w.start_angles, j, 0, lane, angle_of(order, 0.0, now))
    for j in range(w.sizes[1]):
        order = get(w.constants, load_row(w, j) + LOAD_ORDER, 0, lane)
        put(w.start_angles, w.sizes[0] + j, 0, lane, angle_of(order, 0.0, now))


@called
def end_cycle(w, lane, cycle, before, length, results, value):
    """Begin a mesh cycle of a lane: rescale tangents, store growth, section and contact.

    Returns whether its value is done. ``cycle`` counts from the start of the batch, ``before`` are
    the cycles before it, ``length`` is transient and observed cycles. The last row of ``growth``
    is the running sum of the present batch of cycles.
    """
    transient, cycles = length
    sections, growth = results.sections[value], results.growth[value]
    contact = results.contact[value]
    begin_cycle(w, lane, before + cycle)
    seen = cycle - transient
    batches = growth.shape[0] - 1
    normalise(w, lane, growth, batches)
    batch = seen * batches // cycles if seen > 0 else 0
    if seen == 0 or (seen > 0 and batch != (seen - 1) * batches // cycles):
        for t in range(growth.shape[1]):
            if seen:
                growth[batch - 1, t] = growth[batches, t]
            growth[batches, t] = 0.0
    if seen == 0:
        forget(w, lane)
    first_stored = cycles - sections.shape[0]
    if first_stored <= seen < cycles:
        for j in range(sections.shape[1]):
            sections[seen - first_stored, j] = get(w.y, 0, j, lane)
    if seen == cycles:
        for m in range(contact.shape[0]):
            contact[m, 0] = get(w.mesh_state, BACK, m, lane)
            contact[m, 1] = get(w.mesh_state, DRIVE, m, lane)
    return seen == cycles


@embedded
def through_lanes(move, unrolled, w, neighbours, inverse, controlled, values, length, results):
    """Integrate all values of a batch in the lanes.

    Args:
        move: ``move_linear`` or ``move_nonlinear``, advances every lane by a move.
        unrolled, w, neighbours, inverse, controlled: see ``lanes.packed``.
        values: see ``Values``.
        length: mesh cycles of the transient, and observed ones.
        results: see ``Results``, written in place.
    """
    table, steps, starts, before = values
    n = table.shape[0]
    value, index, cycle = w.value, w.step_index, w.cycle
    lane_steps = w.steps
    queue = 0
    busy = 0
    for lane in range(n_lanes(w.progress)):
        take_value(w, lane, min(lane, n - 1), table, starts)
        if neighbours is not None:
            take_columns(neighbours, lane, min(lane, n - 1))
        lane_steps[lane] = steps[min(lane, n - 1)]
        if queue < n:
            value[lane] = queue
            queue += 1
            busy += 1
            end_cycle(w, lane, 0, before[lane], length, results, lane)
    while busy:
        begin_steps(w, index, lane_steps)
        move(unrolled, w, neighbours, inverse, controlled)
        done = load(w.progress, DONE, 0)
        part = load(w.progress, MOVE, 0) * load(w.progress, SHARE, 0)
        reached = done + part * (1.0 - done)
        nothing_left = without(reached < 1.0)  # by rounding
        whole = (part == 1.0) | nothing_left
        arrived = bits(whole)
        switches = load(w.progress, SWITCHES, 0) + 1.0
        store(w.progress, DONE, 0, choose(whole, 0.0, reached))
        store(w.progress, SWITCHES, 0, choose(whole, 0.0, switches))
        for lane in range(n_lanes(w.progress)):
            if not (arrived >> lane) & 1:
                continue
            index[lane] += 1
            if index[lane] < lane_steps[lane]:
                continue
            index[lane] = 0
            cycle[lane] += 1
            v = value[lane]
            if v == IDLE:
                continue
            results.failed[v] = out_of_range(w, lane)
            if results.failed[v] or end_cycle(w, lane, cycle[lane], before[v], length, results, v):
                for j in range(results.end.shape[1]):
                    results.end[v, j] = get(w.y, 0, j, lane)
                if neighbours is not None:
                    tell_columns(neighbours, lane, v)
                value[lane] = IDLE
                busy -= 1
                if queue < n:
                    value[lane] = queue
                    take_value(w, lane, queue, table, starts)
                    if neighbours is not None:
                        take_columns(neighbours, lane, queue)
                    lane_steps[lane] = steps[queue]
                    cycle[lane] = 0
                    end_cycle(w, lane, 0, before[queue], length, results, queue)
                    queue += 1
                    busy += 1


@inlined
def move_linear(unrolled, w, neighbours, inverse, controlled):
    """Advance every lane by one move, in place; forces must be linear between switches.

    ``lanes.packed`` explains moves and arguments; ``Packed.powers`` of all gears must be False.
    """
    if len(unrolled[2]) > 0:
        stop_at_pitch(w)
    expand_excitation(w, inverse, controlled)
    touch(unrolled, w)
    expand_motion(unrolled, w, 0, True, True, controlled, inverse)
    find_next_switches(w)
    if neighbours is not None:
        move_columns(unrolled, w, neighbours, inverse, controlled)
    take_state(unrolled, w, 0)
    for row in range(1, w.y.shape[0]):
        expand_motion(
            unrolled, w, row, False, row == 1 or len(unrolled[0]) == 2, controlled, inverse
        )
        take_state(unrolled, w, row)
    count_contact(w)
    if switch_contact(unrolled, w) and len(unrolled[2]) > 0:
        jump_tangents(unrolled, w)
        if neighbours is not None:
            jump_columns(unrolled, w, neighbours)


# A function for each kind of gear: only those that are used are compiled.
@compiled
def run_linear_lanes(unrolled, w, neighbours, inverse, controlled, values, length, results):
    """``through_lanes`` for gears whose forces are linear between switches."""
    through_lanes(
        move_linear, unrolled, w, neighbours, inverse, controlled, values, length, results
    )


@compiled
def run_nonlinear_lanes(unrolled, w, neighbours, inverse, controlled, values, length, results):
    """``through_lanes`` for gears whose forces are nonlinear between switches."""
    through_lanes(
        move_nonlinear, unrolled, w, neighbours, inverse, controlled, values, length, results
    )
