"""Integrate a queue of values in sixteen lanes, each with its step length and progress.

A value is a gear with its start state. A move tries one step in every lane, which is accepted,
tried shorter or searched for an edge lane by lane, as in ``located.piece`` and ``located.cut``.
A lane whose value is finished loads the next value.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.lanes.vector import LANES, choose, give, load, store, take
from herringbone_sim.core.packed import LIMIT, TWO_PI, called, inlined
from herringbone_sim.core.right_hand_side import angle_of
from herringbone_sim.effects.crossing import END, START, passed
from herringbone_sim.effects.dormand_prince import FAR
from herringbone_sim.effects.lanes.contact import begin
from herringbone_sim.effects.lanes.decide import WAIT, decide, plan
from herringbone_sim.effects.lanes.gear import CONTROL_ORDER, CONTROL_PHASE, OMEGA, LawConstants
from herringbone_sim.effects.lanes.progress import (
    ANGLE,
    BOUND_HIGH,
    BOUND_LOW,
    CYCLE,
    DONE,
    GRID_LEFT,
    GROWN,
    INDEX,
    MODE,
    PIECE_LENGTH,
    PIECE_START,
    STALE,
    STARTED,
    STEP,
    TAKEN,
    TRIED,
    VALUE,
    WANT,
)
from herringbone_sim.effects.lanes.step import attempt, carry
from herringbone_sim.effects.law import law
from herringbone_sim.effects.located import FIRST, INSIDE, RESIDUE, to_edge


class Queue(NamedTuple):
    """The v values to integrate, and their results as in ``batch.Found``; k tangents."""

    table: LawConstants  # constants of each gear
    steps: NDArray[np.int64]  # (v,) grid steps per mesh cycle
    starts: Array  # (v, s) start states
    frame: Array  # (k, s) tangents at the start
    before: NDArray[np.int64]  # (v,) mesh cycle in which each starts
    sections: Array  # (v, points, s)
    end: Array  # (v, s)
    growth: Array  # (v, cycles, k)
    contact: Array  # (v, n, 3)
    failed: NDArray[np.bool_]  # (v,)


@called
def begin_piece(m, lane):
    """Begin a piece in a lane: up to the next edge known in advance or the end of a grid step."""
    at, Omega = m.r.progress, m.scalars[OMEGA, lane]
    phase, left = at[PIECE_START, lane], at[GRID_LEFT, lane]
    piece_length = to_edge(m.single_constants.events[lane], Omega, at[CYCLE, lane], phase)
    if piece_length > left - RESIDUE:
        piece_length = left
    middle = phase + 0.5 * piece_length * Omega
    at[BOUND_LOW, lane] = min(phase + INSIDE, middle)
    at[BOUND_HIGH, lane] = max(phase + piece_length * Omega - INSIDE, middle)
    at[PIECE_LENGTH, lane], at[DONE, lane], at[WANT, lane], at[STALE, lane] = (
        piece_length,
        0.0,
        FIRST,
        2.0,
    )
    plan(at, lane)


@called
def begin_grid(m, lane, steps):
    """Begin a step of the phase grid in a lane; ``steps``: grid steps per mesh cycle."""
    at = m.r.progress
    at[PIECE_START, lane] = TWO_PI * m.r.counters[INDEX, lane] / steps
    at[GRID_LEFT, lane] = TWO_PI / (m.scalars[OMEGA, lane] * steps)
    begin_piece(m, lane)


@called
def next_piece(m, queue, lane, length):
    """Begin the next piece of a lane; returns True instead if its value is finished."""
    at, counters = m.r.progress, m.r.counters
    at[GRID_LEFT, lane] -= at[PIECE_LENGTH, lane]
    if at[GRID_LEFT, lane] > RESIDUE:
        at[PIECE_START, lane] += at[PIECE_LENGTH, lane] * m.scalars[OMEGA, lane]
        begin_piece(m, lane)
        return False
    steps = queue.steps[counters[VALUE, lane]]
    counters[INDEX, lane] += 1
    if counters[INDEX, lane] == steps:
        counters[INDEX, lane] = 0
        counters[STARTED, lane] += 1
        if end_cycle(m, queue, lane, length):
            return True
    begin_grid(m, lane, steps)
    return False


@called
def end_cycle(m, queue, lane, length):
    """Store section and growth of a lane at phase 0; returns whether its value is finished.

    It is if the motion diverged or all cycles are observed. ``length`` as for ``run_queue``.
    """
    r, value = m.r, m.r.counters[VALUE, lane]
    transient, cycles = length
    for k in range(m.n_state // 2):
        if not abs(r.y[0, k, lane]) < LIMIT:
            r.progress[GROWN, lane] = 1.0
            return True
    begin_cycle(m, lane, queue.before[value] + r.counters[STARTED, lane])
    seen = r.counters[STARTED, lane] - transient
    for a in range(r.tangent.shape[0]):
        grown = normalise(r.tangent[a, :, lane])
        if seen > 0:
            queue.growth[value, seen - 1, a] = grown
    if seen == 0:
        r.spent[lane, :, :] = 0.0
    first = cycles - queue.sections.shape[1]
    if first <= seen < cycles:
        for k in range(queue.sections.shape[2]):
            queue.sections[value, seen - first, k] = r.y[0, k, lane]
    return seen == cycles


@inlined
def begin_cycle(m, lane, cycle):
    """Set a lane's mesh cycle, and the angle of the control, Eq. (20), at its phase 0."""
    at, order = m.r.progress, m.scalars[CONTROL_ORDER, lane]
    at[CYCLE, lane] = cycle
    at[ANGLE, lane] = angle_of(order, 0.0, cycle) + m.scalars[CONTROL_PHASE, lane]


