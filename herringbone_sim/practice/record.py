"""Simulated motion of a practice rig, without sensors."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array, rms
from herringbone_sim.practice.random_physics import TARGETS
from herringbone_sim.practice.rig_model import (
    N_BODY,
    N_COORDINATE,
    NOMINAL,
    Constants,
    RigModel,
    half_backlash,
    rig_model,
)
from herringbone_sim.practice.stepper import accelerations, integrate

SAMPLES_PER_CYCLE = 24
CYCLES = 120
TRANSIENT = 80
STEADY = 20  # last mesh cycles of the transient, in which the slowing by losses is measured
FINER = 4  # samples of the filter input per recorded sample, of ``SAMPLES_PER_CYCLE`` or more
RIGID = np.array([2.0, 2.0, 1.0, *[1.0] * 6])  # rotations u of the bodies that move no mesh
MOVED = np.array([*RIGID, 0.0, 0.0, *[1.0] * 4])  # of all coordinates: pins go with the carrier
COS_BETA = float(np.cos(np.radians(16.0)))


@dataclass(frozen=True)
class Sampling:
    """Sampling of a run.

    Attributes:
        transient, cycles: mesh cycles before the recording, and recorded.
        per_cycle: samples of a mesh cycle.
        drifts: for each channel clock of another rate, lead per time since the first sample.
        lags: delays [s] of late channels.
        delay: delay of all channels before a filter [s]; None: no filter.
    """

    transient: int = TRANSIENT
    cycles: int = CYCLES
    lags: tuple[float, ...] = ()
    delay: float | None = None
    per_cycle: int = SAMPLES_PER_CYCLE
    drifts: tuple[float, ...] = ()

    @property
    def finer(self) -> int:
        """Samples of the filter input per recorded sample."""
        return FINER * math.ceil(SAMPLES_PER_CYCLE / self.per_cycle)


@dataclass(frozen=True)
class Motion:
    """The true motion of a run, without sensors.

    Attributes:
        times: (n,) [s] from 0; ``phase`` (n,) [rad].
        x, v, force: (n, 12) [m], [m/s], [N] as recorded, relative to the nominal e(t).
        u: (n, 9) displacements [m] without the linear trend of the rigid rotation; ``a`` their
            second derivatives [m/s^2].
        extra: (n, 9) forces on the bodies other than mesh forces, T_1, T_2 and K [N].
    """

    times: Array
    phase: Array
    x: Array
    v: Array
    force: Array
    u: Array
    a: Array
    extra: Array


@dataclass(frozen=True)
class SimulatedRun:
    """A simulated run, sampled for all sensors.

    Attributes:
        now: at the recorded times.
        before: for each lag the motion that much earlier, then for each drift that much later.
        fine: ``Sampling.finer`` times as finely, from a cycle earlier, as input of a filter; None
            without one.
    """

    now: Motion
    before: tuple[Motion, ...] = ()
    fine: Motion | None = None


def simulate_motion(
    p: RigModel, phase0: float, start: Array, sampling: Sampling | None = None
) -> SimulatedRun:
    """Integrate a run past its transient and sample it.

    Args:
        p: rig model at the operating point.
        phase0: mesh phase [rad] at the first recorded sample.
        start: (30,) state in which the transient starts.
        sampling: None: the default of ``Sampling``.
    """
    sampling = sampling or Sampling()
    step = 2.0 * np.pi / sampling.per_cycle / p.omega
    lead = sampling.transient * sampling.per_cycle * step
    if loses_power(p):
        p = with_steady_load(p, phase0 - p.omega * lead, start, lead)
    own = lead + step * np.arange(sampling.cycles * sampling.per_cycle)
    grids = [own, *(own - lag for lag in sampling.lags)]
    grids += [own + drift * (own - lead) for drift in sampling.drifts]
    if sampling.delay is not None:
        finer = sampling.finer
        count = (sampling.cycles + 1) * sampling.per_cycle * finer - finer + 1
        finely = own[-1] + step / finer * np.arange(1 - count, 1)
        grids.append(finely - sampling.delay)
    times, back = np.unique(np.concatenate([[0.0], *grids]), return_inverse=True)
    states, force, extra = integrate(p, phase0 - p.omega * lead, start, times)
    phase: Array = phase0 + p.omega * np.asarray(times - lead, dtype=np.float64)
    parts = np.split(back[1:], np.cumsum([len(grid) for grid in grids])[:-1])
    at: Array = np.asarray(own - lead, dtype=np.float64)
    clocks = [at] * (1 + len(sampling.lags) + len(sampling.drifts))
    if sampling.delay is not None:
        clocks.append(finely - lead)
    seen = [
        _motion_at(p, clock, phase[i], times[i], states[i], force[i], extra[i])
        for clock, i in zip(clocks, parts, strict=True)
    ]
    fine = seen.pop() if sampling.delay is not None else None
    return SimulatedRun(seen[0], tuple(seen[1:]), fine)


def loses_power(p: RigModel) -> bool:
    """Whether a force of the rig, other than its torques, can do work on the rigid rotation."""
    on_body = p.random.target == TARGETS.index("torque") and p.random.size.any()
    return bool(p.friction.any() or p.output[0] or p.windage or on_body)


def with_steady_load(p: RigModel, phase: float, start: Array, lead: float) -> RigModel:
    """Return a rig that loses power with the load at which its mean speed is steady.

    Args:
        p: rig model, its load without losses.
        phase, start: mesh phase [rad] and state (30,) at which the transient starts.
        lead: duration of the transient [s], ``STEADY`` mesh cycles or more.

    Raises:
        ValueError: a shorter transient.
    """
    cycle = 2.0 * np.pi / p.omega
    if lead < STEADY * cycle:
        raise ValueError(f"the transient must last {STEADY} mesh cycles, got {lead / cycle:g}")
    ends = lead - cycle * np.array([STEADY, STEADY / 2.0, 0.0])
    states = integrate(p, phase, start, np.concatenate([[0.0], ends]))[0][1:]
    # Over whole mesh cycles, so that the swing under the control cancels.
    momentum = np.diff(states[:, :N_COORDINATE] @ (MOVED * p.free * p.mass)) / (
        STEADY / 2.0 * cycle
    )
    return p._replace(brake=p.brake + float(np.diff(momentum)[0] / (STEADY / 2.0 * cycle)))


def _motion_at(
    p: RigModel,
    times: Array,
    phase: Array,
    own_times: Array,
    states: Array,
    force: Array,
    extra: Array,
) -> Motion:
    """Return the motion at samples of an integration.

    ``times`` [s] become the times of the motion; ``own_times`` are those of the integration, which
    differ for late channels.
    """
    u, rate = states[:, :N_BODY], states[:, N_COORDINATE : N_COORDINATE + N_BODY]
    e = NOMINAL.e_sp
    x = geometry(u) * p.cos_beta - e * np.sin(phase)[:, None]
    v = geometry(rate) * p.cos_beta - e * p.omega * np.cos(phase)[:, None]
    detrended = without_trend(u, times)
    a = accelerations(p, own_times, phase, states)
    return Motion(times, phase, x, v, force, detrended, a, extra[:, :N_BODY])


def geometry(u: Array) -> Array:
    """Return the deflections of the meshes without e(t), divided by cos beta, Eqs. (15), (16).

    Sun meshes: sun minus planet minus carrier; ring meshes: planet minus carrier.

    Args:
        u: (n, 9) base radius times rotation [m], in the order of ``BODIES``; or its rate [m/s].

    Returns:
        (n, 12) in the order of ``MESHES``, in the unit of u.
    """
    suns = np.repeat(u[:, :2], 3, axis=1)
    planets, carrier = u[:, 3:9], u[:, 2:3]
    return np.concatenate([suns - planets - carrier, planets - carrier], axis=1)


def without_trend(u: Array, times: Array) -> Array:
    """Return u (n, 9) less the linear trend of the rigid rotation, fitted with nominal masses."""
    weights = RIGID * _nominal_masses()
    along = u @ weights / float(RIGID @ weights)
    detrended: Array = u - np.polyval(np.polyfit(times, along, 1), times)[:, None] * RIGID
    return detrended


@functools.cache
def _nominal_masses() -> Array:
    return rig_model(NOMINAL, {"delta_T": 0.0, "K": 0.0, "T_1": 0.0, "Omega": 1.0}).mass[:N_BODY]


def law_force(c: Constants, point: Mapping[str, float], phase: Array, x: Array, v: Array) -> Array:
    """Return the mesh forces k(t) f(x) + c v (n, 12) [N] of a rig without effects.

    ``x`` and ``v`` (n, 12) [m], [m/s] are relative to its e(t), see ``own_error_shift``.
    """
    p = rig_model(c, point)
    half = half_backlash(c, point["delta_T"])
    flank = x - np.clip(x, -half, half)
    k = p.stiffness * (1.0 + c.k_amp * np.cos(phase))[:, None]
    force: Array = k * flank + p.damping * v
    return force


def own_error_shift(c: Constants, point: Mapping[str, float], phase: Array) -> tuple[Array, Array]:
    """Return e(t) of a rig less the nominal e(t), and its rate: (n, 12) [m], [m/s].

    Subtracted from recorded x and v, they give those of the rig.
    """
    p = rig_model(c, point)
    off = p.error - NOMINAL.e_sp
    return off * np.sin(phase)[:, None], off * p.omega * np.cos(phase)[:, None]


def contact(c: Constants, point: Mapping[str, float], motion: Motion) -> dict[str, float]:
    """Return fractions of samples in drive and back contact, for sun and ring meshes, by name."""
    half = half_backlash(c, point["delta_T"])
    dx, _ = own_error_shift(c, point, motion.phase)
    drive, back = motion.x - dx > half, motion.x - dx < -half
    return {
        "sp_fwd": float(drive[:, :6].mean()),
        "sp_back": float(back[:, :6].mean()),
        "rp_fwd": float(drive[:, 6:].mean()),
        "rp_back": float(back[:, 6:].mean()),
    }


def period(motion: Motion, per_cycle: int) -> int:
    """Return the mesh cycles after which all x repeat, at most 12; 0 if they do not.

    They repeat if no x in the second half of the run differs from that so many cycles later by
    1e-3 of the RMS or more.

    Args:
        motion: the motion of the run.
        per_cycle: samples of a mesh cycle.
    """
    tail = motion.x[len(motion.x) // 2 :]
    near = 1e-3 * rms(tail)
    for cycles in range(1, 13):
        lag = cycles * per_cycle
        if float(np.abs(tail[lag:] - tail[:-lag]).max()) < near:
            return cycles
    return 0
