"""The compiled filter: a gear with effects between samples, and how it is drawn to them.

A state holds the coordinates z, their rates, the effects' own states, then the rigid rotation and
its rate, which mesh forces don't move; z and rates are dimensionless (Eq. 17).
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.effects.law import law
from herringbone_sim.effects.run import slope_of


@law
def slope_with_rigid(e, site, theta, gear, p, si, push, now, phase, y, w, g, dy):
    """``effects.run.slope_of`` and the rigid rotation under torques and control.

    ``push`` holds, over b_c omega_n^2 and the inertia of the rigid rotation, what each body's
    torque (n_bodies,) adds, then the control.
    """
    slope_of(e, site, theta, gear, p, si, now, 0.0, phase, y, w, g, dy)
    k = y.size - 2
    turn = push[-1] * np.cos(phase)
    for b in range(w.torque.size):
        turn += push[b] * w.torque[b]
    dy[k] = y[k + 1]
    dy[k + 1] = turn


@law
def between_samples(e, site, theta, gear, p, si, push, now, phase, turn, parts, y, w, g):
    """Advance y over a mesh angle ``turn`` [rad] in ``parts`` steps of RK4, in place."""
    h = turn / parts / p.Omega
    for part in range(parts):
        for stage in range(4):
            share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            for k in range(y.size):
                g.stage[k] = y[k] + (share * h * g.rate[stage - 1, k] if stage > 0 else 0.0)
            at = phase + (part + share) * turn / parts
            slope_with_rigid(
                e, site, theta, gear, p, si, push, now, at, g.stage, w, g, g.rate[stage]
            )
        for k in range(y.size):
            inner = g.rate[1, k] + g.rate[2, k]
            y[k] += h / 6.0 * (g.rate[0, k] + 2.0 * inner + g.rate[3, k])


@law
def lower_root(A, L):
    """Cholesky factor L of A, both (n, n)."""
    n = A.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = A[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                L[i, i] = np.sqrt(max(total, 1e-30))
            else:
                L[i, j] = total / L[j, j]
        for j in range(i + 1, n):
            L[i, j] = 0.0


@law
def unscented(
    e, site, theta, gear, p, si, push, now, phase, parts, H, seen, noise, grown, y, P, s, w, g, out
):
    """Filter a run by sigma points; the state has no own states of effects.

    Args:
        phase: (n,) of the samples. H (k, d) sees the state, seen (n, k), noise (k,) variances.
        grown: (d,) variance that the state gains between samples.
        y, P: (d,) and (d, d) at the first sample, in place; s, w, g scratch.
        out: gains (n, d, k), spread (n, k), innovation (n, k), state (n, d).
    """
    d, channels = y.size, seen.shape[1]
    weight = 1.0 / (2.0 * d)
    for i in range(phase.size):
        for j in range(channels):
            update(H[j], noise[j], seen[i, j], y, P, s.line, i, j, out)
        for a in range(d):
            out.state[i, a] = y[a]
        if i + 1 == phase.size:
            break
        turn = phase[i + 1] - phase[i]
        lower_root(P, s.root)
        far = np.sqrt(1.0 * d)
        for q in range(2 * d):
            sign = 1.0 if q < d else -1.0
            for a in range(d):
                s.points[q, a] = y[a] + sign * far * s.root[a, q % d]
            between_samples(
                e, site, theta, gear, p, si, push, now, phase[i], turn, parts, s.points[q], w, g
            )
        for a in range(d):
            y[a] = 0.0
            for q in range(2 * d):
                y[a] += weight * s.points[q, a]
        for a in range(d):
            for b in range(a + 1):
                total = 0.0
                for q in range(2 * d):
                    total += (s.points[q, a] - y[a]) * (s.points[q, b] - y[b])
                P[a, b] = weight * total
                P[b, a] = P[a, b]
            P[a, a] += grown[a]


@law
def update(row, noise, seen, y, P, line, i, j, out):
    """Draw y and P to one channel of sample i; keeps gain, spread and innovation."""
    d = y.size
    spread = noise
    innovation = seen
    for a in range(d):
        line[a] = 0.0
        for b in range(d):
            line[a] += P[a, b] * row[b]
    for a in range(d):
        spread += row[a] * line[a]
        innovation -= row[a] * y[a]
    for a in range(d):
        out.gain[i, a, j] = line[a] / spread
        y[a] += line[a] / spread * innovation
    for a in range(d):
        for b in range(a + 1):
            P[a, b] -= line[a] * line[b] / spread
            P[b, a] = P[a, b]
    out.spread[i, j] = np.sqrt(spread)
    out.innovation[i, j] = innovation


@law
def drawn(
    e, site, theta, gear, p, si, push, now, phase, parts, H, seen, gain, to, y, w, g, innovation
):
    """Innovations (n, k) of a gear that is drawn to the samples by gains that are given.

    Args:
        H: (k, size) on the whole state, own states included.
        gain: (n, d, k); state a of the gear takes that of ``to[a]``, none where it is -1.
        y: (size,) at the first sample, in place.
    """
    for i in range(phase.size):
        for j in range(seen.shape[1]):
            off = seen[i, j]
            for a in range(y.size):
                off -= H[j, a] * y[a]
            innovation[i, j] = off
            for a in range(y.size):
                if to[a] >= 0:
                    y[a] += gain[i, to[a], j] * off
        if i + 1 < phase.size:
            turn = phase[i + 1] - phase[i]
            between_samples(e, site, theta, gear, p, si, push, now, phase[i], turn, parts, y, w, g)


@law
def linearised(
    e,
    site,
    theta,
    gear,
    p,
    si,
    push,
    now,
    phase,
    parts,
    fine,
    H,
    seen,
    gain,
    step,
    y,
    s,
    w,
    g,
    out,
):
    """A run that is drawn by gains, on a grid ``fine`` times as dense, and its derivatives.

    Args:
        step: (d,) of the differences. s: scratch (d + 1, d).
        out: state ((n - 1) fine + 1, d) after the channels; A ((n - 1) fine, d, d) from one point
            of the grid to the next.
    """
    d = y.size
    for i in range(phase.size):
        for j in range(seen.shape[1]):
            off = seen[i, j]
            for a in range(d):
                off -= H[j, a] * y[a]
            for a in range(d):
                y[a] += gain[i, a, j] * off
        turn = (phase[i + 1] - phase[i]) / fine if i + 1 < phase.size else 0.0
        for f in range(fine if i + 1 < phase.size else 1):
            at = i * fine + f
            for a in range(d):
                out.state[at, a] = y[a]
            if i + 1 == phase.size:
                break
            at_phase = phase[i] + f * turn
            for q in range(d + 1):
                for a in range(d):
                    s[q, a] = y[a] + (step[a] if a == q else 0.0)
                between_samples(
                    e, site, theta, gear, p, si, push, now, at_phase, turn, parts, s[q], w, g
                )
            for q in range(d):
                for a in range(d):
                    out.A[at, a, q] = (s[q, a] - s[d, a]) / step[q]
            for a in range(d):
                y[a] = s[d, a]


@law
def answered(A, fine, h, b, gain, H, first, delta, next_delta, innovation):
    """Change (n, k, c) of innovations under small accelerations b ((n - 1) fine + 1, r, c).

    The last r of the rates' accelerations are those from state ``first`` on; h is the step of the
    grid. delta, next_delta (d, c) are scratch, delta zero at the start.
    """
    d, columns = delta.shape
    for i in range(innovation.shape[0]):
        for j in range(H.shape[0]):
            for c in range(columns):
                total = 0.0
                for a in range(d):
                    total -= H[j, a] * delta[a, c]
                innovation[i, j, c] = total
            for a in range(d):
                for c in range(columns):
                    delta[a, c] += gain[i, a, j] * innovation[i, j, c]
        if i + 1 == innovation.shape[0]:
            break
        for f in range(fine):
            at = i * fine + f
            for r in range(b.shape[1]):
                for c in range(columns):
                    delta[first + r, c] += 0.5 * h * b[at, r, c]
            for a in range(d):
                for c in range(columns):
                    next_delta[a, c] = 0.0
                for k in range(d):
                    for c in range(columns):
                        next_delta[a, c] += A[at, a, k] * delta[k, c]
            for a in range(d):
                for c in range(columns):
                    delta[a, c] = next_delta[a, c]
            for r in range(b.shape[1]):
                for c in range(columns):
                    delta[first + r, c] += 0.5 * h * b[at + 1, r, c]