@called
def normalise(v):
    """Scale a vector to length 1 in place; returns the logarithm of its previous length."""
    square = 0.0
    for k in range(v.size):
        square += v[k] * v[k]
    length = np.sqrt(square)
    for k in range(v.size):
        v[k] /= length
    return np.log(length)


@inlined
def copy(of, to):
    """Copy array ``of`` into array ``to`` of the same shape."""
    for index in np.ndindex(of.shape):
        to[index] = of[index]


@called
def take_value(m, queue, lane, value):
    """Load a value of the queue into a lane and begin its first grid step, at phase 0."""
    r, single_constants, table = m.r, m.single_constants, queue.table
    copy(table.flat[value], m.flat[:, lane])
    for i in range(len(single_constants.theta)):
        copy(table.theta[i][value], single_constants.theta[i][lane])
        copy(table.site[i][value], single_constants.site[i][lane])
    copy(table.gear[value], single_constants.gear[lane])
    copy(table.now[value], single_constants.now[lane])
    copy(table.events[value], single_constants.events[lane])
    copy(queue.starts[value], r.y[0, :, lane])
    copy(queue.frame, r.tangent[:, :, lane])
    r.counters[:, lane], r.progress[GROWN, lane], r.sign[:, lane] = 0, 0.0, 1.0
    r.counters[VALUE, lane] = value
    begin_cycle(m, lane, queue.before[value])
    begin_grid(m, lane, queue.steps[value])


@inlined
def take_steps(m):
    """Make the end of the tried step stage 0 in every lane that accepts it."""
    r, taken = m.r, take(m.r.progress, TAKEN) == 1.0
    for k in range(r.z.shape[0]):
        store(r.y, 0, k, choose(taken, load(r.y, 6, k), load(r.y, 0, k)))
        store(r.slope, 0, k, choose(taken, load(r.slope, 6, k), load(r.slope, 0, k)))
    for j in range(m.w.x.shape[0]):
        store(
            r.clamp_shift,
            0,
            j,
            choose(taken, load(r.clamp_shift, 6, j), load(r.clamp_shift, 0, j)),
        )
        store(
            r.margin_rate,
            START,
            j,
            choose(taken, load(r.margin_rate, END, j), load(r.margin_rate, START, j)),
        )
    for j in range(2 * m.w.x.shape[0]):
        store(r.margin, START, j, choose(taken, load(r.margin, END, j), load(r.margin, START, j)))
    done = take(r.progress, DONE)
    give(r.progress, DONE, choose(taken, done + take(r.progress, TRIED), done))


