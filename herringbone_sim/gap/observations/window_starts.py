"""States to start windows from: an iterated Kalman filter from window to window.

The mean planet follows from suns and carrier at once, the differences between planets only as they
act on the suns. Several first states are carried through all windows side by side, one with all
planets in step and others out of it; the one that the windows believe most is taken.
B. M. Bell and F. W. Cathey, IEEE Trans. Autom. Control 38, 294 (1993).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.observations.rollout import STATES, Forcing, integrate_windows
from herringbone_sim.gap.observations.shooting import (
    JUMP_SD,
    Windows,
    WindowSolution,
    fitted_windows,
    propagators,
    symmetric_starts,
)

Array = NDArray[np.float64]

OUT_OF_STEP = (0.1, 0.3, 0.6)  # of the motion's RMS, a first state each
N_FITTED = 2  # of the first states are fitted to the end
MAX_ROUNDS = 8
RELATIVE_TOLERANCE = 1e-2  # share of the cost of a window


def filter_and_fit(
    s: Windows, forcing: Forcing, whole: Windows, of_whole: Forcing
) -> WindowSolution:
    """The states that fit best, with planets in step or not.

    Args:
        whole: the same windows with some before them, in which the filter finds the motion;
            ``of_whole`` drives it.
    """
    starts, cost = filtered_starts(whole, of_whole, first_states(whole))
    starts = starts[:, whole.n_windows - s.n_windows :]
    found = [fitted_windows(s, starts[i], forcing) for i in np.argsort(cost)[:N_FITTED]]
    return min(found, key=lambda solution: solution.cost)


def first_states(s: Windows) -> Array:
    """(K, 18) of the first window: all planets in step, then out of it at random."""
    rng = np.random.default_rng(0)
    in_step = symmetric_starts(s)[0]
    hidden = 3 + np.flatnonzero(~s.run.u.there[3:])
    found = [in_step]
    for share in OUT_OF_STEP if len(hidden) > 1 else ():
        off = np.zeros((2, STATES // 2))
        off[:, hidden] = rng.standard_normal((2, len(hidden)))
        off[:, hidden] -= off[:, hidden].mean(axis=1, keepdims=True)
        found.append(in_step + share * off.ravel() * s.scale)
    return np.array(found)


def filtered_starts(s: Windows, forcing: Forcing, first: Array) -> tuple[Array, Array]:
    """Starts (K, W, 18) of all windows from first states (K, 18), and what each costs (K,).

    Nothing is known of a first state; a window starts where the one before ends, within ``JUMP``.
    """
    K, eye = len(first), np.eye(STATES)
    found, cost = np.empty((K, s.n_windows, STATES)), np.zeros(K)
    expected = first / s.scale
    spread = np.asarray(np.broadcast_to(eye, (K, STATES, STATES)), dtype=np.float64)
    for w in range(s.n_windows):
        precision = np.asarray(np.linalg.inv(spread), dtype=np.float64)
        z, now, normal, passed, end = _window(s, forcing, w, expected, precision)
        found[:, w] = z * s.scale
        cost += now
        expected = end
        spread = passed @ np.linalg.inv(normal) @ passed.transpose(0, 2, 1) + JUMP_SD**2 * eye
        spread = np.asarray(0.5 * (spread + spread.transpose(0, 2, 1)), dtype=np.float64)
    return found, cost


def _window(
    s: Windows, forcing: Forcing, w: int, expected: Array, precision: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """States (K, 18) of a window, over the scale, with a prior: Levenberg and Marquardt.

    Returns:
        them, their costs (K,), normal matrices and propagators to the end (K, 18, 18), and the
        states at the end (K, 18).
    """
    K = len(expected)
    first = np.full(K, s.first_half_step[w])

    def at(z: Array) -> tuple[Array, ...]:
        states, tangents = integrate_windows(z * s.scale, first, s.steps, s.h, forcing)
        seen, slope = s.channel_outputs(states, forcing, first)
        off = (s.measured[w] - seen) * s.weight[w]
        away = z - expected
        cost = (off**2).sum(axis=(1, 2)) + np.einsum("ki,kij,kj->k", away, precision, away)
        return states, tangents, slope * s.weight[w][..., None], off, cost

    z, damping = expected.copy(), np.full(K, 1e-2)
    states, tangents, slope, off, cost = at(z)
    for number in range(MAX_ROUNDS + 1):
        T = propagators(s, tangents)
        J = (slope @ T[:, :-1]).reshape(K, -1, STATES)
        normal = J.transpose(0, 2, 1) @ J + precision
        if number == MAX_ROUNDS:
            break
        right = np.einsum("kri,kr->ki", J, off.reshape(K, -1))
        right -= np.einsum("kij,kj->ki", precision, z - expected)
        more = np.einsum("k,kii->ki", damping, normal)[:, :, None] * np.eye(STATES)
        step = np.linalg.solve(normal + more, right[:, :, None])[:, :, 0]
        *new, now = at(z + step)
        better = now < cost
        gained = np.where(better, cost - now, 0.0)
        z, cost = np.where(better[:, None], z + step, z), np.minimum(now, cost)
        states, tangents, slope, off = (
            np.where(better.reshape(-1, *(1,) * (a.ndim - 1)), a, b)
            for a, b in zip(new, (states, tangents, slope, off), strict=True)
        )
        damping *= np.where(better, 1.0 / 6.0, 6.0)
        if np.all(gained < RELATIVE_TOLERANCE * cost) and better.any():
            break
    return z, cost, normal, T[:, -1], states[:, -1] / s.scale
