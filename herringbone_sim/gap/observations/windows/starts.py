"""Start states for windows by an iterated Kalman filter from window to window.

The mean motion of planets follows directly from suns and carrier; differences between planets show
only in their action on the suns. So several initial states, planets in step and out of step, are
filtered through all windows, and the best are fitted.
B. M. Bell and F. W. Cathey, IEEE Trans. Autom. Control 38, 294 (1993).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.gap.observations.windows.integrator import STATES, Forcing
from herringbone_sim.gap.observations.windows.shooting import (
    WindowSolution,
    fitted_loosely_first,
    fitted_windows,
    misses_much,
    propagators,
    symmetric_starts,
)
from herringbone_sim.gap.observations.windows.windows import Windows

OUT_OF_STEP = (0.1, 0.3, 0.6)  # initial differences between planets over the motion's RMS, chosen
N_FITTED = 2  # initial states fitted to convergence
# Passes of filter and fit where rotations may lack their mean or the rigid swing; each takes the
# trends of the best fit before it off the readings.
N_FILTERED = 3
N_LOOSE = 4  # fits that are made again with loose ties where the best misses much
# Process noise of further filters where the best fit misses much: motion under another law than
# the nominal one needs more; chosen.
FILTER_JUMP_SD = (0.1, 0.3)
FILTER_MAX_ROUNDS = 8
FILTER_TOLERANCE = 1e-2  # relative decrease of a window's chi2 below which its fit ends


def filter_and_fit(
    s: Windows, forcing: Forcing, with_lead: Windows, forcing_with_lead: Forcing
) -> WindowSolution:
    """Filter several initial states, fit the best, and return the best fit.

    Where that misses much, filters with more process noise and fits with loose ties are tried too.

    Args:
        s, forcing: windows to fit, and their forcing.
        with_lead, forcing_with_lead: windows that begin earlier, so that the filter
            converges before those of ``s``, and their forcing.
    """

    def tried(trends: Array, jump_sd: float) -> Iterator[WindowSolution]:
        """Fits without ``trends`` from the best filtered starts; see ``Windows.jump_sd``."""
        right = replace(with_lead.without_trends(trends), jump_sd=jump_sd)
        starts, cost = filtered_starts(right, forcing_with_lead, initial_states(right))
        starts = starts[:, with_lead.n_windows - s.n_windows :]
        return (
            fitted_windows(s, starts[i], forcing, trends=trends)
            for i in np.argsort(cost)[:N_FITTED]
        )

    fits: list[WindowSolution] = []
    trends = np.zeros(len(s.trends.size))
    lacking = not s.run.means_known or bool(s.run.model.packed.K and s.run.u.recorded.any())
    for _ in range(N_FILTERED if lacking else 1):
        fits += tried(trends, with_lead.jump_sd)
        trends = min(fits, key=lambda solution: solution.cost).trends
    usable = [fit for fit in fits if np.isfinite(fit.cost)] or fits[:1]
    best = min(usable, key=lambda solution: solution.cost)
    if not np.isfinite(best.cost) or not misses_much(s, best):
        return best
    for jump_sd in FILTER_JUMP_SD:
        try:
            more = tried(trends, jump_sd)
        except np.linalg.LinAlgError:
            continue
        usable += [fit for fit in more if np.isfinite(fit.cost)]
    usable = sorted(usable, key=lambda solution: solution.cost)[:N_LOOSE]
    again = (fitted_loosely_first(s, solution, forcing) for solution in usable)
    return min(again, key=lambda solution: solution.cost)


def initial_states(s: Windows) -> Array:
    """Initial states (K, 18): planets in step, then with random differences (fixed seed)."""
    rng = np.random.default_rng(0)
    in_step = symmetric_starts(s)[0]
    hidden = 3 + np.flatnonzero(~s.run.u.recorded[3:])
    states = [in_step]
    for share in OUT_OF_STEP if len(hidden) > 1 else ():
        off = np.zeros((2, STATES // 2))
        off[:, hidden] = rng.standard_normal((2, len(hidden)))
        off[:, hidden] -= off[:, hidden].mean(axis=1, keepdims=True)
        states.append(in_step + share * off.ravel() * s.scale)
    return np.array(states)


def filtered_starts(s: Windows, forcing: Forcing, first: Array) -> tuple[Array, Array]:
    """Filter initial states (K, 18) through all windows, each by its own filter.

    The prior of the first window is broad (the RMS of the motion); those of later windows are
    predictions with process noise ``Windows.jump_sd``.

    Returns:
        Start states (K, W, 18) and total chi2 (K,).
    """
    K, eye = len(first), np.eye(STATES)
    starts, cost = np.empty((K, s.n_windows, STATES)), np.zeros(K)
    expected = first / s.scale
    spread = np.asarray(np.broadcast_to(eye, (K, STATES, STATES)), dtype=np.float64)
    for w in range(s.n_windows):
        precision = np.asarray(np.linalg.inv(spread), dtype=np.float64)
        z, now, normal, passed, end = _window(s, forcing, w, expected, precision)
        starts[:, w] = z * s.scale
        cost += now
        expected = end
        spread = passed @ np.linalg.inv(normal) @ passed.transpose(0, 2, 1) + s.jump_sd**2 * eye
        spread = np.asarray(0.5 * (spread + spread.transpose(0, 2, 1)), dtype=np.float64)
    return starts, cost


def _window(
    s: Windows, forcing: Forcing, w: int, expected: Array, precision: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Fit scaled start states (K, 18) of window w with a Gaussian prior by Levenberg-Marquardt.

    Args:
        expected, precision: mean (K, 18) and inverse covariance (K, 18, 18) of the prior.

    Returns:
        All scaled: start states (K, 18), chi2 with prior (K,), normal matrices (K, 18, 18),
        derivatives of the end by the start (K, 18, 18) and states at the end (K, 18).
    """
    K = len(expected)
    first = np.full(K, s.first_half_step[w])
    integrator = s.integrator(forcing, first)

    def evaluate(z: Array) -> tuple[Array, ...]:
        """End of the window, channel derivatives, residuals, chi2 at scaled starts z (K, 18)."""
        states = integrator.states(z * s.scale)
        seen, slope = s.channel_outputs(states, forcing, first)
        off = (s.measured[w] - seen) * s.weight[w]
        away = z - expected
        cost = (off**2).sum(axis=(1, 2)) + np.einsum("ki,kij,kj->k", away, precision, away)
        return states[:, -1], slope * s.weight[w][..., None], off, cost

    z, damping = expected.copy(), np.full(K, 1e-2)
    end, slope, off, cost = evaluate(z)
    for number in range(FILTER_MAX_ROUNDS + 1):
        T = propagators(s, integrator, z * s.scale)
        J = (slope @ T[:, :-1]).reshape(K, -1, STATES)
        normal = J.transpose(0, 2, 1) @ J + precision
        if number == FILTER_MAX_ROUNDS:
            break
        right = np.einsum("kri,kr->ki", J, off.reshape(K, -1))
        right -= np.einsum("kij,kj->ki", precision, z - expected)
        more = np.einsum("k,kii->ki", damping, normal)[:, :, None] * np.eye(STATES)
        step = np.linalg.solve(normal + more, right[:, :, None])[:, :, 0]
        *new, now = evaluate(z + step)
        better = now < cost
        gained = np.where(better, cost - now, 0.0)
        z, cost = np.where(better[:, None], z + step, z), np.minimum(now, cost)
        end, slope, off = (
            np.where(better.reshape(-1, *(1,) * (a.ndim - 1)), a, b)
            for a, b in zip(new, (end, slope, off), strict=True)
        )
        damping *= np.where(better, 1.0 / 6.0, 6.0)
        if np.all(gained < FILTER_TOLERANCE * cost) and better.any():
            break
    return z, cost, normal, T[:, -1], end / s.scale
