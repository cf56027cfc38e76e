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
from herringbone_sim.effects.lanes.gear import CONTROL_ORDER, CONTROL_PHASE, OMEGA, Own
from herringbone_sim.effects.lanes.places import (
    ANGLE,
    BOUND_HIGH,
    BOUND_LOW,
    CYCLE,
    DONE,
    GRID_LEFT,
    GROWN,
    INDEX,
    MODE,
    PIECE,
    REACH,
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

    table: Own  # constants of each gear
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
    at, Omega = m.r.lane, m.scalars[OMEGA, lane]
    phase, left = at[PIECE, lane], at[GRID_LEFT, lane]
    reach = to_edge(m.own.windows[lane], Omega, at[CYCLE, lane], phase)
    if reach > left - RESIDUE:
        reach = left
    middle = phase + 0.5 * reach * Omega
    at[BOUND_LOW, lane] = min(phase + INSIDE, middle)
    at[BOUND_HIGH, lane] = max(phase + reach * Omega - INSIDE, middle)
    at[REACH, lane], at[DONE, lane], at[WANT, lane], at[STALE, lane] = reach, 0.0, FIRST, 2.0
    plan(at, lane)


@called
def begin_grid(m, lane, steps):
    """Begin a step of the phase grid in a lane; ``steps``: grid steps per mesh cycle."""
    at = m.r.lane
    at[PIECE, lane] = TWO_PI * m.r.place[INDEX, lane] / steps
    at[GRID_LEFT, lane] = TWO_PI / (m.scalars[OMEGA, lane] * steps)
    begin_piece(m, lane)


@called
def next_piece(m, queue, lane, length):
    """Begin the next piece of a lane; returns True instead if its value is finished."""
    at, place = m.r.lane, m.r.place
    at[GRID_LEFT, lane] -= at[REACH, lane]
    if at[GRID_LEFT, lane] > RESIDUE:
        at[PIECE, lane] += at[REACH, lane] * m.scalars[OMEGA, lane]
        begin_piece(m, lane)
        return False
    steps = queue.steps[place[VALUE, lane]]
    place[INDEX, lane] += 1
    if place[INDEX, lane] == steps:
        place[INDEX, lane] = 0
        place[STARTED, lane] += 1
        if end_cycle(m, queue, lane, length):
            return True
    begin_grid(m, lane, steps)
    return False


@called
def end_cycle(m, queue, lane, length):
    """Store section and growth of a lane at phase 0; returns whether its value is finished.

    It is if the motion diverged or all cycles are observed. ``length`` as for ``run_queue``.
    """
    r, value = m.r, m.r.place[VALUE, lane]
    transient, cycles = length
    for k in range(m.n_state // 2):
        if not abs(r.y[0, k, lane]) < LIMIT:
            r.lane[GROWN, lane] = 1.0
            return True
    begin_cycle(m, lane, queue.before[value] + r.place[STARTED, lane])
    seen = r.place[STARTED, lane] - transient
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
    """Set mesh cycle and control argument of a lane for phase 0 of a cycle."""
    at, order = m.r.lane, m.scalars[CONTROL_ORDER, lane]
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
    for place in np.ndindex(of.shape):
        to[place] = of[place]


@called
def take_value(m, queue, lane, value):
    """Load a value of the queue into a lane and begin its first grid step, at phase 0."""
    r, own, table = m.r, m.own, queue.table
    copy(table.flat[value], m.flat[:, lane])
    for i in range(len(own.theta)):
        copy(table.theta[i][value], own.theta[i][lane])
        copy(table.site[i][value], own.site[i][lane])
    copy(table.gear[value], own.gear[lane])
    copy(table.now[value], own.now[lane])
    copy(table.windows[value], own.windows[lane])
    copy(queue.starts[value], r.y[0, :, lane])
    copy(queue.frame, r.tangent[:, :, lane])
    r.place[:, lane], r.lane[GROWN, lane], r.sign[:, lane] = 0, 0.0, 1.0
    r.place[VALUE, lane] = value
    begin_cycle(m, lane, queue.before[value])
    begin_grid(m, lane, queue.steps[value])


@inlined
def take_steps(m):
    """Make the end of the tried step stage 0 in every lane that accepts it."""
    r, taken = m.r, take(m.r.lane, TAKEN) == 1.0
    for k in range(r.z.shape[0]):
        store(r.y, 0, k, choose(taken, load(r.y, 6, k), load(r.y, 0, k)))
        store(r.slope, 0, k, choose(taken, load(r.slope, 6, k), load(r.slope, 0, k)))
    for j in range(m.w.x.shape[0]):
        store(r.hold, 0, j, choose(taken, load(r.hold, 6, j), load(r.hold, 0, j)))
        store(r.pace, START, j, choose(taken, load(r.pace, END, j), load(r.pace, START, j)))
    for j in range(2 * m.w.x.shape[0]):
        store(r.gap, START, j, choose(taken, load(r.gap, END, j), load(r.gap, START, j)))
    done = take(r.lane, DONE)
    give(r.lane, DONE, choose(taken, done + take(r.lane, TRIED), done))


@inlined
def go_on(m, lane):
    """Account for an accepted step of a lane and plan the next; returns whether its piece ends.

    If a contact may switch there, the lane waits one move, until ``contact.begin`` has done so.
    """
    r, at, tried = m.r, m.r.lane, m.r.lane[TRIED, lane]
    for j in range(m.w.x.shape[0]):
        r.spent[lane, j, 1 + int(m.w.side[j, lane])] += tried
    for k in range(m.n_state):
        if not abs(r.y[0, k, lane]) < FAR:
            at[GROWN, lane] = 1.0
    if at[REACH, lane] - at[DONE, lane] > RESIDUE:
        plan(at, lane)
        return False
    if at[STALE, lane] != 0.0:
        at[MODE, lane], at[TRIED, lane] = WAIT, 0.0
        return False
    return True


@called
def finish(m, queue, lane):
    """Store the results of the value in a lane, and make the lane idle."""
    value = m.r.place[VALUE, lane]
    queue.failed[value] = m.r.lane[GROWN, lane] != 0.0
    copy(m.r.spent[lane], queue.contact[value])
    copy(m.r.y[0, :, lane], queue.end[value])
    m.r.place[VALUE, lane] = -1
    m.r.lane[MODE, lane], m.r.lane[TRIED, lane], m.r.lane[STALE, lane] = WAIT, 0.0, 0.0


@called
def move(m):
    """Try a step in every lane, and accept it, with the tangent, where ``decide`` says so."""
    at, any_taken = m.r.lane, False
    attempt(m)
    for lane in range(LANES):
        gap = m.r.gap[:, :, lane]
        taken = decide(at, lane, gap, m.r.pace[:, :, lane])
        at[TAKEN, lane] = 1.0 if taken else 0.0
        if taken:
            at[STALE, lane] = 1.0 if at[TRIED, lane] < at[STEP, lane] or passed(gap) else 0.0
            any_taken = True
    if any_taken and m.r.tangent.shape[0] > 0:
        carry(m)
    take_steps(m)


@law
def run_queue(m, queue, length):
    """Integrate all values; ``length``: numbers of mesh cycles left out, then observed."""
    at, place, n = m.r.lane, m.r.place, len(queue.steps)
    following, busy = min(n, LANES), min(n, LANES)
    for lane in range(LANES):
        take_value(m, queue, lane, min(lane, n - 1))
        if lane >= n:
            place[VALUE, lane] = -1
            at[MODE, lane], at[TRIED, lane] = WAIT, 0.0
        else:
            end_cycle(m, queue, lane, length)
    begin(m, True)
    while busy:
        move(m)
        anew, stale = False, False
        for lane in range(LANES):
            over = at[MODE, lane] == WAIT and place[VALUE, lane] >= 0
            if at[TAKEN, lane] == 1.0:
                over = go_on(m, lane)
            done = at[GROWN, lane] != 0.0 and place[VALUE, lane] >= 0
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
