"""The compiled batch: lanes take values from a queue and go on until it is empty.

Every lane steps through its own phases and switches: none waits for another. When a value is
done, its lane takes the next one.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.lanes.packed import (
    ANGLE,
    BACK,
    CONTACT,
    CONTROL_ORDER,
    CONTROL_PHASE,
    DONE,
    DRIVE,
    END,
    LEFT,
    MOVE,
    PHASE,
    STEP,
    SWITCHES,
)
from herringbone_sim.core.lanes.series import expand_excitation, expand_motion, take_state
from herringbone_sim.core.lanes.switching import find_moves, switch_contact, touch
from herringbone_sim.core.lanes.vector import LANES, bits, choose, load, splat, store, without
from herringbone_sim.core.packed import TWO_PI, compiled, inlined
from herringbone_sim.core.run import LIMIT

IDLE = -1


@inlined
def begin_steps(w, index, steps):
    """Phase and remaining length of the step that each lane is in."""
    done = load(w.lane, DONE, 0)
    for lane in range(LANES):
        w.lane[PHASE, 0, lane] = TWO_PI * (index[lane] + w.lane[DONE, 0, lane]) / steps[lane]
    store(w.lane, LEFT, 0, load(w.constants, STEP, 0) * (1.0 - done))


@inlined
def count_contact(w):
    """Add the time of this move to the contact that each mesh was in, in parts of a grid step."""
    time = load(w.lane, MOVE, 0) * (1.0 - load(w.lane, DONE, 0))
    none = splat(0.0)
    for m in range(w.x.shape[1]):
        contact = load(w.mesh, CONTACT, m)
        drive = choose(contact > none, time, none)
        back = choose(contact < none, time, none)
        store(w.mesh, DRIVE, m, load(w.mesh, DRIVE, m) + drive)
        store(w.mesh, BACK, m, load(w.mesh, BACK, m) + back)


@compiled
def take_value(w, lane, value, table, starts):
    """Put a value's constants and initial state into a lane."""
    for row in range(table.shape[1]):
        for m in range(table.shape[2]):
            w.constants[row, m, lane] = table[value, row, m]
    for t in range(starts.shape[1]):
        for j in range(starts.shape[2]):
            w.y[t, j, lane] = starts[value, t, j]
    w.lane[DONE, 0, lane] = 0.0
    w.lane[SWITCHES, 0, lane] = 0.0


@compiled
def normalise(w, lane, growth, last):
    """Bring the tangents of a lane back to length 1; growth takes the logarithms."""
    for t in range(1, w.y.shape[0]):
        square = 0.0
        for j in range(w.y.shape[1]):
            square += w.y[t, j, lane] * w.y[t, j, lane]
        length = np.sqrt(square)
        growth[last, t - 1] += np.log(length)
        for j in range(w.y.shape[1]):
            w.y[t, j, lane] /= length


@inlined
def out_of_range(w, lane):
    """Whether the deflections of a lane are those of no gear, or its state is none at all."""
    largest = 0.0
    for m in range(w.x.shape[1]):
        size = abs(w.mesh[END, m, lane])
        if size > largest or np.isnan(size):
            largest = size
    for j in range(w.y.shape[1]):
        if not np.isfinite(w.y[0, j, lane]):
            largest = np.inf
    return not largest < LIMIT


@inlined
def forget(w, lane):
    """Count contact from here on."""
    for m in range(w.mesh.shape[1]):
        w.mesh[DRIVE, m, lane] = 0.0
        w.mesh[BACK, m, lane] = 0.0


@compiled
def end_cycle(w, lane, cycle, transient, cycles, sections, growth, contact):
    """All that happens to a lane at phase 0; returns whether its value is done.

    ``sections (points, n_state)``, ``growth (batches + 1, tangents)`` (running sum in the last
    row) and ``contact (n_mesh, 2)`` are those of its value.
    """
    turns = w.constants[CONTROL_ORDER, 0, lane] * cycle
    angle = TWO_PI * (turns - np.floor(turns)) + w.constants[CONTROL_PHASE, 0, lane]
    w.lane[ANGLE, 0, lane] = angle
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
    first = cycles - sections.shape[0]
    if first <= seen < cycles:
        for j in range(sections.shape[1]):
            sections[seen - first, j] = w.y[0, j, lane]
    if seen == cycles:
        for m in range(contact.shape[0]):
            contact[m, 0] = w.mesh[BACK, m, lane]
            contact[m, 1] = w.mesh[DRIVE, m, lane]
    return seen == cycles


@compiled
def run_lanes(
    shape,
    w,
    inverse,
    table,
    steps,
    starts,
    controlled,
    transient,
    cycles,
    sections,
    end,
    growth,
    contact,
    failed,
):
    """Run all values of a batch through the lanes.

    Args:
        shape: tuples of zeros, as many as sides and as classes: loops over them are unrolled.
        inverse: (order + 2,) 1 / i.
        table: (n, rows, n_mesh) constants.
        steps: (n,) steps a cycle.
        starts: (n, 1 + tangents, n_state) initial states and tangents.
        controlled: whether any value has K != 0.
        sections, end, growth, contact, failed: results, n of each.
    """
    n = table.shape[0]
    value, index, cycle = w.value, w.place, w.cycle
    lane_steps = w.steps
    queue = 0
    busy = 0
    for lane in range(LANES):
        take_value(w, lane, min(lane, n - 1), table, starts)
        lane_steps[lane] = steps[min(lane, n - 1)]
        if queue < n:
            value[lane] = queue
            queue += 1
            busy += 1
            end_cycle(w, lane, 0, transient, cycles, sections[lane], growth[lane], contact[lane])
    while busy:
        begin_steps(w, index, lane_steps)
        expand_excitation(w, inverse, controlled)
        touch(shape, w)
        expand_motion(shape, w, 0, True, True, controlled, inverse)
        find_moves(w)
        take_state(w, 0)
        if w.y.shape[0] > 1:
            expand_motion(shape, w, 1, False, True, controlled, inverse)
            take_state(w, 1)
        if w.y.shape[0] > 2:
            expand_motion(shape, w, 2, False, False, controlled, inverse)
            take_state(w, 2)
        count_contact(w)
        switch_contact(w)
        move = load(w.lane, MOVE, 0)
        done = load(w.lane, DONE, 0)
        reached = done + move * (1.0 - done)
        whole = (move == splat(1.0)) | without(reached < splat(1.0))  # rounded: nothing is left
        arrived = bits(whole)
        switches = load(w.lane, SWITCHES, 0) + 1.0
        store(w.lane, DONE, 0, choose(whole, splat(0.0), reached))
        store(w.lane, SWITCHES, 0, choose(whole, splat(0.0), switches))
        for lane in range(LANES):
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
            failed[v] = out_of_range(w, lane)
            if failed[v] or end_cycle(
                w, lane, cycle[lane], transient, cycles, sections[v], growth[v], contact[v]
            ):
                for j in range(end.shape[1]):
                    end[v, j] = w.y[0, j, lane]
                value[lane] = IDLE
                busy -= 1
                if queue < n:
                    value[lane] = queue
                    take_value(w, lane, queue, table, starts)
                    lane_steps[lane] = steps[queue]
                    cycle[lane] = 0
                    end_cycle(
                        w,
                        lane,
                        0,
                        transient,
                        cycles,
                        sections[queue],
                        growth[queue],
                        contact[queue],
                    )
                    queue += 1
                    busy += 1
