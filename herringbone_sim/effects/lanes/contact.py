"""Contact states in sixteen lanes: their value where a piece begins, and their switches."""

from __future__ import annotations

from herringbone_sim.core.lanes.vector import LANES, choose, fma, give, load, root, store, take
from herringbone_sim.core.packed import called, inlined
from herringbone_sim.effects.crossing import ON_BORDER, START
from herringbone_sim.effects.dormand_prince import APART
from herringbone_sim.effects.lanes.progress import JUMPS, NOW, STALE, SWITCH_RATE, SWITCHED
from herringbone_sim.effects.lanes.slope import slope
from herringbone_sim.effects.lanes.step import begin_phase, clamp_shift_of, margins
from herringbone_sim.effects.law import PLAY, SHIFT
from herringbone_sim.effects.located import JUMP

SPARE = 4  # work row of ``margin`` and ``margin_rate``, behind those of ``crossing``


@called
def find_contact(m):
    """Set the contact states of all meshes by their deflections in lanes that begin a piece."""
    w, anew = m.w, take(m.r.progress, STALE) == 2.0
    slope(m, m.r.y[0], m.r.along[5], False)
    for j in range(w.x.shape[0]):
        x, b = take(w.plain, j) + load(w.law, SHIFT, j), load(w.law, PLAY, j)
        zero = b * 0.0
        contact_state = choose(x > b, zero + 1.0, choose(x < zero - b, zero - 1.0, zero))
        give(w.contact_state, j, choose(anew, contact_state, take(w.contact_state, j)))


@called
def refresh(m):
    """Evaluate the right-hand side at ``r.y[0]`` with the present contact states.

    In stale lanes (``progress[STALE]`` above 0) the result becomes slope and ``clamp_shift`` of
    stage 0. In all lanes margins and their rates go into row ``SPARE``, and ``r.along[5]`` is
    overwritten. Contact states and ``STALE`` remain.

    Args:
        m: ``gear.LaneGear``, changed in its work arrays.
    """
    r, stale = m.r, take(m.r.progress, STALE) > 0.0
    slope(m, r.y[0], r.along[5], False)
    for k in range(r.z.shape[0]):
        store(r.slope, 0, k, choose(stale, load(r.along, 5, k), load(r.slope, 0, k)))
    for j in range(m.w.x.shape[0]):
        store(r.clamp_shift, 0, j, choose(stale, clamp_shift_of(m, j), load(r.clamp_shift, 0, j)))
    margins(m, SPARE)


@inlined
def leaving(r, n, lane):
    """Return the index of the first mesh of a lane that must switch contact, or -1.

    A mesh must switch if its margin to the edge of the backlash, in row ``SPARE``, is used up and
    still falls, or is beyond rounding below 0.

    Args:
        r: work arrays of the step.
        n: number of meshes.
        lane: index of the lane.
    """
    for j in range(n):
        margin = r.margin[SPARE, j, lane]
        if (margin <= 0.0 and r.margin_rate[SPARE, j, lane] < 0.0) or margin < -10.0 * ON_BORDER:
            return j
    return -1


@called
def switch(m):
    """Switch the first mesh that must, in every stale lane; returns whether any lane did."""
    r, w, any_has = m.r, m.w, False
    for lane in range(LANES):
        r.counters[SWITCHED, lane] = -1
        if r.progress[STALE, lane] == 0.0:
            continue
        j = leaving(r, w.x.shape[0], lane)
        if j >= 0:
            r.counters[SWITCHED, lane] = j
            r.progress[SWITCH_RATE, lane] = r.margin_rate[SPARE, j, lane]
            x, v = w.plain[j, lane] + w.law[SHIFT, j, lane], w.v[j, lane]
            up = x > 0.0 or (x == 0.0 and v > 0.0)
            w.contact_state[j, lane] = (
                0.0 if w.contact_state[j, lane] != 0.0 else (1.0 if up else -1.0)
            )
            any_has = True
    return any_has


