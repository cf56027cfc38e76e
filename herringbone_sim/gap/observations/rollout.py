"""Integrate all bodies over short windows, with tangents: Runge-Kutta 4, compiled.

Nine body rotations u and their rates: d2u/dt2 = M^-1 (tau - G' F), x = G u - e + d,
F = k f(x) + c v + extra_force, Eqs. (12) to (16) with the rigid rotation included. Contact is not
located; the error counts as noise, see ``windows.INTEGRATION_ERROR``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from herringbone_sim.arrays import Array

STATES = 18  # nine rotations [m] and their rates [m/s]
BODIES = STATES // 2
BODIES_PER_MESH = 3  # bodies that a mesh depends on: two gears and the carrier


class Forcing(NamedTuple):
    """Coefficients of the equation of motion at every half step: (n, n_mesh) unless stated.

    Attributes:
        G: (n_mesh, 9) displacements of the meshes by rotations of the bodies.
        inverse_masses: (9,) 1/M [1/kg].
        tau: (n, 9) forces on the bodies at their base radii [N].
        k, c: stiffness [N/m], damping [N s/m].
        offset, rate: -e + d [m] and its rate [m/s].
        plus, minus: half-backlash on drive and back flank [m].
        extra_force: force independent of the motion [N].
    """

    G: Array
    inverse_masses: Array
    tau: Array
    k: Array
    c: Array
    offset: Array
    rate: Array
    plus: Array
    minus: Array
    extra_force: Array


def integrate_windows(
    starts: Array, first: NDArray[np.int64], steps: int, h: float, forcing: Forcing
) -> tuple[Array, Array]:
    """Integrate windows from their start states.

    Args:
        starts: (W, 18) rotations [m] and rates [m/s].
        first: (W,) index of the half step at which each window starts.
        steps: steps per window.
        h: step [s].

    Returns:
        States (W, steps + 1, 18) and tangents (W, steps, 18, 18) of each step.
    """
    W = len(starts)
    states, tangents = np.empty((W, steps + 1, STATES)), np.empty((W, steps, STATES, STATES))
    contiguous = Forcing(*(np.ascontiguousarray(array) for array in forcing))
    moved = np.argsort(contiguous.G == 0.0, axis=1, kind="stable")[:, :BODIES_PER_MESH]
    _integrate(np.ascontiguousarray(starts), first, h, contiguous, moved, states, tangents)
    return states, tangents


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"}, error_model="numpy")
def _integrate(starts, first, h, forcing, moved, states, tangents):  # type: ignore[no-untyped-def]
    """Write states and tangents; the tangent is the exact derivative of the Runge-Kutta step.

    At a stage, let J = [0 I; A] be the derivative of the slopes by the state and S that of the
    state by the start of the step. The slopes then depend on the start by J S, whose upper half is
    the lower half of S; only its lower half A S is computed: ``bent``.
    """
    G, inverse, tau, k, c, offset, rate, plus, minus, more = forcing
    meshes = len(G)
    slopes = np.zeros((4, STATES))
    y, z = np.empty(STATES), np.empty(STATES)
    A, S = np.empty((BODIES, STATES)), np.empty((STATES, STATES))
    bent = np.zeros((4, BODIES, STATES))
    flat, upper, lower = bent.reshape(4, -1), S[:BODIES].reshape(-1), S[BODIES:].reshape(-1)
    size = BODIES * STATES
    sixth, half = h / 6.0, 0.5 * h
    pull = np.empty((meshes, BODIES_PER_MESH))
    bend = np.empty((meshes, BODIES_PER_MESH, BODIES_PER_MESH))
    for m in range(meshes):
        for p in range(BODIES_PER_MESH):
            pull[m, p] = inverse[moved[m, p]] * G[m, moved[m, p]]
            for r in range(BODIES_PER_MESH):
                bend[m, p, r] = pull[m, p] * G[m, moved[m, r]]
    for w in range(len(starts)):
        y[:] = starts[w]
        states[w, 0] = y
        slopes[0] = 0.0  # else infinite remains of a diverged window enter
        for q in range(tangents.shape[1]):
            for s in range(4):
                j = first[w] + 2 * q + (0 if s == 0 else (2 if s == 3 else 1))
                way = 0.0 if s == 0 else (h if s == 3 else half)
                last = max(s - 1, 0)
                for i in range(STATES):
                    z[i] = y[i] + way * slopes[last, i]
                for i in range(BODIES):
                    slopes[s, i] = z[BODIES + i]
                    slopes[s, BODIES + i] = inverse[i] * tau[j, i]
                A[:] = 0.0
                for m in range(meshes):
                    a, b, d = moved[m, 0], moved[m, 1], moved[m, 2]
                    ga, gb, gd = G[m, a], G[m, b], G[m, d]
                    x = offset[j, m] + ga * z[a] + gb * z[b] + gd * z[d]
                    v = rate[j, m] + ga * z[BODIES + a] + gb * z[BODIES + b] + gd * z[BODIES + d]
                    on, damp = 0.0, c[j, m]
                    force = damp * v + more[j, m]
                    if x > plus[j, m]:
                        on = k[j, m]
                        force += on * (x - plus[j, m])
                    elif x < -minus[j, m]:
                        on = k[j, m]
                        force += on * (x + minus[j, m])
                    for p in range(BODIES_PER_MESH):
                        i = moved[m, p]
                        slopes[s, BODIES + i] -= pull[m, p] * force
                        for r in range(BODIES_PER_MESH):
                            n = moved[m, r]
                            A[i, n] -= bend[m, p, r] * on
                            A[i, BODIES + n] -= bend[m, p, r] * damp
                if s == 0:
                    bent[0] = A
                    continue
                for n in range(size):
                    lower[n] = way * flat[s - 1, n]
                    upper[n] = 0.0
                if s > 1:
                    for n in range(size):
                        upper[n] = way * half * flat[s - 2, n]
                for i in range(BODIES):
                    S[i, i] += 1.0
                    S[i, BODIES + i] += way
                    S[BODIES + i, BODIES + i] += 1.0
                np.dot(A, S, bent[s])
            for i in range(STATES):
                y[i] += sixth * (slopes[0, i] + 2.0 * (slopes[1, i] + slopes[2, i]) + slopes[3, i])
                states[w, q + 1, i] = y[i]
            top = tangents[w, q, :BODIES].reshape(-1)
            bottom = tangents[w, q, BODIES:].reshape(-1)
            for n in range(size):
                middle = flat[1, n] + flat[2, n]
                top[n] = sixth * h * (flat[0, n] + middle)
                bottom[n] = sixth * (flat[0, n] + 2.0 * middle + flat[3, n])
            for i in range(BODIES):
                tangents[w, q, i, i] += 1.0
                tangents[w, q, i, BODIES + i] += h
                tangents[w, q, BODIES + i, BODIES + i] += 1.0
