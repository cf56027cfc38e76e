"""Make a practice campaign: solve for the size that was asked for, run, record, label."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import DivergenceError
from herringbone_sim.practice.cause import Cause
from herringbone_sim.practice.chain import deterministic, gauged, measured
from herringbone_sim.practice.label import label_of
from herringbone_sim.practice.machine import (
    NOMINAL,
    Array,
    Constants,
    Machine,
    machine,
)
from herringbone_sim.practice.measure import RunMeasure, measure_run
from herringbone_sim.practice.plan import FIT_RUNS, KINDS, Plan
from herringbone_sim.practice.record import (
    Motion,
    Recorded,
    Watch,
    channels_of,
    record_motion,
    series_of,
)
from herringbone_sim.practice.sensors import distort
from herringbone_sim.recording.campaign import Campaign, CampaignRun

NEAR = 0.08
TRIES = 8
SHORT_TRANSIENT, SHORT_CYCLES = 30, 40  # mesh cycles of the runs that sizes are solved with
RING_CYCLES = 78  # a turn of the ring


@dataclass(frozen=True)
class PracticeCampaign:
    """A campaign in memory.

    Attributes:
        campaign: as ``recording.campaign.read_campaign`` gives it; paths are bare names.
        series: recording of each run, in its order.
        label: the truth; only a scorer reads it.
        sensors: what the campaign tells of single channels.
    """

    campaign: Campaign
    series: tuple[TimeSeries, ...]
    label: dict[str, Any]
    sensors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Take:
    """One run with its measured channels, all of them, before a set is chosen."""

    motion: Motion
    measured: Mapping[str, Array]
    found: RunMeasure


Solved = tuple[tuple[Cause, float], ...]


def make_campaign(plan: Plan) -> PracticeCampaign:
    """Solve for the sizes and run a plan: three seconds without effect, up to ten with two.

    Raises:
        DivergenceError: a rig whose motion leaves the range of any gear even so.
    """
    return run_plan(plan, solve_plan(plan))


def solve_plan(plan: Plan) -> Solved:
    """Causes at the sizes that give the plan's detectability, and what each then has."""
    rig = NOMINAL.scaled(plan.factors)
    return tuple(solve_size(plan, rig, cause) for cause in plan.causes)


def solved_as(plan: Plan, label: Mapping[str, Any]) -> Solved:
    """What ``solve_plan`` gave when a label of this plan was made, without solving again."""
    return tuple(
        (cause.sized(float(told["size"])), float(told["d"]))
        for cause, told in zip(plan.causes, label["effects"], strict=True)
    )


def run_plan(plan: Plan, solved: Solved) -> PracticeCampaign:
    """Run a plan whose sizes are known; the same to the bit each time on one machine.

    Raises:
        DivergenceError: a rig whose motion leaves the range of any gear.
    """
    rig = NOMINAL.scaled(plan.factors)
    causes = tuple(cause for cause, _ in solved)
    moved = [move(plan, rig, causes, i) for i in range(len(plan.points))]
    most = largest([one.now for one in moved])
    takes = [take(plan, rig, causes, i, one, most) for i, one in enumerate(moved)]
    series = tuple(
        series_of(one.motion, one.measured, point, plan.names)
        for one, point in zip(takes, plan.points, strict=True)
    )
    runs = tuple(
        CampaignRun(Path(f"run_{i:02d}"), dict(point), "fit" if i < FIT_RUNS else "held_out")
        for i, point in enumerate(plan.points)
    )
    if len(solved) == 1:
        solved = ((causes[0], pooled([one.found for one in takes[:FIT_RUNS]])),)
    label = label_of(plan, solved, runs, rig, [t.motion for t in takes], [t.found for t in takes])
    told = plan.noise.share if plan.noise.told else None
    campaign = Campaign(f"practice_{plan.seed}", told, runs)
    there = {name: one for name, one in plan.noise.sensors.items() if name in plan.names}
    return PracticeCampaign(campaign, series, label, there)


def pooled(found: Sequence[RunMeasure]) -> float:
    """Detectability of the first cause over some runs."""
    return float(max(np.sqrt(np.mean([one.d[0] ** 2 for one in found])), 1e-9))


def move(
    plan: Plan, rig: Constants, causes: tuple[Cause, ...], i: int, watch: Watch | None = None
) -> Recorded:
    """Run number i with these effects, as it was; ``watch`` without what is late."""
    lags = tuple(c.size for c in causes if c.internal == "sensor_delay")
    delay = plan.noise.parts.get("filter", {}).get("delay_s") if watch is None else None
    watch = replace(watch or Watch(), lags=lags, delay=delay)
    span = span_of(plan.points[i], watch.transient + watch.cycles)
    p = equipped(machine(rig, plan.points[i], span), causes, plan.points[i])
    return record_motion(p, plan.phases[i], plan.starts[i], watch)


def largest(motions: Sequence[Motion]) -> dict[str, float]:
    """Largest x, v, F and u of some runs, what converters are chosen for."""
    values = {"x": "x", "v": "v", "F": "force", "u": "u"}
    return {
        short: max(float(np.abs(getattr(one, long)).max()) for one in motions)
        for short, long in values.items()
    }


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


def solve_size(plan: Plan, rig: Constants, cause: Cause) -> tuple[Cause, float]:
    """The cause at the size whose detectability is the plan's, and what that is.

    The slope of log d over log size is followed; the best try counts, within the kind's limits.
    """
    kind = KINDS[cause.internal]
    tries: list[tuple[float, float]] = []
    size = kind.start
    for _ in range(TRIES):
        d = _detectability(plan, rig, cause.sized(size))
        if d is None:
            size *= 0.5
            continue
        tries.append((size, d))
        stuck = (size >= kind.cap and d < plan.d) or (size <= kind.least and d > plan.d)
        if abs(np.log(d / plan.d)) < NEAR or stuck or cause.internal == "channel_swap":
            break
        size = float(np.clip(_next(tries, plan.d), kind.least, kind.cap))
    if not tries:
        raise DivergenceError(
            f"the rig of seed {plan.seed} leaves the range of any gear with {cause.internal} "
            "of any size tried: take another seed"
        )
    best = min(tries, key=lambda one: abs(np.log(max(one[1], 1e-9) / plan.d)))
    return cause.sized(best[0]), best[1]


def _next(tries: list[tuple[float, float]], wanted: float) -> float:
    (size, d) = tries[-1]
    slope = 1.0
    if len(tries) > 1 and tries[-2][0] != size:
        slope = float(np.log(d / tries[-2][1]) / np.log(size / tries[-2][0]))
    step = (wanted / max(d, 1e-6)) ** (1.0 / float(np.clip(slope, 0.4, 2.5)))
    return size * float(np.clip(step, 0.1, 10.0))


def _detectability(plan: Plan, rig: Constants, cause: Cause) -> float | None:
    """By shorter runs than those that are recorded, and without a filter: it is no noise."""
    alone = replace(plan, causes=(cause,))
    cycles = SHORT_CYCLES if cause.shape.get("member") != "ring" else RING_CYCLES
    found = []
    try:
        for i in range(FIT_RUNS):
            moved = move(alone, rig, (cause,), i, Watch(SHORT_TRANSIENT, cycles))
            found.append(take(alone, rig, (cause,), i, moved, largest([moved.now])).found)
    except DivergenceError:
        return None
    return pooled(found)
