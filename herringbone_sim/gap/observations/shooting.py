"""States of short windows of a run that fit what was measured: multiple shooting.

Windows are short against the Lyapunov time and tied by a weak continuity (H. G. Bock,
Springer Series in Chemical Physics 18, 102 (1981), with jumps that cost instead of none), so that
chaos does no harm. Solved by Levenberg and Marquardt over the states of all windows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.signal import savgol_filter

from herringbone_sim.gap.data.geometry import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.body_motion import (
    inverse_masses,
    rigid_momentum,
    shaft_rotations,
)
from herringbone_sim.gap.observations.rollout import STATES, Forcing, integrate_windows
from herringbone_sim.gap.observations.window_channels import (
    WindowChannels,
    channel_outputs,
    window_channels,
)

Array = NDArray[np.float64]

STEP_RAD = 0.08  # of 1 / omega_n
INTEGRATION_ERROR = (
    3e-4  # of a channel's RMS: what such steps through contact miss of it, by test_gap_windows
)
WINDOW_RAD = (
    6.0  # of 1 / omega_n, the length of a window: two periods of the fastest mode at least
)
N_WINDOWS = 24
JUMP_SD = 0.03  # of the motion's RMS, from window to window
MAX_ROUNDS = 25
RELATIVE_TOLERANCE = 1e-3  # share of the cost: less gained in a round ends the search


@dataclass(frozen=True)
class Windows:
    """Windows of a run.

    Attributes:
        run: as prepared.
        G, inverse: see ``rollout.Drive``.
        channels: what is measured.
        measured: (W, samples, k); 0 where there is no reading.
        weight: (W, samples, k) 1 over the noise; 0 where there is no reading.
        samples, steps: of a window; steps of a sample.
        h: of a step [s].
        phase: (n,) at every half step [rad].
        first: (W,) half step at which each window starts.
        scale: (18,) of a state: RMS of the motion.
    """

    run: PreparedRun
    G: Array
    inverse: Array
    channels: WindowChannels
    measured: Array
    weight: Array
    samples: int
    steps: int
    h: float
    phase: Array
    first_half_step: NDArray[np.int64]
    scale: Array

    @property
    def n_windows(self) -> int:
        return len(self.first_half_step)

    @property
    def steps_per_sample(self) -> int:
        """Steps of a sample."""
        return self.steps // self.samples

    def in_windows(self, values: Array) -> Array:
        """Channels (n, k) as (W, samples, k), 0 where there is no reading."""
        W, samples, k = self.measured.shape
        return np.nan_to_num(values[: W * samples].reshape(W, samples, k))

    def channel_outputs(
        self, states: Array, forcing: Forcing, first: NDArray[np.int64] | None = None
    ) -> tuple[Array, Array]:
        """What channels show of states (W, steps + 1, 18), (W, samples, k), and its slope.

        Args:
            first: (W,) half step at which each window starts; None: those of the stretch.
        """
        begin = self.first_half_step if first is None else first
        at = begin[:, None] + 2 * self.steps_per_sample * np.arange(self.samples)
        return channel_outputs(self.channels, states[:, : -1 : self.steps_per_sample], forcing, at)


@dataclass(frozen=True)
class WindowSolution:
    """Windows at some states, and how they change with them.

    Attributes:
        starts: (W, 18).
        states: (W, steps + 1, 18) at every step.
        tangents: (W, steps, 18, 18) of every step.
        slope: (W, samples, k, 18) of what channels show by the state, over the noise.
        off: (W, samples, k) measured less expected, over the noise.
        jumps: (W - 1, 18) end of a window less the start of the next, over the motion's scale.
    """

    starts: Array
    states: Array
    tangents: Array
    slope: Array
    residuals: Array
    jumps: Array

    @property
    def cost(self) -> float:
        """Sum of squares, jumps over ``JUMP``."""
        return float(np.sum(self.residuals**2) + np.sum(self.jumps**2) / JUMP_SD**2)


def window_samples(run: PreparedRun) -> int:
    """Samples of a window."""
    return max(3, round(WINDOW_RAD / (run.model.scales.omega_n * run.step_s)))


def windows_of_run(run: PreparedRun, windows: int = N_WINDOWS) -> Windows:
    """The first windows of a run."""
    model, omega_n = run.model, run.model.scales.omega_n
    samples = window_samples(run)
    W = min(windows, (len(run) - 1) // samples)
    each = max(1, int(np.ceil(run.step_s * omega_n / STEP_RAD)))
    h = run.step_s / each
    n = W * samples
    at = np.arange(2 * each * n + 1) / (2 * each)
    measured = window_channels(run)
    values = measured.values[:n].reshape(W, samples, -1)
    size = np.sqrt(np.nanmean(measured.values**2, axis=0))
    motion = float(np.sqrt(np.mean(shaft_rotations(run)[:n] ** 2)))
    inverse = inverse_masses(model)
    return Windows(
        run,
        coordinates_to_meshes(model.layout) @ bodies_to_coordinates(model),
        inverse,
        measured,
        np.nan_to_num(values),
        np.isfinite(values) / np.hypot(measured.sigma, INTEGRATION_ERROR * size),
        samples,
        samples * each,
        h,
        run.phase[0] + run.omega_rad_per_s * run.step_s * at,
        2 * each * samples * np.arange(W),
        motion * np.repeat([1.0, 2.0 * run.omega_rad_per_s], STATES // 2),
    )


def symmetric_starts(s: Windows) -> Array:
    """Starts (W, 18) with all planets alike, by the momentum of the whole gear.

    What is measured of suns and carrier leaves the mean planet: the sum of M r u, r the rigid
    rotation, moves by the control alone.
    """
    M, run = 1.0 / s.inverse, s.run
    n = s.n_windows * s.samples
    u = np.zeros((n, len(M)))
    u[:, :3] = shaft_rotations(run)[:n]
    phase = s.phase[:: 2 * s.steps_per_sample][:n]
    mean = (rigid_momentum(run, phase) - 2.0 * u[:, :2] @ M[:2] - u[:, 2] * M[2]) / M[3:].sum()
    planets = run.u.there[3:]
    u[:, 3:] = np.where(planets, np.nan_to_num(run.u.values[:n, 3:]), mean[:, None])
    width, order = 7, 4
    smooth = savgol_filter(u, width, order, axis=0)
    rate = savgol_filter(u, width, order, deriv=1, delta=run.step_s, axis=0)
    return np.hstack([smooth, rate])[:: s.samples][: s.n_windows]


def evaluated(s: Windows, starts: Array, forcing: Forcing) -> WindowSolution:
    """Windows from some starts."""
    states, tangents = integrate_windows(starts, s.first_half_step, s.steps, s.h, forcing)
    seen, slope = s.channel_outputs(states, forcing)
    off, slope = (s.measured - seen) * s.weight, slope * s.weight[..., None]
    return WindowSolution(
        starts, states, tangents, slope, off, (states[:-1, -1] - starts[1:]) / s.scale
    )


def propagators(s: Windows, tangents: Array) -> Array:
    """(W, samples + 1, 18, 18) from the start of windows to their samples, over the scale."""
    found = np.empty((len(tangents), s.samples + 1, STATES, STATES))
    _propagate(tangents, np.diag(s.scale), s.steps_per_sample, found)
    found[:, -1] /= s.scale[:, None]
    return found


@njit(cache=True, nogil=True)
def _propagate(tangents, start, each, found):  # type: ignore[no-untyped-def]
    """Products of the tangents (W, steps, n, n) of windows from a start (n, n), at samples."""
    for w in range(len(tangents)):
        now = start.copy()
        found[w, 0] = now
        for q in range(tangents.shape[1]):
            now = np.dot(tangents[w, q], now)
            if (q + 1) % each == 0:
                found[w, (q + 1) // each] = now


def jacobian(s: Windows, solution: WindowSolution) -> Array:
    """(rows, 18 W) of what is measured, over its noise, and of the jumps, by all starts."""
    W, k = s.n_windows, s.measured.shape[2]
    T = propagators(s, solution.tangents)
    data = np.zeros((W, s.samples * k, W, STATES))
    ties = np.zeros((W - 1, STATES, W, STATES))
    seen = solution.slope @ T[:, :-1]
    at = np.arange(W)
    data[at, :, at] = seen.reshape(W, -1, STATES)
    ties[at[:-1], :, at[:-1]] = T[:-1, -1] / JUMP_SD
    ties[at[:-1], :, at[1:]] = -np.eye(STATES) / JUMP_SD
    columns = W * STATES
    return np.vstack([data.reshape(-1, columns), ties.reshape(-1, columns)])


def stacked_residual(solution: WindowSolution) -> Array:
    """(rows,) measured less expected, and jumps that are expected to be none."""
    return np.concatenate([solution.residuals.ravel(), -solution.jumps.ravel() / JUMP_SD])


def fitted_windows(
    s: Windows, starts: Array, forcing: Forcing, rounds: int = MAX_ROUNDS
) -> WindowSolution:
    """States that fit best, by Levenberg and Marquardt; a window meets its neighbours alone."""
    solution, damping = evaluated(s, starts, forcing), 1e-2
    cost = solution.cost
    for _ in range(rounds if np.isfinite(cost) else 0):  # a change may be one that no gear stands
        band, right = _normal_bands(s, solution)
        while damping < 1e6:
            whole = band.copy()
            whole[0] += damping * (band[0] + 1e-6)
            try:
                step = solveh_banded(whole, right, lower=True).reshape(starts.shape) * s.scale
            except np.linalg.LinAlgError:
                return solution
            tried = evaluated(s, solution.starts + step, forcing)
            now = tried.cost
            if np.isfinite(now) and now < cost:
                break
            damping *= 6.0
        else:
            return solution
        gained, cost, solution, damping = cost - now, now, tried, damping / 6.0
        if gained < RELATIVE_TOLERANCE * cost:
            break
    return solution


def _normal_bands(s: Windows, solution: WindowSolution) -> tuple[Array, Array]:
    """Lower bands (36, 18 W) of the normal matrix of all starts, and its right side (18 W,)."""
    T, W = propagators(s, solution.tangents), s.n_windows
    seen = (solution.slope @ T[:, :-1]).reshape(W, -1, STATES)
    right = np.einsum("wrs,wr->ws", seen, solution.residuals.reshape(W, -1))
    own = seen.transpose(0, 2, 1) @ seen
    end = T[:-1, -1] / JUMP_SD
    own[:-1] += end.transpose(0, 2, 1) @ end
    own[1:] += np.eye(STATES) / JUMP_SD**2
    right[:-1] -= np.einsum("wrs,wr->ws", end, solution.jumps / JUMP_SD)
    right[1:] += solution.jumps / JUMP_SD**2
    below = -end / JUMP_SD
    band = np.zeros((2 * STATES, W * STATES))
    columns = np.arange(W) * STATES
    for j in range(STATES):
        for i in range(j, STATES):
            band[i - j, columns + j] = own[:, i, j]
        for i in range(STATES):
            band[STATES + i - j, columns[:-1] + j] = below[:, i, j]
    return band, right.ravel()
