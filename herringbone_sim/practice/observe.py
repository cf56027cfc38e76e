"""One run of a practice rig: the simulated motion, then its measured channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.practice.cause import Cause
from herringbone_sim.practice.chain import deterministic, gauged, measured
from herringbone_sim.practice.channels import channels_of
from herringbone_sim.practice.measure import RunMeasure, measure_run
from herringbone_sim.practice.plan import KINDS, Plan
from herringbone_sim.practice.record import Motion, Sampling, SimulatedRun, simulate_motion
from herringbone_sim.practice.rig_model import NOMINAL, Constants, RigModel, rig_model
from herringbone_sim.practice.sensors import distort


@dataclass(frozen=True)
class ObservedRun:
    """One run with all measured channels, before a channel set is selected.

    Attributes:
        motion: the true motion.
        measured: values (n,) of the channels by name.
        measure: residuals and detectability.
    """

    motion: Motion
    measured: Mapping[str, Array]
    measure: RunMeasure


def simulate_run(
    plan: Plan, rig: Constants, causes: tuple[Cause, ...], i: int, sampling: Sampling | None = None
) -> SimulatedRun:
    """Simulate run number i of a plan with the given causes.

    Args:
        rig: constants of the rig.
        sampling: cycles of a trial run, which omits the filter, as that adds no noise; None: a
            full run.
    """
    lags = tuple(c.size for c in causes if c.internal == "sensor_delay")
    drifts = tuple(1e-6 * c.sign * c.size for c in causes if c.internal == "clock_drift")
    delay = plan.noise.parts.get("filter", {}).get("delay_s") if sampling is None else None
    sampling = replace(
        sampling or Sampling(),
        lags=lags,
        drifts=drifts,
        delay=delay,
        per_cycle=plan.samples_per_cycle,
    )
    span = span_of(plan.points[i], sampling.transient + sampling.cycles)
    p = with_causes(rig_model(rig, plan.points[i], span), causes, plan.points[i])
    return simulate_motion(p, plan.phases[i], plan.starts[i], sampling)


def observe_run(
    plan: Plan,
    rig: Constants,
    causes: tuple[Cause, ...],
    i: int,
    moved: SimulatedRun,
    peaks: Mapping[str, float],
) -> ObservedRun:
    """Measure run number i: filter and encoders, then faults, gauges, noise and converters.

    Args:
        moved: the simulated run.
        peaks: largest value of each quantity over the campaign, see ``largest``.
    """
    motion, exact = moved.now, channels_of(moved.now)
    smooth, counted = deterministic(plan.noise, motion, moved.fine)
    faulty = [_with_faults(causes, moved, channels) for channels in (exact, smooth, counted)]
    seen, quiet, shown = faulty[0], *(gauged(plan.noise, channels) for channels in faulty[1:])
    rng = np.random.default_rng([plan.seed, 0x51, i])
    noisy = measured(plan.noise, shown, motion.times, rng, peaks)
    measure = measure_run(rig, plan.points[i], motion, seen, quiet, noisy, causes)
    return ObservedRun(motion, noisy, measure)


def _with_faults(
    causes: tuple[Cause, ...], moved: SimulatedRun, channels: Mapping[str, Array]
) -> dict[str, Array]:
    """Return the channels with the sensor faults among the causes."""
    seen = dict(channels)
    for cause in causes:
        if KINDS[cause.internal].sense == "sensor":
            before = moved.before[0] if moved.before else None
            seen = distort(cause, moved.now, before, seen)
    return seen


def with_causes(p: RigModel, causes: tuple[Cause, ...], point: Mapping[str, float]) -> RigModel:
    """Return the rig model with the causes in meshes and bodies, at an operating point.

    Those in sensors change what is recorded (``distort``), not the rig. point: delta_T [K], K,
    T_1 [N m], Omega.
    """
    for cause in causes:
        p = KINDS[cause.internal].apply(p, cause, point)
    return p


def span_of(point: Mapping[str, float], cycles: int) -> float:
    """Return the reference duration [s] of drifting effects: 1.2 times that of the mesh cycles."""
    return float(1.2 * cycles * 2.0 * np.pi / rig_model(NOMINAL, point).omega)


def largest(motions: Sequence[Motion]) -> dict[str, float]:
    """Return the largest absolute x, v, F, u and a over some runs, which set converter ranges."""
    values = {"x": "x", "v": "v", "F": "force", "u": "u", "a": "a"}
    return {
        short: max(float(np.abs(getattr(motion, long)).max()) for motion in motions)
        for short, long in values.items()
    }


def pooled(measures: Sequence[RunMeasure]) -> float:
    """Return the detectability of the first cause over some runs: RMS, at least 1e-9."""
    return float(max(np.sqrt(np.mean([measure.d[0] ** 2 for measure in measures])), 1e-9))
