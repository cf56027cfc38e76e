"""Make a practice campaign: solve for the size that was asked for, run, record, label."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import DivergenceError
from herringbone_sim.practice.cause import Cause
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
    CHANNEL_SETS,
    CYCLES,
    Motion,
    channels_of,
    record_motion,
    series_of,
    with_noise,
)
from herringbone_sim.practice.sensors import distort
from herringbone_sim.recording.campaign import Campaign, CampaignRun

NEAR = 0.08
TRIES = 8


@dataclass(frozen=True)
class PracticeCampaign:
    """A campaign in memory.

    Attributes:
        campaign: as ``recording.campaign.read_campaign`` gives it; paths are bare names.
        series: recording of each run, in its order.
        label: the truth; only a scorer reads it.
    """

    campaign: Campaign
    series: tuple[TimeSeries, ...]
    label: dict[str, Any]


@dataclass(frozen=True)
class Take:
    """One run with its measured channels, all of them, before a set is chosen."""

    motion: Motion
    measured: Mapping[str, Array]
    found: RunMeasure


Solved = tuple[tuple[Cause, float], ...]


def make_campaign(plan: Plan) -> PracticeCampaign:
    """Solve for the sizes and run a plan: a second or two without effect, up to five with two.

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
    takes = [take_run(plan, rig, causes, i) for i in range(len(plan.points))]
    names = CHANNEL_SETS[plan.channels]
    series = tuple(
        series_of(take.motion, take.measured, point, names)
        for take, point in zip(takes, plan.points, strict=True)
    )
    runs = tuple(
        CampaignRun(Path(f"run_{i:02d}"), dict(point), "fit" if i < FIT_RUNS else "held_out")
        for i, point in enumerate(plan.points)
    )
    label = label_of(
        plan, solved, runs, rig, [take.motion for take in takes], [t.found for t in takes]
    )
    return PracticeCampaign(
        Campaign(f"practice_{plan.seed}", noise_share(plan), runs), series, label
    )


def noise_share(plan: Plan) -> float:
    """RMS of the noise as a share of each channel's RMS."""
    return float(10.0 ** (-plan.snr_dB / 20.0))


def take_run(plan: Plan, rig: Constants, causes: tuple[Cause, ...], i: int) -> Take:
    """Run number i with these effects, measured."""
    p = equipped(machine(rig, plan.points[i], span_of(plan, i)), causes, plan.points[i])
    lags = tuple(c.size for c in causes if c.internal == "sensor_delay")
    motion, before = record_motion(p, plan.phases[i], plan.starts[i], lags)
    exact = channels_of(motion)
    seen: dict[str, Array] = dict(exact)
    for cause in causes:
        if KINDS[cause.internal].sense == "sensor":
            seen = distort(cause, motion, before[0] if before else None, seen)
    rng = np.random.default_rng([plan.seed, 0x51, i])
    clock = {"t": seen.pop("t")} if "t" in seen else {}
    measured = with_noise(seen, noise_share(plan), rng) | clock
    found = measure_run(rig, plan.points[i], motion, seen, measured, causes)
    return Take(motion, measured, found)


def equipped(p: Machine, causes: tuple[Cause, ...], point: Mapping[str, float]) -> Machine:
    """The machine with its effects."""
    for cause in causes:
        p = KINDS[cause.internal].apply(p, cause, point)
    return p


def span_of(plan: Plan, i: int) -> float:
    """Duration [s] of a run with its transient, for what drifts."""
    omega = machine(NOMINAL, plan.points[i]).omega
    return float(2.0 * CYCLES * 2.0 * np.pi / omega)


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
    alone = replace(plan, causes=(cause,))
    try:
        found = [take_run(alone, rig, (cause,), i).found.d[0] for i in range(FIT_RUNS)]
    except DivergenceError:
        return None
    return float(max(np.sqrt(np.mean(np.square(found))), 1e-9))
