"""The motion of all bodies over short windows, with its tangent: Runge-Kutta 4, compiled.

Nine body rotations u and their rates: d2u/dt2 = inv (tau - G' F), x = G u - e + d,
F = k f(x) + c v + more, Eqs. (12) to (16) without the rigid rotation taken off. Contact is not
located: with a tenth of a natural time a step, what is missed is far below any sensor's noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
STATES = 18


@dataclass(frozen=True)
class Drive:
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
    d = drive
    _roll(
        starts, first, h, d.G, d.inverse, d.tau, d.k, d.c, d.offset, d.rate, d.plus, d.minus,
        d.more, states, tangents,
    )  # fmt: skip
    return states, tangents


@njit(cache=True)
def _roll(starts, first, h, G, inverse, tau, k, c, offset, rate, plus, minus, more, states, tangents):  # type: ignore[no-untyped-def]  # fmt: skip  # noqa: E501
    """Window by window, step by step; the tangent is that of the step itself."""
    meshes, bodies = G.shape
    A, C = np.zeros((bodies, bodies)), np.zeros((bodies, bodies))
    slopes, K = np.empty((4, 2 * bodies)), np.empty((4, 2 * bodies, 2 * bodies))
    y, z = np.empty(2 * bodies), np.empty(2 * bodies)
    one = np.eye(2 * bodies)
    for w in range(len(starts)):
        y[:] = starts[w]
        states[w, 0] = y
        for q in range(tangents.shape[1]):
            for s in range(4):
                j = first[w] + 2 * q + (0 if s == 0 else (2 if s == 3 else 1))
                way = 0.0 if s == 0 else (h if s == 3 else 0.5 * h)
                z[:] = y
                if s > 0:
                    z += way * slopes[s - 1]
                for i in range(bodies):
                    slopes[s, i] = z[bodies + i]
                    slopes[s, bodies + i] = inverse[i] * tau[j, i]
                A[:] = 0.0
                C[:] = 0.0
                for m in range(meshes):
                    x, v = offset[j, m], rate[j, m]
                    for i in range(bodies):
                        x += G[m, i] * z[i]
                        v += G[m, i] * z[bodies + i]
                    on, force = 0.0, c[j, m] * v + more[j, m]
                    if x > plus[j, m]:
                        on = k[j, m]
                        force += on * (x - plus[j, m])
                    elif x < -minus[j, m]:
                        on = k[j, m]
                        force += on * (x + minus[j, m])
                    for i in range(bodies):
                        if G[m, i] != 0.0:
                            share = inverse[i] * G[m, i]
                            slopes[s, bodies + i] -= share * force
                            for n in range(bodies):
                                A[i, n] -= share * on * G[m, n]
                                C[i, n] -= share * c[j, m] * G[m, n]
                T = one if s == 0 else one + way * K[s - 1]
                K[s, :bodies] = T[bodies:]
                K[s, bodies:] = A @ T[:bodies] + C @ T[bodies:]
            y += h / 6.0 * (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3])
            tangents[w, q] = one + h / 6.0 * (K[0] + 2.0 * K[1] + 2.0 * K[2] + K[3])
            states[w, q + 1] = y
