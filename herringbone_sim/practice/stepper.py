"""Dormand-Prince 5(4) with error control, also across the kinks of the force.

J. R. Dormand, P. J. Prince, J. Comput. Appl. Math. 6 (1980) 19. Kinks are not located: the error
control shortens the step there.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.reference import Reference
from herringbone_sim.errors import DivergenceError
from herringbone_sim.practice.kernel import forces, rate
from herringbone_sim.practice.rig_model import N_BODY, N_COORDINATE, N_MESH, RigModel
from herringbone_sim.practice.shapes import compiled

STAGES = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
NODES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
ERROR = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
FARTHEST = 1.0  # displacement [m] of the carrier beyond which the motion has diverged


@compiled
def run(
    p: RigModel,
    phase0: float,
    y: Array,
    times: Array,
    tolerance: float,
    stages: Array,
    nodes: Array,
    error: Array,
    slopes: Array,
    stage: Array,
    states: Array,
    force: Array,
    extra: Array,
    depth: Array,
) -> int:
    """Integrate, and fill states (n, 30 or 42), force (n, 12) and extra (n, 15) at the times.

    Returns the number of samples filled, fewer than n if the motion diverges. ``y`` is changed.
    """
    n = y.size
    half = p.mass.size
    t, h = times[0], 1e-2 / p.omega
    rate(p, t, phase0, y, slopes[0], force[0], extra[0], depth)
    for k in range(times.size):
        while t < times[k]:
            left = times[k] - t
            last = h >= left * (1.0 - 1e-9)
            step = left if last else h
            for i in range(1, 7):
                for j in range(n):
                    ahead = 0.0
                    for g in range(i):
                        ahead += stages[i, g] * slopes[g, j]
                    stage[j] = y[j] + step * ahead
                at = t + nodes[i] * step
                rate(p, at, phase0, stage, slopes[i], force[k], extra[k], depth)
            worst = 0.0
            for j in range(n):
                off = 0.0
                for g in range(7):
                    off += error[g] * slopes[g, j]
                # Rates are about omega_n = 3e4 1/s times displacements.
                scale = 1e-4 if j < half else (3.0 if j < 2 * half else 1.0)
                worst = max(worst, abs(step * off) / scale)
            ratio = worst / tolerance
            if ratio <= 1.0:
                t = times[k] if last else t + step
                for j in range(n):
                    y[j] = stage[j]
                    slopes[0, j] = slopes[6, j]
            grow = 0.9 * max(ratio, 1e-6) ** -0.2
            grown = step * min(5.0, max(0.2, grow))
            if ratio > 1.0 or not last or grown > h:
                h = grown
            if not h > 1e-14:
                return k
        if not abs(y[2]) < FARTHEST:
            return k
        for j in range(n):
            states[k, j] = y[j]
        forces(p, t, phase0, y, force[k], extra[k], depth)
    return times.size


@compiled
def accelerate(
    p: RigModel,
    times: Array,
    phase: Array,
    states: Array,
    slope: Array,
    force: Array,
    extra: Array,
    depth: Array,
    accelerations: Array,
) -> None:
    """Write the second derivatives (n, 9) of the bodies into ``accelerations``."""
    half = p.mass.size
    for i in range(times.size):
        # Pass the phase at t = 0 and the time, as some laws depend on time alone.
        rate(p, times[i], phase[i] - p.omega * times[i], states[i], slope, force, extra, depth)
        for k in range(accelerations.shape[1]):
            accelerations[i, k] = slope[half + k]


def accelerations(p: RigModel, times: Array, phase: Array, states: Array) -> Array:
    """Return the second derivatives (n, 9) of the bodies [m/s^2] at times, phases and states."""
    second_derivatives = np.empty((len(states), N_BODY))
    sizes = states.shape[1], N_MESH, p.mass.size, 2 * N_MESH
    scratch = [np.zeros(size) for size in sizes]
    accelerate(Reference(p), times, phase, states, *scratch, second_derivatives)
    return second_derivatives


def integrate(
    p: RigModel, phase0: float, y: Array, times: Array, tolerance: float = 1e-7
) -> tuple[Array, Array, Array]:
    """Return states (n, 30 or 42), mesh forces (n, 12) and extra forces (n, 15) at times (n,) [s].

    Args:
        phase0: mesh phase [rad] at t = 0.
        y: (30,) coordinates [m], then rates [m/s] at the first time; not changed.
        tolerance: local error relative to 0.1 mm, 3 m/s, and 1 for memory states; the default is
            0.02 N at a mesh, far below the noise of sensors.

    Raises:
        DivergenceError: the state left the range of any gear.
    """
    n = len(times)
    start = np.concatenate([y, np.zeros(N_MESH if p.random.own_rate > 0.0 else 0)])
    states = np.empty((n, len(start)))
    force, extra = np.empty((n, N_MESH)), np.empty((n, N_COORDINATE))
    slopes, stage = np.zeros((7, len(start))), np.zeros(len(start))
    scratch = (slopes, stage, states, force, extra, np.zeros(2 * N_MESH))
    filled = run(Reference(p), phase0, start, times, tolerance, STAGES, NODES, ERROR, *scratch)
    if filled < n:
        raise DivergenceError(
            f"the motion of the practice rig left the range of any gear at t = "
            f"{times[filled]:.6g} s: ask for a smaller effect"
        )
    return states, force, extra
