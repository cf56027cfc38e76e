"""Fit the start states of short windows of a run to its channels: multiple shooting.

Windows are short against the Lyapunov time, so chaos does no harm, and joined by a weak
continuity constraint: jumps add to chi2 (H. G. Bock, Springer Series in Chemical Physics 18, 102
(1981), where they are zero). Solved by Levenberg-Marquardt over the start states of all windows.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import savgol_filter

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.gap.observations.body_motion import (
    rigid_moment,
    shaft_rotations,
)
from herringbone_sim.gap.observations.windows.elimination import BlockTridiagonal, WindowJacobian
from herringbone_sim.gap.observations.windows.integrator import STATES, Forcing, WindowIntegrator
from herringbone_sim.gap.observations.windows.windows import Windows, steps_of_run

# ``jump_sd`` in the first of two fits of windows that may be in a local minimum; chosen.
LOOSE_JUMP_SD = 0.3
MAX_FIT_CHI2 = 1.5  # chi2 per reading above which states may be in a local minimum; chosen
FIT_MAX_ROUNDS = 25
FIT_TOLERANCE = 1e-3  # relative decrease of chi2 in a round below which the fit ends
# Tolerance where states are the result: those of unmeasured planets converge slower than chi2.
FINE_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class FittedStates:
    """Fitted states of W windows, as a start of another fit.

    Attributes:
        starts, states, trends, cost: see ``WindowSolution``.
    """

    starts: Array
    states: Array
    trends: Array
    cost: float

    @property
    def states_of_all(self) -> Array:
        """See ``WindowSolution``."""
        return steps_of_run(self.states)

    def reordered(self, at: Indices) -> FittedStates:
        """Copy with the 18 components of each state in the order ``at``."""
        return replace(self, starts=self.starts[:, at], states=self.states[:, :, at])


@dataclass(frozen=True)
class WindowSolution:
    """W windows integrated from given start states, with their residuals and derivatives.

    Attributes:
        integrator: of the windows.
        starts: (W, 18) start states [m], [m/s].
        states: (W, steps + 1, 18) states at every step.
        slope: (W, samples, k, 18) derivative of the channels by the state, over the noise.
        residuals: (W, samples, k) measured minus predicted, over the noise.
        jumps: (W - 1, 18) end of a window minus start of the next, over ``Windows.scale``.
        trends: (m,) amplitudes of ``Windows.trends``.
        jump_sd: see ``Windows``.
    """

    integrator: WindowIntegrator
    starts: Array
    states: Array
    slope: Array
    residuals: Array
    jumps: Array
    trends: Array
    jump_sd: float
    # No cached_property: before Python 3.12 it lets one thread at a time compute.
    _cached: dict[str, Array] = field(default_factory=dict, init=False, repr=False)

    @property
    def step_tangents(self) -> Array:
        """Derivatives (W, steps, 18, 18) of the state after each step by that before it."""
        if "step" not in self._cached:
            self._cached["step"] = self.integrator.tangents(self.starts, 1, restart=True)
        return self._cached["step"]

    @property
    def fitted(self) -> FittedStates:
        """The states alone."""
        return FittedStates(self.starts, self.states, self.trends, self.cost)

    @property
    def states_of_all(self) -> Array:
        """States (W steps + 1, 18) at every step of all windows, see ``steps_of_run``."""
        return steps_of_run(self.states)

    @property
    def cost(self) -> float:
        """Chi2: sum of squares of the residuals, and of the jumps over ``jump_sd``."""
        return float(np.sum(self.residuals**2) + np.sum(self.jumps**2) / self.jump_sd**2)


def symmetric_starts(s: Windows) -> Array:
    """Start states (W, 18) from the motion of the shafts, with all unmeasured planets in step.

    Rotations of planets follow from suns and carrier, as ``rigid_moment`` is known. Rates are
    derivatives of the rotations by a Savitzky-Golay filter.
    """
    M, run = 1.0 / s.inverse_masses, s.run
    n = s.n_windows * s.samples_per_window
    u = np.zeros((n, len(M)))
    u[:, :3] = shaft_rotations(run)[:n]
    phase = s.phase[:: 2 * s.steps_per_sample][:n]
    mean = (rigid_moment(run, phase) - 2.0 * u[:, :2] @ M[:2] - u[:, 2] * M[2]) / M[3:].sum()
    planets = run.u.recorded[3:]
    u[:, 3:] = np.where(planets, np.nan_to_num(run.u.values[:n, 3:]), mean[:, None])
    width, order = 7, 4
    smooth = savgol_filter(u, width, order, axis=0)
    rate = savgol_filter(u, width, order, deriv=1, delta=run.step_s, axis=0)
    return np.hstack([smooth, rate])[:: s.samples_per_window][: s.n_windows]


def evaluated(
    s: Windows, starts: Array, forcing: Forcing, trends: Array | None = None
) -> WindowSolution:
    """Integrate windows from start states (W, 18) and compare them with the readings.

    Args:
        trends: (m,) amplitudes of ``Windows.trends``; None: zero.
    """
    amplitudes = np.zeros(len(s.trends.size)) if trends is None else trends
    return _evaluated(s, s.integrator(forcing), starts, amplitudes)


def _evaluated(
    s: Windows, integrator: WindowIntegrator, starts: Array, trends: Array
) -> WindowSolution:
    """Windows from start states (W, 18), compared with the readings; see ``evaluated``."""
    states = integrator.states(starts)
    seen, slope = s.channel_outputs(states, integrator.forcing)
    measured = s.measured - s.trend_values(trends)
    off, slope = (measured - seen) * s.weight, slope * s.weight[..., None]
    jumps = (states[:-1, -1] - starts[1:]) / s.scale
    return WindowSolution(integrator, starts, states, slope, off, jumps, trends, s.jump_sd)


def propagators(s: Windows, integrator: WindowIntegrator, starts: Array) -> Array:
    """Derivatives (W, samples + 1, 18, 18) of the states at samples by the start states.

    The last is that of the end of the window. Start states and end are in units of
    ``Windows.scale``, the states at all other samples in m and m/s.

    Args:
        s: the windows.
        integrator: of windows of their length.
        starts: (W, 18) start states [m], [m/s].
    """
    tangents = integrator.tangents(starts, s.steps_per_sample) * s.scale
    tangents[:, -1] /= s.scale[:, None]
    first = np.broadcast_to(np.diag(s.scale), (len(starts), 1, STATES, STATES))
    return np.concatenate([first, tangents], axis=1)


def window_jacobian(s: Windows, solution: WindowSolution) -> WindowJacobian:
    """Jacobian of predicted channels and jumps by scaled start states, over the noise."""
    T = propagators(s, solution.integrator, solution.starts)
    readings = (solution.slope @ T[:, :-1]).reshape(s.n_windows, -1, STATES)
    return WindowJacobian(readings, T[:-1, -1] / s.jump_sd, 1.0 / s.jump_sd)


def stacked_residual(solution: WindowSolution) -> Array:
    """Residuals (rows,) of all channels, then minus the jumps, over the noise."""
    return np.concatenate([solution.residuals.ravel(), -solution.jumps.ravel() / solution.jump_sd])


def fitted_windows(
    s: Windows,
    starts: Array,
    forcing: Forcing,
    rounds: int = FIT_MAX_ROUNDS,
    trends: Array | None = None,
    tolerance: float = FIT_TOLERANCE,
) -> WindowSolution:
    """Fit start states and trends of windows by Levenberg-Marquardt.

    Args:
        starts, trends: initial start states (W, 18) and amplitudes (m,); trends None: zero.
        rounds: largest number of steps.
        tolerance: relative decrease of chi2 in a step below which the fit ends.

    Returns:
        Windows of the last accepted step; the initial ones if their chi2 is not finite.
    """
    solution, damping = evaluated(s, starts, forcing, trends), 1e-2
    integrator = solution.integrator
    cost = solution.cost
    of_trends = s.trend_rows()
    for _ in range(rounds if np.isfinite(cost) else 0):  # diverged windows are not fitted
        J = window_jacobian(s, solution)
        residual = stacked_residual(solution)[:, None]
        right = J.transposed_times(np.hstack([residual, of_trends]))
        diagonal = np.eye(STATES) * (np.einsum("wii->wi", J.own) + 1e-6)[:, :, None]
        while damping < 1e6:
            try:
                solved = BlockTridiagonal(J.own + damping * diagonal, J.below).solve(right)
            except np.linalg.LinAlgError:
                return solution
            trend_step = _trend_step(s, of_trends, residual, right, solved, damping)
            step = solved[:, :, 0] - solved[:, :, 1:] @ trend_step
            tried = _evaluated(
                s, integrator, solution.starts + step * s.scale, solution.trends + trend_step
            )
            now = tried.cost
            if np.isfinite(now) and now < cost:
                break
            damping *= 6.0
        else:
            return solution
        gained, cost, solution, damping = cost - now, now, tried, damping / 6.0
        if gained < tolerance * cost:
            break
    return solution


def misses_much(s: Windows, solution: WindowSolution) -> bool:
    """Whether chi2 per reading exceeds ``MAX_FIT_CHI2``, as in a local minimum."""
    return bool(solution.cost > MAX_FIT_CHI2 * np.count_nonzero(s.weight))


def fitted_loosely_first(s: Windows, solution: WindowSolution, forcing: Forcing) -> WindowSolution:
    """Fit again with loose ties between windows first, so that each follows its own readings.

    Returns:
        The fit, or ``solution`` where that leaves less.
    """
    loose = replace(s, jump_sd=LOOSE_JUMP_SD)
    apart = fitted_windows(loose, solution.starts, forcing, trends=solution.trends)
    tied = fitted_windows(s, apart.starts, forcing, trends=apart.trends)
    return min(solution, tied, key=lambda fit: fit.cost)


def _trend_step(
    s: Windows, rows: Array, residual: Array, right: Array, solved: Array, damping: float
) -> Array:
    """Levenberg-Marquardt step (m,) of the trends, with the step of the states eliminated.

    ``Trends.size`` is no prior: 1/size^2 damps a step as ``damping`` does, so that trends which
    the readings hardly determine stay finite; it is not in ``WindowSolution.cost``.

    Args:
        rows: (rows, m) of ``Windows.trend_rows``.
        residual: (rows, 1) of ``stacked_residual``.
        right: (W, 18, 1 + m) J' times ``residual`` and ``rows``; J: Jacobian by the states.
        solved: (W, 18, 1 + m) solution of the damped normal equations of the states for ``right``.
    """
    m = len(s.trends.size)
    if not m:
        return np.zeros(0)
    by_states = np.einsum("wim,wik->mk", right[:, :, 1:], solved)
    normal = rows.T @ rows
    normal += damping * np.diag(np.diag(normal)) + np.diag(s.trends.size**-2.0)
    step = np.linalg.solve(normal - by_states[:, 1:], (rows.T @ residual)[:, 0] - by_states[:, 0])
    return np.asarray(step)
