"""One run of a practice rig: as it moved, then as its sensors show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.practice.cause import Cause
from herringbone_sim.practice.chain import deterministic, gauged, measured
from herringbone_sim.practice.machine import NOMINAL, Array, Constants, Machine, machine
from herringbone_sim.practice.measure import RunMeasure, measure_run
from herringbone_sim.practice.plan import KINDS, Plan
from herringbone_sim.practice.record import (
    Motion,
    Recorded,
    Watch,
    channels_of,
    record_motion,
)
from herringbone_sim.practice.sensors import distort


@dataclass(frozen=True)
class Take:
    """One run with its measured channels, all of them, before a set is chosen."""

    motion: Motion
    measured: Mapping[str, Array]
    found: RunMeasure


def move(
    plan: Plan, rig: Constants, causes: tuple[Cause, ...], i: int, watch: Watch | None = None
) -> Recorded:
    """Run number i with these effects, as it was.

    Args:
        watch: how many cycles; given, the run is not sampled for a filter, which is no noise.
    """
    lags = tuple(c.size for c in causes if c.internal == "sensor_delay")
    delay = plan.noise.parts.get("filter", {}).get("delay_s") if watch is None else None
    watch = replace(watch or Watch(), lags=lags, delay=delay)
    span = span_of(plan.points[i], watch.transient + watch.cycles)
    p = equipped(machine(rig, plan.points[i], span), causes, plan.points[i])
    return record_motion(p, plan.phases[i], plan.starts[i], watch)


def take(
    plan: Plan,
    rig: Constants,
    causes: tuple[Cause, ...],
    i: int,
    moved: Recorded,
    most: Mapping[str, float],
) -> Take:
    """Run number i, measured: filter and encoders, then faults, noise, gauges and converters."""
    motion, exact = moved.now, channels_of(moved.now)
    smooth, counted = deterministic(plan.noise, motion, moved.fine)
    faulty = [_with_faults(causes, moved, one) for one in (exact, smooth, counted)]
    clock = {"t": [one.pop("t") for one in faulty][-1]} if "t" in faulty[0] else {}
    seen, quiet, shown = faulty[0], *(gauged(plan.noise, one) for one in faulty[1:])
    rng = np.random.default_rng([plan.seed, 0x51, i])
    noisy = measured(plan.noise, shown, motion.times, rng, most) | clock
    found = measure_run(rig, plan.points[i], motion, seen, quiet, noisy, causes)
    return Take(motion, noisy, found)


def _with_faults(
    causes: tuple[Cause, ...], moved: Recorded, channels: Mapping[str, Array]
) -> dict[str, Array]:
    """Channels as sensors with faults show them."""
    seen = dict(channels)
    for cause in causes:
        if KINDS[cause.internal].sense == "sensor":
            before = moved.before[0] if moved.before else None
            seen = distort(cause, moved.now, before, seen)
    return seen


def equipped(p: Machine, causes: tuple[Cause, ...], point: Mapping[str, float]) -> Machine:
    """The machine with its effects."""
    for cause in causes:
        p = KINDS[cause.internal].apply(p, cause, point)
    return p


def span_of(point: Mapping[str, float], cycles: int) -> float:
    """Time [s] that what drifts goes by: a fifth longer than a run of so many mesh cycles."""
    return float(1.2 * cycles * 2.0 * np.pi / machine(NOMINAL, point).omega)


def largest(motions: Sequence[Motion]) -> dict[str, float]:
    """Largest x, v, F, u and a of some runs, what converters are chosen for."""
    values = {"x": "x", "v": "v", "F": "force", "u": "u", "a": "a"}
    return {
        short: max(float(np.abs(getattr(one, long)).max()) for one in motions)
        for short, long in values.items()
    }


def pooled(found: Sequence[RunMeasure]) -> float:
    """Detectability of the first cause over some runs."""
    return float(max(np.sqrt(np.mean([one.d[0] ** 2 for one in found])), 1e-9))
