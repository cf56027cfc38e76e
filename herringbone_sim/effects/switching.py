"""Steps of a gear with effects that are cut where a mesh makes or loses contact.

A step over a kink of the backlash function would be of order one there. So a step across which a
mesh meets a border is taken again up to it, which a cubic through displacements and rates at both
ends finds, and then from there on.
"""

from __future__ import annotations

from herringbone_sim.core.packed import TWO_PI, inlined
from herringbone_sim.effects.law import PHASE, PLAY, law
from herringbone_sim.effects.run import FREQUENCY_N, at_instant, stages

NEAR = 0.01  # share of a step: a border so near its ends is not worth a cut
PAST = 1e-3  # share of a step by which a cut lies past the border, so that the law there holds
CUTS = 24


@law
def root(a, b, slope_a, slope_b):
    """Where in 0 .. 1 the cubic crosses zero that has values a, b and slopes at the ends."""
    at = a / (a - b)
    for _ in range(4):
        c2 = 3.0 * (b - a) - 2.0 * slope_a - slope_b
        c3 = 2.0 * (a - b) + slope_a + slope_b
        value = a + at * (slope_a + at * (c2 + at * c3))
        slope = slope_a + at * (2.0 * c2 + 3.0 * c3 * at)
        if slope == 0.0:
            break
        at = min(max(at - value / slope, 0.0), 1.0)
    return at


@law
def first_crossing(h, before, w):
    """Share of a step h [s] from ``before`` to ``w`` until a mesh meets a border; 1: none."""
    first = 1.0
    for j in range(w.x.size):
        x, b = before[0, j], before[2, j]
        was = 0 + (x > b) - (x < -b)
        goes = 0 + (w.x[j] > w.law[PLAY, j]) - (w.x[j] < -w.law[PLAY, j])
        if was != goes:
            side = was if was != 0 else goes
            ends = x - side * b, w.x[j] - side * w.law[PLAY, j]
            at = root(ends[0], ends[1], h * before[1, j], h * w.v[j])
            if NEAR < at < first:
                first = min(at + PAST, 1.0)
    return first


@inlined
def copy(values, into):
    """Values (s,) into another array."""
    for k in range(values.size):
        into[k] = values[k]


@inlined
def keep(w, before):
    """Displacements, rates and half-backlashes of the meshes, for the next step."""
    for j in range(w.x.size):
        before[0, j] = w.x[j]
        before[1, j] = w.v[j]
        before[2, j] = w.law[PLAY, j]


@law
def step(e, site, theta, gear, p, si, now, cycle, phase, h, y, began, before, w, g):
    """Advance y by h in place, cut where contact is made or lost; ``w`` is that of the end.

    ``before (3, n_mesh)`` is what ``keep`` kept at y, and at the end again; ``began`` is scratch.
    """
    done, share, first, cuts = 0.0, 1.0, 0, 0
    copy(y, began)
    while True:
        at, length = phase + done * p.Omega, share * (h - done)
        stages(first, e, site, theta, gear, p, si, now, cycle, at, length, y, w, g)
        now[PHASE] = TWO_PI * cycle + at + length * p.Omega
        at_instant(e, site, theta, gear, p, si, now, y, w, g)
        if share < 1.0:
            done += length
            share, first = 1.0, 0
            copy(y, began)
            keep(w, before)
            continue
        if cuts < CUTS:
            share = first_crossing(length / si[FREQUENCY_N], before, w)
        if not share < 1.0 - NEAR:
            keep(w, before)
            return
        copy(began, y)
        first = 1
        cuts += 1
