"""States of short windows of a run that fit what was measured: multiple shooting.

Windows are short against the Lyapunov time and tied by a weak continuity (H. G. Bock,
Springer Series in Chemical Physics 18, 102 (1981), with jumps that cost instead of none), so that
chaos does no harm. Solved by Levenberg and Marquardt over the states of all windows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.signal import savgol_filter

from herringbone_sim.gap.data.geometry import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.rollout import STATES, Drive, roll

Array = NDArray[np.float64]

STEP = 0.08  # of 1 / omega_n: fourth order misses 1e-4 of a force a mesh cycle
NATURAL = 6.0  # of 1 / omega_n, the length of a window: two periods of the fastest mode at least
WINDOWS = 24
JUMP = 0.03  # of the motion's RMS, from window to window
ROUNDS = 25
SETTLED = 1e-3  # share of the cost: less gained in a round ends the search


@dataclass(frozen=True)
class Stretch:
    """Windows of a run.

    Attributes:
        run: as prepared.
        G, inverse: see ``rollout.Drive``.
        channels: (k,) bodies whose rotation is measured.
        measured, sigma: (W, samples, k) and (k,) [m].
        samples, steps: of a window; steps of a sample.
        h: of a step [s].
        phase: (n,) at every half step [rad].
        first: (W,) half step at which each window starts.
        scale: (18,) of a state: RMS of the motion.
    """

    run: PreparedRun
    G: Array
    inverse: Array
    channels: NDArray[np.int64]
    measured: Array
    sigma: Array
    samples: int
    steps: int
    h: float
    phase: Array
    first: NDArray[np.int64]
    scale: Array

    @property
    def windows(self) -> int:
        return len(self.first)

    def seen(self, states: Array) -> Array:
        """(W, samples, k) what the sensors would show of states (W, steps + 1, 18)."""
        shown: Array = states[:, : -1 : self.steps // self.samples][:, :, self.channels]
        return shown


@dataclass(frozen=True)
class Shot:
    """Windows at some states, and how they change with them.

    Attributes:
        starts: (W, 18).
        states: (W, steps + 1, 18) at every step.
        tangents: (W, steps, 18, 18) of every step.
        off: (W, samples, k) measured less expected, over the noise.
        jumps: (W - 1, 18) end of a window less the start of the next, over the motion's scale.
    """

    starts: Array
    states: Array
    tangents: Array
    off: Array
    jumps: Array

    @property
    def cost(self) -> float:
        """Sum of squares, jumps over ``JUMP``."""
        return float(np.sum(self.off**2) + np.sum(self.jumps**2) / JUMP**2)


def stretch(run: PreparedRun, windows: int = WINDOWS) -> Stretch:
    """The first windows of a run."""
    model, omega_n = run.model, run.model.scales.omega_n
    samples = max(3, round(NATURAL / (omega_n * run.step_s)))
    W = min(windows, (len(run) - 1) // samples)
    each = max(1, int(np.ceil(run.step_s * omega_n / STEP)))
    h = run.step_s / each
    n = W * samples
    at = np.arange(2 * each * n + 1) / (2 * each)
    there = run.u.there
    motion = float(np.sqrt(np.mean(run.u.values[:n, there] ** 2)))
    inverse = np.concatenate(
        [model.packed.inv_M_s, [1.0 / model.scales.M_c], model.packed.inv_M_p.ravel()]
    )
    return Stretch(
        run,
        coordinates_to_meshes(model.layout) @ bodies_to_coordinates(model),
        inverse,
        np.flatnonzero(there),
        run.u.values[:n, there].reshape(W, samples, -1),
        run.u.sigma[there],
        samples,
        samples * each,
        h,
        run.phase[0] + run.omega_rad_per_s * run.step_s * at,
        2 * each * samples * np.arange(W),
        motion * np.repeat([1.0, 2.0 * run.omega_rad_per_s], STATES // 2),
    )


def loads(s: Stretch) -> Array:
    """(n, 9) forces on the bodies by both torques and the control [N]."""
    model = s.run.model
    p, sc, packed = model.parameters, model.scales, model.packed
    tau = np.zeros((len(s.phase), len(s.inverse)))
    tau[:, :2] = p.T_1 / (2.0 * sc.r_bs)
    wave = np.cos(packed.control_order * (s.phase - s.run.late_rad) + packed.control_phase)
    control = packed.K * sc.b_c * sc.omega_n**2 / sc.cos_beta * sc.M_c
    tau[:, 2] = -sc.T_2 / sc.r_bc + control * wave
    return tau


def symmetric(s: Stretch) -> Array:
    """Starts (W, 18) with all planets alike, by the momentum of the whole gear.

    What is measured of suns and carrier leaves the mean planet: the sum of M r u, r the rigid
    rotation, moves by the control alone.
    """
    M, model, omega = 1.0 / s.inverse, s.run.model, s.run.omega_rad_per_s
    sc, packed = model.scales, model.packed
    seen = s.measured.reshape(-1, len(s.channels))
    u = np.zeros((len(seen), len(M)))
    u[:, s.channels] = seen
    phase = s.phase[:: 2 * s.steps // s.samples][: len(seen)]
    push = packed.K * sc.b_c * sc.omega_n**2 / sc.cos_beta * M[2]
    turn = packed.control_order * omega
    wave = np.cos(packed.control_order * (phase - s.run.late_rad) + packed.control_phase)
    momentum = -push * wave / turn**2
    mean = (momentum - 2.0 * u[:, :2] @ M[:2] - u[:, 2] * M[2]) / M[3:].sum()
    unseen = np.setdiff1d(np.arange(3, len(M)), s.channels)
    u[:, unseen] = mean[:, None]
    width, order = 7, 4
    smooth = savgol_filter(u, width, order, axis=0)
    rate = savgol_filter(u, width, order, deriv=1, delta=s.run.step_s, axis=0)
    return np.hstack([smooth, rate])[:: s.samples][: s.windows]


def shoot(s: Stretch, starts: Array, drive: Drive) -> Shot:
    """Windows from some starts."""
    states, tangents = roll(starts, s.first, s.steps, s.h, drive)
    off = (s.measured - s.seen(states)) / s.sigma
    return Shot(starts, states, tangents, off, (states[:-1, -1] - starts[1:]) / s.scale)


def propagators(s: Stretch, tangents: Array) -> Array:
    """(W, samples + 1, 18, 18) from the start of windows to their samples, over the scale."""
    each = s.steps // s.samples
    now = np.broadcast_to(np.diag(s.scale), (len(tangents), STATES, STATES))
    found = np.empty((len(tangents), s.samples + 1, STATES, STATES))
    found[:, 0] = now
    for q in range(s.steps):
        now = tangents[:, q] @ now
        if (q + 1) % each == 0:
            found[:, (q + 1) // each] = now
    found[:, -1] /= s.scale[:, None]
    return found


def jacobian(s: Stretch, T: Array) -> Array:
    """(rows, 18 W) of what is measured, over its noise, and of the jumps, by all starts."""
    W, k = s.windows, len(s.channels)
    data = np.zeros((W, s.samples * k, W, STATES))
    ties = np.zeros((W - 1, STATES, W, STATES))
    seen = T[:, :-1][:, :, s.channels] / s.sigma[:, None]
    at = np.arange(W)
    data[at, :, at] = seen.reshape(W, -1, STATES)
    ties[at[:-1], :, at[:-1]] = T[:-1, -1] / JUMP
    ties[at[:-1], :, at[1:]] = -np.eye(STATES) / JUMP
    columns = W * STATES
    return np.vstack([data.reshape(-1, columns), ties.reshape(-1, columns)])


def residual(shot: Shot) -> Array:
    """(rows,) measured less expected, and jumps that are expected to be none."""
    return np.concatenate([shot.off.ravel(), -shot.jumps.ravel() / JUMP])


def fitted(s: Stretch, starts: Array, drive: Drive, rounds: int = ROUNDS) -> Shot:
    """States that fit best, by Levenberg and Marquardt; a window meets its neighbours alone."""
    shot, damping = shoot(s, starts, drive), 1e-2
    cost = shot.cost
    for _ in range(rounds):
        band, right = _normal(s, shot)
        while damping < 1e6:
            whole = band.copy()
            whole[0] += damping * (band[0] + 1e-6)
            step = solveh_banded(whole, right, lower=True).reshape(starts.shape) * s.scale
            tried = shoot(s, shot.starts + step, drive)
            now = tried.cost
            if np.isfinite(now) and now < cost:
                break
            damping *= 6.0
        else:
            return shot
        gained, cost, shot, damping = cost - now, now, tried, damping / 6.0
        if gained < SETTLED * cost:
            break
    return shot


def _normal(s: Stretch, shot: Shot) -> tuple[Array, Array]:
    """Lower bands (36, 18 W) of the normal matrix of all starts, and its right side (18 W,)."""
    T, W = propagators(s, shot.tangents), s.windows
    seen = (T[:, :-1][:, :, s.channels] / s.sigma[:, None]).reshape(W, -1, STATES)
    right = np.einsum("wrs,wr->ws", seen, shot.off.reshape(W, -1))
    own = seen.transpose(0, 2, 1) @ seen
    end = T[:-1, -1] / JUMP
    own[:-1] += end.transpose(0, 2, 1) @ end
    own[1:] += np.eye(STATES) / JUMP**2
    right[:-1] -= np.einsum("wrs,wr->ws", end, shot.jumps / JUMP)
    right[1:] += shot.jumps / JUMP**2
    below = -end / JUMP
    band = np.zeros((2 * STATES, W * STATES))
    columns = np.arange(W) * STATES
    for j in range(STATES):
        for i in range(j, STATES):
            band[i - j, columns + j] = own[:, i, j]
        for i in range(STATES):
            band[STATES + i - j, columns[:-1] + j] = below[:, i, j]
    return band, right.ravel()

