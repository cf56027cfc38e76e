"""What the rig's encoders and force sensors would show of a run: exact, then with noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.practice.machine import (
    BODIES,
    MESHES,
    N_BODY,
    N_COORDINATE,
    NOMINAL,
    Array,
    Constants,
    Machine,
    half_backlash,
    machine,
)
from herringbone_sim.practice.stepper import integrate

HEAD = ("t", "phase", "K", "delta_T", "T_1")
SAMPLES_PER_CYCLE = 24
CYCLES = 120
TRANSIENT = 80
CHANNEL_SETS = {
    "full": (*(f"{a}_{m}" for a in "xvF" for m in MESHES), *(f"u_{b}" for b in BODIES)),
    "no_force": tuple(f"{a}_{m}" for a in "xv" for m in MESHES),
    "few": ("u_s_L", "u_s_R", "u_c"),
}


@dataclass(frozen=True)
class Motion:
    """A run as it was, without sensors.

    Attributes:
        times: (n,) [s] from 0 on; ``phase`` (n,) [rad].
        x, v, force: (n, 12) as the recording contract has them, with the nominal e(t).
        u: (n, 9) displacements, the linear trend of the rigid rotation removed.
        extra: (n, 9) what acts on the bodies besides mesh forces, T_1, T_2 and K [N].
    """

    times: Array
    phase: Array
    x: Array
    v: Array
    force: Array
    u: Array
    extra: Array


def record_motion(
    p: Machine, phase0: float, start: Array, lags: tuple[float, ...] = ()
) -> tuple[Motion, tuple[Motion, ...]]:
    """Run past the transient and sample; also what was a lag [s] before each sample.

    Args:
        phase0: mesh phase [rad] at the first sample kept.
        start: (30,) state in which the transient starts.
    """
    step = 2.0 * np.pi / SAMPLES_PER_CYCLE / p.omega
    lead = TRANSIENT * SAMPLES_PER_CYCLE * step
    own = lead + step * np.arange(CYCLES * SAMPLES_PER_CYCLE)
    wanted = np.concatenate([own, *(own - lag for lag in lags)])
    times, back = np.unique(np.concatenate([[0.0], wanted]), return_inverse=True)
    states, force, extra = integrate(p, phase0 - p.omega * lead, start, times)
    parts = np.split(back[1:], 1 + len(lags))
    at: Array = np.asarray(own - lead, dtype=np.float64)
    phase: Array = phase0 + p.omega * np.asarray(times - lead, dtype=np.float64)
    now, *before = (_seen(p, at, phase[i], states[i], force[i], extra[i]) for i in parts)
    return now, tuple(before)


def _seen(
    p: Machine, times: Array, phase: Array, states: Array, force: Array, extra: Array
) -> Motion:
    u, rate = states[:, :N_BODY], states[:, N_COORDINATE : N_COORDINATE + N_BODY]
    e = NOMINAL.e_sp
    x = geometry(u) * p.cos_beta - e * np.sin(phase)[:, None]
    v = geometry(rate) * p.cos_beta - e * p.omega * np.cos(phase)[:, None]
    kept = _without_trend(u, p.mass[:N_BODY], times)
    return Motion(times, phase, x, v, force, kept, extra[:, :N_BODY])


def geometry(u: Array) -> Array:
    """Deflections (n, 12) of Eqs. (15), (16) over cos beta, without errors, of bodies (n, 9)."""
    suns = np.repeat(u[:, :2], 3, axis=1)
    planets, carrier = u[:, 3:9], u[:, 2:3]
    return np.concatenate([suns - planets - carrier, planets - carrier], axis=1)


def _without_trend(u: Array, mass: Array, times: Array) -> Array:
    rigid = np.array([2.0, 2.0, 1.0, *[1.0] * 6])
    along = u @ (rigid * mass) / float(rigid**2 @ mass)
    trend = np.polyval(np.polyfit(times, along, 1), times)
    kept: Array = u - trend[:, None] * rigid
    return kept


def channels_of(motion: Motion) -> dict[str, Array]:
    """All measured channels by name, exact, the head left out."""
    named = {f"x_{m}": motion.x[:, j] for j, m in enumerate(MESHES)}
    named |= {f"v_{m}": motion.v[:, j] for j, m in enumerate(MESHES)}
    named |= {f"F_{m}": motion.force[:, j] for j, m in enumerate(MESHES)}
    return named | {f"u_{b}": motion.u[:, j] for j, b in enumerate(BODIES)}


def with_noise(exact: Mapping[str, Array], share: float, rng: Generator) -> dict[str, Array]:
    """White noise of a share of each channel's RMS, then the steps of a converter.

    A step is the power of two at most an eighth of the noise.
    """
    noisy = {}
    for name, values in exact.items():
        sigma = share * float(np.sqrt(np.mean(values**2)))
        drawn = values + sigma * rng.normal(size=len(values))
        step = 2.0 ** np.floor(np.log2(sigma / 8.0)) if sigma > 0.0 else 0.0
        noisy[name] = np.round(drawn / step) * step if step > 0.0 else drawn
    return noisy


def series_of(
    motion: Motion,
    measured: Mapping[str, Array],
    point: Mapping[str, float],
    names: tuple[str, ...],
) -> TimeSeries:
    """The recording: head and the measured channels of a set."""
    n = len(motion.times)
    set_to = [np.full(n, float(point[name])) for name in HEAD[2:]]
    times = measured.get("t", motion.times)
    head = [times, motion.phase, *set_to]
    columns = np.stack([*head, *(measured[name] for name in names)], axis=1)
    return TimeSeries(times, columns, (*HEAD, *names))


def law_force(c: Constants, point: Mapping[str, float], phase: Array, x: Array, v: Array) -> Array:
    """k(t) f(x) + c v (n, 12) [N] of a rig without effect."""
    p = machine(c, point)
    half = half_backlash(c, point["delta_T"])
    flank = x - np.clip(x, -half, half)
    k = p.stiffness * (1.0 + c.k_amp * np.cos(phase))[:, None]
    force: Array = k * flank + p.damping * v
    return force


def own_error_shift(c: Constants, point: Mapping[str, float], phase: Array) -> tuple[Array, Array]:
    """What own e(t) takes off the recorded x, v (n, 12), which hold the nominal e(t)."""
    p = machine(c, point)
    off = p.error - NOMINAL.e_sp
    return off * np.sin(phase)[:, None], off * p.omega * np.cos(phase)[:, None]


def contact(c: Constants, point: Mapping[str, float], motion: Motion) -> dict[str, float]:
    """Shares of samples with drive and back flank closed, sun and ring meshes."""
    half = half_backlash(c, point["delta_T"])
    dx, _ = own_error_shift(c, point, motion.phase)
    drive, back = motion.x - dx > half, motion.x - dx < -half
    return {
        "sp_fwd": float(drive[:, :6].mean()),
        "sp_back": float(back[:, :6].mean()),
        "rp_fwd": float(drive[:, 6:].mean()),
        "rp_back": float(back[:, 6:].mean()),
    }


def period(motion: Motion) -> int:
    """Mesh cycles after which all x repeat within 1e-3 of their RMS, at most 12; 0 if none."""
    tail = motion.x[len(motion.x) // 2 :]
    near = 1e-3 * float(np.sqrt(np.mean(tail**2)))
    for cycles in range(1, 13):
        lag = cycles * SAMPLES_PER_CYCLE
        if float(np.abs(tail[lag:] - tail[:-lag]).max()) < near:
            return cycles
    return 0
