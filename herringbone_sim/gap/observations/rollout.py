"""The motion of all bodies over short windows, with its tangent: Runge-Kutta 4, compiled.

Nine body rotations u and their rates: d2u/dt2 = inv (tau - G' F), x = G u - e + d,
F = k f(x) + c v + more, Eqs. (12) to (16) without the rigid rotation taken off. Contact is not
located: what is missed is counted as noise, see ``shooting.MISSED``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
STATES = 18


class Drive(NamedTuple):
    """What drives a motion, at every half step: arrays (n, n_mesh) where nothing else is said.

    Attributes:
        G: (n_mesh, 9) displacements of the meshes by rotations of the bodies.
        inverse: (9,) 1/M.
        tau: (n, 9) forces on the bodies at their base radii [N].
        k, c, offset, rate: stiffness, damping, -e + d [m] and its rate.
        plus, minus: play to either side [m].
        more: force that does not depend on the motion [N].
    """

    G: Array
    inverse: Array
    tau: Array
    k: Array
    c: Array
    offset: Array
    rate: Array
    plus: Array
    minus: Array
    more: Array


def roll(
    starts: Array, first: NDArray[np.int64], steps: int, h: float, drive: Drive
) -> tuple[Array, Array]:
    """States and tangents of windows.

    Args:
        starts: (W, 18) rotations [m] and rates [m/s].
        first: (W,) half step at which each window starts.
        steps: of each window, of ``h`` seconds.

    Returns:
        (W, steps + 1, 18) states and (W, steps, 18, 18) tangents of each step.
    """
    W = len(starts)
    states, tangents = np.empty((W, steps + 1, STATES)), np.empty((W, steps, STATES, STATES))
    whole = Drive(*(np.ascontiguousarray(one) for one in drive))
    touched = [np.flatnonzero(row) for row in whole.G]
    most = max(len(one) for one in touched)
    bodies = np.full((len(touched), most), -1)
    for row, one in zip(bodies, touched, strict=True):
        row[: len(one)] = one
    _roll(np.ascontiguousarray(starts), first, h, whole, bodies, states, tangents)
    return states, tangents


@njit(cache=True, nogil=True, fastmath={"contract"})
def _roll(starts, first, h, drive, touched, states, tangents):  # type: ignore[no-untyped-def]
    """Window by window, step by step; the tangent is that of the step itself."""
    G, inverse, tau, k, c, offset, rate, plus, minus, more = drive
    meshes, bodies = G.shape
    size = 2 * bodies
    slopes, K = np.empty((4, size)), np.empty((4, size, size))
    y, z, T = np.empty(size), np.empty(size), np.empty((size, size))
    pull = np.empty(size)
    sixth = h / 6.0
    for w in range(len(starts)):
        y[:] = starts[w]
        states[w, 0] = y
        for q in range(tangents.shape[1]):
            for s in range(4):
                j = first[w] + 2 * q + (0 if s == 0 else (2 if s == 3 else 1))
                way = 0.0 if s == 0 else (h if s == 3 else 0.5 * h)
                for i in range(size):
                    z[i] = y[i] + (way * slopes[s - 1, i] if s > 0 else 0.0)
                    if s == 0:
                        T[i, :] = 0.0
                    else:
                        for n in range(size):
                            T[i, n] = way * K[s - 1, i, n]
                    T[i, i] += 1.0
                for i in range(bodies):
                    slopes[s, i] = z[bodies + i]
                    slopes[s, bodies + i] = inverse[i] * tau[j, i]
                    for n in range(size):
                        K[s, i, n] = T[bodies + i, n]
                        K[s, bodies + i, n] = 0.0
                for m in range(meshes):
                    x, v = offset[j, m], rate[j, m]
                    for i in touched[m]:
                        if i >= 0:
                            x += G[m, i] * z[i]
                            v += G[m, i] * z[bodies + i]
                    on, damp = 0.0, c[j, m]
                    force = damp * v + more[j, m]
                    if x > plus[j, m]:
                        on = k[j, m]
                        force += on * (x - plus[j, m])
                    elif x < -minus[j, m]:
                        on = k[j, m]
                        force += on * (x + minus[j, m])
                    pull[:] = 0.0
                    for i in touched[m]:
                        if i >= 0:
                            of_x, of_v = G[m, i] * on, G[m, i] * damp
                            for n in range(size):
                                pull[n] += of_x * T[i, n] + of_v * T[bodies + i, n]
                    for i in touched[m]:
                        if i >= 0:
                            share = inverse[i] * G[m, i]
                            slopes[s, bodies + i] -= share * force
                            for n in range(size):
                                K[s, bodies + i, n] -= share * pull[n]
            for i in range(size):
                y[i] += sixth * (slopes[0, i] + 2.0 * (slopes[1, i] + slopes[2, i]) + slopes[3, i])
                states[w, q + 1, i] = y[i]
                for n in range(size):
                    tangents[w, q, i, n] = sixth * (
                        K[0, i, n] + 2.0 * (K[1, i, n] + K[2, i, n]) + K[3, i, n]
                    )
                tangents[w, q, i, i] += 1.0
