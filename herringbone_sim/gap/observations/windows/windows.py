"""Short windows of a run: readings of its channels, and their prediction from states.

Windows are short against the Lyapunov time, so chaos does no harm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.gap.data.kinematics import bodies_to_meshes, inverse_masses
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.body_motion import shaft_rotations
from herringbone_sim.gap.observations.windows.channels import (
    WindowChannels,
    channel_outputs,
    window_channels,
)
from herringbone_sim.gap.observations.windows.integrator import STATES, Forcing, WindowIntegrator
from herringbone_sim.gap.observations.windows.trends import Trends, trends_of

# Chosen; times in units of 1 / omega_n:
STEP_RAD = 0.08  # longest integration step
# Integration error through contact at this step over a channel's RMS, counted as noise;
# upper bound checked by test/gap/test_gap_windows.py.
INTEGRATION_ERROR = 3e-4
JUMP_SD = 0.03  # standard deviation of a jump between windows, over the RMS of the motion
WINDOW_RAD = 6.0  # length of a window: two periods of the fastest mode at least
# Windows of a run; the second number where the residual is as small as noise, so that more values
# are needed. Chosen for run time.
N_WINDOWS, MORE_WINDOWS = 24, 72


@dataclass(frozen=True)
class Windows:
    """W windows of a run with k channels.

    Attributes:
        run: the run.
        G, inverse_masses: see ``rollout.Forcing``.
        channels: channels to fit.
        measured: (W, samples, k) readings; 0 where there are none.
        weight: (W, samples, k) 1 over the noise (with integration error); 0 without reading.
        samples_per_window, steps_per_window: samples and integration steps per window.
        h: integration step [s].
        phase: (n,) mesh phase at every half step [rad].
        first_half_step: (W,) index of the half step at which each window starts.
        scale: (18,) RMS of rotations [m] and rates [m/s], for scaling.
        trends: parts of channels that the recording may lack, see ``Trends``.
        delay, clock: (k,) delay [s] and relative clock error of each channel, which shows
            y(t - delay - clock t), t from the start of the recording.
        jump_sd: standard deviation of a jump between windows, over ``scale``.
        share: (k,) 1 plus the gain error of each channel, which ``weight`` contains.
    """

    run: PreparedRun
    G: Array
    inverse_masses: Array
    channels: WindowChannels
    measured: Array
    weight: Array
    samples_per_window: int
    steps_per_window: int
    h: float
    phase: Array
    first_half_step: NDArray[np.int64]
    scale: Array
    trends: Trends
    delay: Array
    clock: Array
    jump_sd: float = JUMP_SD
    share: Array | float = 1.0

    @property
    def n_windows(self) -> int:
        """Number of windows W."""
        return len(self.first_half_step)

    @property
    def steps_per_sample(self) -> int:
        """Integration steps per sample."""
        return self.steps_per_window // self.samples_per_window

    def integrator(
        self, forcing: Forcing, first: NDArray[np.int64] | None = None
    ) -> WindowIntegrator:
        """Integrator of the windows, or of those that start at the half steps ``first``."""
        at = self.first_half_step if first is None else first
        return WindowIntegrator(at, self.steps_per_window, self.h, forcing)

    def in_windows(self, values: Array) -> Array:
        """Cut channels (n, k) into windows (W, samples, k), 0 for missing readings."""
        W, samples, k = self.measured.shape
        return np.nan_to_num(values[: W * samples].reshape(W, samples, k))

    def trend_values(self, amplitudes: Array) -> Array:
        """Sum (W, samples, k) of all trends at amplitudes (m,)."""
        return np.asarray(np.tensordot(amplitudes, self.trends.wave, 1))

    def trend_rows(self) -> Array:
        """(rows, m) decrease of ``shooting.stacked_residual`` by a unit of each trend."""
        m, jumps = len(self.trends.size), (self.n_windows - 1) * STATES
        rows = (self.trends.wave * self.weight).reshape(m, self.weight.size)
        return np.asarray(np.pad(rows, ((0, 0), (0, jumps))).T)

    def without_trends(self, amplitudes: Array) -> Windows:
        """Copy with trends of given amplitudes (m,) subtracted from the readings."""
        return replace(self, measured=self.measured - self.trend_values(amplitudes))

    def channel_outputs(
        self, states: Array, forcing: Forcing, first: NDArray[np.int64] | None = None
    ) -> tuple[Array, Array]:
        """Channels (W, samples, k) predicted from states, and derivatives (W, samples, k, 18).

        Derivatives are by the state at the same sample, not by that at the start of the window.

        Args:
            states: (W, steps + 1, 18) rotations [m] and rates [m/s] at every integration step.
            forcing: at every half step of the run.
            first: (W,) index of the half step at which each window starts, for states that don't
                belong to successive windows: a delayed channel is then read within its own
                window. None: ``first_half_step``.
        """
        alone = first is not None
        begin = self.first_half_step if first is None else first
        at = begin[:, None] + 2 * self.steps_per_sample * np.arange(self.samples_per_window)
        value, slope = channel_outputs(
            self.channels, states[:, : -1 : self.steps_per_sample], forcing, at
        )
        late = np.flatnonzero((self.delay != 0.0) | (self.clock != 0.0))
        if len(late):
            slope = slope.copy()
        for i in late.tolist():
            value[:, :, i], slope[:, :, i] = self._late_output(i, states, forcing, begin, alone)
        return value, slope

    def _late_output(
        self, i: int, states: Array, forcing: Forcing, begin: NDArray[np.int64], alone: bool
    ) -> tuple[Array, Array]:
        """Delayed channel i (W, samples) between steps, and derivatives (W, samples, 18).

        These are by the state u, v at the sample; the channel is read at u - late v, v.
        """
        at, channel = self.late_steps(i, begin, alone), self.channels.only(i)
        window, start = np.arange(len(states))[:, None], begin[:, None] // 2
        run = None if alone else steps_of_run(states)
        value, slope = np.zeros(at.middle.shape), np.zeros((*at.middle.shape, STATES))
        for q, weight in zip((-1, 0, 1), at.weights, strict=True):
            n = at.middle + q
            there = states[window, n - start] if run is None else run[n]
            shown, by_state = channel_outputs(channel, there, forcing, 2 * n)
            value += weight * shown[..., 0]
            slope += weight[..., None] * by_state[..., 0, :]
        half = STATES // 2
        slope[..., half:] -= at.late[..., None] * slope[..., :half]
        return value, slope

    def late_steps(self, i: int, begin: NDArray[np.int64], alone: bool = False) -> LateSteps:
        """Interpolation of delayed channel i between steps of the windows.

        Args:
            begin: (W,) index of the half step at which each window starts.
            alone: whether to use steps of the same window only, else those of all windows. Beyond
                these, the parabola is extrapolated by three steps and constant from there.
        """
        sample = np.arange(self.samples_per_window)
        since = self.run.times[0] + 0.5 * self.h * begin[:, None] + self.run.step_s * sample
        late = self.delay[i] + self.clock[i] * since
        start = begin[:, None] // 2
        first, last = (
            (start + 1, start + self.steps_per_window - 1)
            if alone
            else (np.int64(1), np.int64(self.n_windows * self.steps_per_window - 1))
        )
        at = np.clip(start + self.steps_per_sample * sample - late / self.h, first - 3, last + 3)
        middle = np.clip(np.rint(at), first, last).astype(np.int64)
        d = at - middle
        return LateSteps(
            since,
            late,
            middle,
            np.stack([0.5 * d * (d - 1.0), 1.0 - d**2, 0.5 * d * (d + 1.0)]),
            np.stack([0.5 - d, 2.0 * d, -0.5 - d]) / self.h,
        )


class LateSteps(NamedTuple):
    """Interpolation of a delayed channel by the parabola through three steps.

    Attributes:
        since: (W, samples) time since the start of the recording [s].
        late: (W, samples) by how much the channel is late [s].
        middle: (W, samples) index, among all steps of the run, of the middle one of the three.
        weights: (3, W, samples) of the steps.
        by_delay: (3, W, samples) their derivatives by the delay [1/s].
    """

    since: Array
    late: Array
    middle: NDArray[np.int64]
    weights: Array
    by_delay: Array


def steps_of_run(states: Array) -> Array:
    """States (W steps + 1, 18) at every step of all windows; where two meet, the later window's.

    Args:
        states: (W, steps + 1, 18).
    """
    return np.vstack([states[:, :-1].reshape(-1, STATES), states[-1, -1:]])


def window_samples(run: PreparedRun) -> int:
    """Samples per window of a run: ``WINDOW_RAD`` / omega_n at its sample rate, at least 3."""
    return max(3, round(WINDOW_RAD / (run.model.scales.omega_n * run.step_s)))


def windows_of_run(run: PreparedRun, windows: int = N_WINDOWS) -> Windows:
    """Cut a run, from its first sample, into at most ``windows`` windows."""
    model, omega_n = run.model, run.model.scales.omega_n
    samples = window_samples(run)
    W = min(windows, (len(run) - 1) // samples)
    each = max(1, int(np.ceil(run.step_s * omega_n / STEP_RAD)))
    h = run.step_s / each
    n = W * samples
    at = np.arange(2 * each * n + 1) / (2 * each)
    measured = window_channels(run)
    values = measured.values[:n].reshape(W, samples, -1)
    seen = np.maximum(np.isfinite(measured.values).sum(axis=0), 1)  # a gauge may see no planet
    size = np.sqrt(np.nansum(measured.values**2, axis=0) / seen)
    motion = float(np.sqrt(np.mean(shaft_rotations(run)[:n] ** 2)))
    inverse = inverse_masses(model)
    return Windows(
        run,
        bodies_to_meshes(model),
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
        trends_of(run, measured, motion, (W, samples)),
        np.zeros(len(measured.names)),
        np.zeros(len(measured.names)),
    )
