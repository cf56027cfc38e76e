"""One step of the Dormand-Prince pair of order 5(4), and tangent vectors over it.

J. Comput. Appl. Math. 6, 19 (1980). "Slope" is dy/dtau. The laws of effects are arbitrary code, so
its derivative along a tangent is a central difference, with every deflection moved so far into its
contact state that the difference does not cross a kink.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.packed import called, inlined
from herringbone_sim.effects.instant import FREE, clamp_to_contact
from herringbone_sim.effects.law import PLAY, SHIFT
from herringbone_sim.effects.run import LENGTH, slope_of

# Butcher tableau; A[6] holds the weights of order 5, LOWER those of order 4.
A = np.zeros((7, 6))
A[1, :1] = 1 / 5
A[2, :2] = 3 / 40, 9 / 40
A[3, :3] = 44 / 45, -56 / 15, 32 / 9
A[4, :4] = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
A[5, :5] = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
A[6] = 35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
NODE = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
LOWER = np.array([5179 / 57600, 0.0, 7571 / 16695, 393 / 640, -92097 / 339200, 187 / 2100, 1 / 40])
ERROR = np.append(A[6], 0.0) - LOWER

TOLERANCE = (
    1e-9  # error of a step, b_c; 20 mesh cycles are then exact to 1e-6 (benchmarks.effects)
)
APART = 1e-6  # b_c: half of a central difference, near the root of the rounding error
FAR = 1e9  # b_c: displacement beyond which the motion has diverged


class CompiledGear(NamedTuple):
    """Data of a gear integrated by laws, as compiled code takes it; s = size of a state."""

    e: Any  # ``gear.Kernel``
    site: tuple[Array, ...]  # of each effect, as in ``gear.Laws``
    theta: tuple[Array, ...]  # of each effect
    gear: Array  # ``gear.gear_table``
    p: Any  # ``core.packed.Packed``
    si: Array  # (5,) units, see ``run.forces_of_state``
    now: Array  # (5,) as in ``effects.law``
    w: Any  # ``gear.Scratch``
    g: Any  # ``law_stepper._Stage``
    r: Any  # ``Trial``
    unit: Array  # (s,) SI units of the effects' states, 1 elsewhere
    carrier: Array  # (n_coordinate,) row that gives u_c [m] from the coordinates
    n_state: int  # size of a state without the effects' states
    reacts: bool  # whether a law has ``react``: steps end where mesh forces change sign


class Trial(NamedTuple):
    """Work arrays of a step with 7 stages, the last one at its end; n = n_mesh."""

    saved_contact_state: NDArray[np.int64]  # (n,) contact states saved while tangents are advanced
    z: Array  # (s,) state, with the effects' states in SI units
    y: Array  # (7, s) state at each stage
    rate: Array  # (7, s) slope at each stage
    clamp_shift: Array  # (7, n) shift of each deflection into its contact state [m], see ``stage``
    bound: Array  # (2,) phases [rad] between which the laws are evaluated
    margin: Array  # (4, 2 n) margins, see ``crossing``
    margin_rate: Array  # (4, n) rates of the first n
    sign: Array  # (n,) signs of the mesh forces at the start
    along: Array  # (7, s) derivatives of the slope along a tangent
    direction: Array  # (s,) tangent at a stage, or slope before a switch
    was: Array  # (s,) displaced state of a difference
    spent: Array  # (n, 3) dimensionless time in back contact, separated, in drive contact


def trial(n: int, s: int) -> Trial:
    """Return zeroed work arrays for n meshes and a state of s numbers."""
    sizes = (s, (7, s), (7, s), (7, n), 2, (4, 2 * n), (4, n), n, (7, s), s, s, (n, 3))
    return Trial(np.zeros(n, dtype=np.int64), *(np.zeros(size) for size in sizes))


@called
def slope(m, cycle, phase, y, dy):
    """Write dy/dtau (s,) of state y into dy, at a phase [rad] clipped to ``m.r.bound``.

    Mesh forces, deflections and laws remain in ``m.w``.
    """
    at = min(max(phase, m.r.bound[0]), m.r.bound[1])
    for k in range(y.size):
        m.r.z[k] = y[k] * m.unit[k]
    slope_of(m.e, m.site, m.theta, m.gear, m.p, m.si, m.now, cycle, at, m.r.z, m.w, m.g, dy)
    for k in range(y.size):
        dy[k] /= m.unit[k]


@inlined
def stage(m, i, cycle, phase):
    """Compute the slope of stage i and ``clamp_shift``, so that a difference crosses no kink."""
    r, w = m.r, m.w
    slope(m, cycle, phase, r.y[i], r.rate[i])
    for j in range(w.x.size):
        x = m.g.x[j] + w.law[SHIFT, j]
        r.clamp_shift[i, j] = (
            clamp_to_contact(x, w.law[PLAY, j], w.contact_state[j], 4.0 * APART * m.si[LENGTH]) - x
        )


@called
def attempt(m, cycle, phase, h):
    """Try a step of length h [tau] from stage 0; its end is stage 6.

    Returns the largest error, relative to 1 + |y|, over the tolerance; NaN if an error is NaN.
    """
    r = m.r
    for i in range(1, 7):
        for k in range(r.z.size):
            moved = 0.0
            for j in range(i):
                moved += A[i, j] * r.rate[j, k]
            r.y[i, k] = r.y[0, k] + h * moved
        stage(m, i, cycle, phase + NODE[i] * h * m.p.Omega)
    worst = 0.0
    for k in range(r.z.size):
        off = 0.0
        for j in range(7):
            off += ERROR[j] * r.rate[j, k]
        off = abs(h * off) / (1.0 + max(abs(r.y[0, k]), abs(r.y[6, k])))
        if off > worst or np.isnan(off):
            worst = off
    return worst / TOLERANCE


@called
def length(v):
    """Return the Euclidean norm of v."""
    square = 0.0
    for k in range(v.size):
        square += v[k] * v[k]
    return np.sqrt(square)


@called
def difference(m, cycle, phase, y, v, dv):
    """Write the slope's derivative at y along v to dv; ``w.clamp_shift`` moves deflections."""
    r, size = m.r, length(v)
    for k in range(v.size):
        dv[k] = 0.0
    if size == 0.0:
        return
    for sign in (1.0, -1.0):
        for k in range(v.size):
            r.was[k] = y[k] + sign * APART / size * v[k]
        slope(m, cycle, phase, r.was, r.along[6])
        for k in range(v.size):
            dv[k] += sign * r.along[6, k] * size / (2.0 * APART)


@called
def carry(m, cycle, phase, h, tangents):
    """Advance tangents (k, s) in place over the step of length h that was tried last."""
    r, w = m.r, m.w
    for j in range(w.contact_state.size):
        r.saved_contact_state[j] = w.contact_state[j]
        w.contact_state[j] = FREE
    for a in range(tangents.shape[0]):
        v = tangents[a]
        for i in range(6):
            for k in range(v.size):
                moved = 0.0
                for j in range(i):
                    moved += A[i, j] * r.along[j, k]
                r.direction[k] = v[k] + h * moved
            for j in range(w.contact_state.size):
                w.clamp_shift[j] = r.clamp_shift[i, j]
            at = phase + NODE[i] * h * m.p.Omega
            difference(m, cycle, at, r.y[i], r.direction, r.along[i])
        for k in range(v.size):
            for j in range(6):
                v[k] += h * A[6, j] * r.along[j, k]
    for j in range(w.contact_state.size):
        w.contact_state[j] = r.saved_contact_state[j]
