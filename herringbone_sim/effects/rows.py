"""The compiled run of a gear with effects: steps over a grid of mesh phases, row by row."""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.packed import LIMIT, TWO_PI
from herringbone_sim.effects.law import PHASE, PLAY, law
from herringbone_sim.effects.run import FREQUENCY_N, LENGTH, TILT, at_instant
from herringbone_sim.effects.switching import keep, step

DISTANCE = 1e-7  # of a second trajectory, b_c: far from rounding, far from the kinks


@law
def write_row(p, si, carrier, t, now, y, w, g, row):
    """One sample: head, x, v, F of the meshes, u of the bodies; returns the largest |x| / b_c."""
    n = w.force.size
    m = carrier.size
    row[0] = t
    row[1] = now[0]
    row[2] = now[4]
    row[3] = now[2]
    row[4] = now[3]
    largest = 0.0
    for j in range(n):
        row[5 + j] = g.x[j]
        row[5 + n + j] = g.v[j]
        row[5 + 2 * n + j] = w.force[j]
        size = abs(w.x[j]) / si[LENGTH]
        if size > largest or np.isnan(size):
            largest = size
    u_c = 0.0
    for k in range(m):
        u_c += carrier[k] * y[k]
    first = 5 + 3 * n
    for side in range(2):
        row[first + side] = y[side] * si[TILT] + 2.0 * u_c
    row[first + 2] = u_c
    for k in range(2, m):
        row[first + 1 + k] = y[k] * si[TILT] + u_c
    return largest


@law
def count(w, contact):
    """Add where each mesh is: back contact, separated, drive contact."""
    for j in range(contact.shape[0]):
        b = w.law[PLAY, j]
        contact[j, 1 + (w.x[j] > b) - (w.x[j] < -b)] += 1


@law
def pull_back(y, other, unit, tangent, growth):
    """Bring a second trajectory back to its distance; growth takes the logarithm."""
    square = 0.0
    for k in range(y.size):
        tangent[k] = (other[k] - y[k]) / unit[k]
        square += tangent[k] * tangent[k]
    length = np.sqrt(square)
    growth[0] += np.log(length / DISTANCE)
    for k in range(y.size):
        tangent[k] /= length
        other[k] = y[k] + DISTANCE * unit[k] * tangent[k]


@law
def run(
    e,
    site,
    theta,
    gear,
    p,
    si,
    carrier,
    now,
    y,
    other,
    unit,
    tangents,
    growth,
    place,
    t,
    steps,
    stride,
    parts,
    w,
    g,
    began,
    before,
    rows,
    contact,
):
    """Fill rows with samples ``stride`` steps apart, each of ``parts`` steps of the method.

    ``place`` is (cycle, index) and moves on; returns (time, rows filled). The run stops after the
    row that is out of range. ``contact (n, 3)`` counts steps that end in back contact, separated,
    in drive contact. ``other (k, n)`` are trajectories beside y, one a tangent; ``unit (n,)`` is
    that of each state; ``began`` and ``before`` are scratch of ``switching.step``.
    """
    h = TWO_PI / (p.Omega * steps) / parts
    now[PHASE] = TWO_PI * place[0] + TWO_PI * place[1] / steps
    for k in range(other.shape[0]):
        at_instant(e, site, theta, gear, p, si, now, other[k], w, g)
        keep(w, before[1 + k])
    for i in range(rows.shape[0]):
        now[PHASE] = TWO_PI * place[0] + TWO_PI * place[1] / steps
        at_instant(e, site, theta, gear, p, si, now, y, w, g)
        largest = write_row(p, si, carrier, t, now, y, w, g, rows[i])
        keep(w, before[0])
        if not largest < LIMIT:
            return t, i + 1
        for _ in range(stride):
            phase = TWO_PI * place[1] / steps
            for part in range(parts):
                at = phase + part * h * p.Omega
                for k in range(other.shape[0]):
                    z, kept = other[k], before[1 + k]
                    step(e, site, theta, gear, p, si, now, place[0], at, h, z, began, kept, w, g)
                kept = before[0]
                step(e, site, theta, gear, p, si, now, place[0], at, h, y, began, kept, w, g)
                count(w, contact)
            for k in range(other.shape[0]):
                pull_back(y, other[k], unit, tangents[k], growth[k : k + 1])
            t += h * parts / si[FREQUENCY_N]
            place[1] += 1
            if place[1] == steps:
                place[1] = 0
                place[0] += 1
    return t, rows.shape[0]