@called
def see_jumps(m):
    """Mark lanes whose slope jumped from ``direction`` at a switch; returns whether any did.

    There the contact state before the switch is restored, and ``progress[JUMPS]`` holds the state
    after it, with 2 for separated; it is 0 in lanes without a jump.
    """
    r, w, any_has = m.r, m.w, False
    for lane in range(LANES):
        j, largest = r.counters[SWITCHED, lane], 0.0
        for k in range(r.z.shape[0]):
            largest = max(largest, abs(r.slope[0, k, lane] - r.direction[k, lane]))
        jumps = j >= 0 and largest > JUMP and r.progress[SWITCH_RATE, lane] < 0.0
        r.progress[JUMPS, lane] = 0.0
        if jumps:
            was = w.contact_state[j, lane]
            up = w.plain[j, lane] + w.law[SHIFT, j, lane] > 0.0
            r.progress[JUMPS, lane] = was if was != 0.0 else 2.0
            w.contact_state[j, lane] = 0.0 if was != 0.0 else (1.0 if up else -1.0)
            any_has = True
    return any_has


@called
def jump(m):
    """Apply the saltation matrix to the tangent of lanes whose slope jumped at a switch.

    ``r.direction`` is the slope before the switch.
    """
    r, w = m.r, m.w
    if not see_jumps(m):
        return
    square = take(m.r.progress, NOW) * 0.0
    for k in range(r.z.shape[0]):
        square = fma(load(r.tangent, 0, k), load(r.tangent, 0, k), square)
    size, change = root(square), square * 0.0
    small = APART / size
    for sign in (1.0, -1.0):
        for k in range(r.z.shape[0]):
            give(r.was, k, fma(small * sign, load(r.tangent, 0, k), load(r.y, 0, k)))
        slope(m, r.was, r.along[6], False)
        margins(m, SPARE)
        for lane in range(LANES):
            j = max(r.counters[SWITCHED, lane], 0)
            r.margin[SPARE, 0, lane] = r.margin[SPARE, j, lane]
        change = fma(load(r.margin, SPARE, 0), sign, change)
    jumps = take(r.progress, JUMPS) != 0.0
    share = change * size / (2.0 * APART) / take(r.progress, SWITCH_RATE)
    for k in range(r.z.shape[0]):
        old, leap = load(r.tangent, 0, k), load(r.slope, 0, k) - take(r.direction, k)
        store(r.tangent, 0, k, choose(jumps, fma(share, leap, old), old))
    for lane in range(LANES):
        if r.progress[JUMPS, lane] != 0.0:
            contact_state = r.progress[JUMPS, lane]
            w.contact_state[r.counters[SWITCHED, lane], lane] = (
                contact_state if contact_state != 2.0 else 0.0
            )
    refresh(m)


@called
def begin(m, anew):
    """Prepare stage 0 of stale lanes with the switches that are due, as ``located.begin``.

    ``anew``: whether any lane begins a piece.
    """
    r, w = m.r, m.w
    n = w.x.shape[0]
    give(r.progress, NOW, begin_phase(m))
    if anew:
        find_contact(m)
    refresh(m)
    for _ in range(3 * n):
        if not switch(m):
            break
        for k in range(r.z.shape[0]):
            give(r.direction, k, load(r.slope, 0, k))
        refresh(m)
        if r.tangent.shape[0] > 0:
            jump(m)
    stale = take(r.progress, STALE) > 0.0
    for j in range(n):
        force = take(w.force, j)
        zero = force * 0.0
        sign = choose(force < zero, zero - 1.0, zero + 1.0)
        give(r.sign, j, choose(stale, sign, take(r.sign, j)))
    margins(m, SPARE)
    for j in range(2 * n):
        store(
            r.margin, START, j, choose(stale, load(r.margin, SPARE, j), load(r.margin, START, j))
        )
    for j in range(n):
        store(
            r.margin_rate,
            START,
            j,
            choose(stale, load(r.margin_rate, SPARE, j), load(r.margin_rate, START, j)),
        )
    give(r.progress, STALE, take(r.progress, STALE) * 0.0)