@inlined
def go_on(m, lane):
    """Account for an accepted step of a lane and plan the next; returns whether its piece ends.

    If a contact may switch there, the lane waits one move, until ``contact.begin`` has done so.
    """
    r, at, tried = m.r, m.r.progress, m.r.progress[TRIED, lane]
    for j in range(m.w.x.shape[0]):
        r.spent[lane, j, 1 + int(m.w.contact_state[j, lane])] += tried
    for k in range(m.n_state):
        if not abs(r.y[0, k, lane]) < FAR:
            at[GROWN, lane] = 1.0
    if at[PIECE_LENGTH, lane] - at[DONE, lane] > RESIDUE:
        plan(at, lane)
        return False
    if at[STALE, lane] != 0.0:
        at[MODE, lane], at[TRIED, lane] = WAIT, 0.0
        return False
    return True


@called
def finish(m, queue, lane):
    """Store the results of the value in a lane, and make the lane idle."""
    value = m.r.counters[VALUE, lane]
    queue.failed[value] = m.r.progress[GROWN, lane] != 0.0
    copy(m.r.spent[lane], queue.contact[value])
    copy(m.r.y[0, :, lane], queue.end[value])
    m.r.counters[VALUE, lane] = -1
    m.r.progress[MODE, lane], m.r.progress[TRIED, lane], m.r.progress[STALE, lane] = WAIT, 0.0, 0.0


@called
def move(m):
    """Try a step in every lane, and accept it, with the tangent, where ``decide`` says so."""
    at, any_taken = m.r.progress, False
    attempt(m)
    for lane in range(LANES):
        margin = m.r.margin[:, :, lane]
        taken = decide(at, lane, margin, m.r.margin_rate[:, :, lane])
        at[TAKEN, lane] = 1.0 if taken else 0.0
        if taken:
            at[STALE, lane] = 1.0 if at[TRIED, lane] < at[STEP, lane] or passed(margin) else 0.0
            any_taken = True
    if any_taken and m.r.tangent.shape[0] > 0:
        carry(m)
    take_steps(m)


@law
def run_queue(m, queue, length):
    """Integrate all values; ``length``: numbers of mesh cycles left out, then observed."""
    at, counters, n = m.r.progress, m.r.counters, len(queue.steps)
    following, busy = min(n, LANES), min(n, LANES)
    for lane in range(LANES):
        take_value(m, queue, lane, min(lane, n - 1))
        if lane >= n:
            counters[VALUE, lane] = -1
            at[MODE, lane], at[TRIED, lane] = WAIT, 0.0
        else:
            end_cycle(m, queue, lane, length)
    begin(m, True)
    while busy:
        move(m)
        anew, stale = False, False
        for lane in range(LANES):
            over = at[MODE, lane] == WAIT and counters[VALUE, lane] >= 0
            if at[TAKEN, lane] == 1.0:
                over = go_on(m, lane)
            done = at[GROWN, lane] != 0.0 and counters[VALUE, lane] >= 0
            if over and not done:
                done = next_piece(m, queue, lane, length)
            if done:
                finish(m, queue, lane)
                busy -= 1
            if done and following < n:
                take_value(m, queue, lane, following)
                end_cycle(m, queue, lane, length)
                following += 1
                busy += 1
            anew = anew or at[STALE, lane] == 2.0
            stale = stale or at[STALE, lane] > 0.0
        if stale:
            begin(m, anew)
