"""The whole reproduction: sweeps, boundaries, single motions, and what they hang on."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.core.batch import Batch
from herringbone_sim.core.model import initial_state
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.errors import AnalysisError
from herringbone_sim.paper.boundaries import INNER, ROUNDS, Boundary, bisect, locate
from herringbone_sim.paper.checks import Evidence, Obtained, check
from herringbone_sim.paper.observe import Observer, Request
from herringbone_sim.paper.regimes import Sweep, motions_of
from herringbone_sim.paper.scenarios import SCENARIOS, Array, Scenario, scenario
from herringbone_sim.paper.staircase import Reading, Way, continuations, sweep
from herringbone_sim.paper.statements import (
    BoundaryAt,
    MotionAt,
    Statement,
    boundaries,
    statements,
)

POINT_SETTLE, POINT_CYCLES = 1000, 2000
SMALL, LARGE = 0.01, 0.3
RK4_STEPS = (50, 100, 200, 800)
STEPPED_SHARE, SLOW_SHARE = 0.5, 0.25


@dataclass(frozen=True)
class Checked:
    """A published statement and what was obtained."""

    statement: Statement
    obtained: Obtained


@dataclass(frozen=True)
class Point:
    """The motion of one four-panel figure.

    Attributes:
        statement: which figure, and what is published.
        parameters: the set.
        sections: (cycles, n_state) states at phase 0.
        end: (n_state,) state at phase 0 after them.
        motion: period, 0 aperiodic.
        exponent: largest, per tau.
        effects: of the gear.
    """

    statement: MotionAt
    parameters: Parameters
    sections: Array
    end: Array
    motion: int
    exponent: float
    effects: tuple[Active, ...] = ()


@dataclass(frozen=True)
class Compared:
    """One boundary by one way to start or step."""

    way: str
    wanted: BoundaryAt
    found: Boundary


def chosen(keys: str) -> tuple[Scenario, ...]:
    """The scenarios of some letters, in the paper's order; AnalysisError for none or wrong."""
    if not keys:
        raise AnalysisError(
            f"no scenario was chosen: name one or more of {', '.join(s.key for s in SCENARIOS)}"
        )
    wanted = {scenario(key).key for key in keys}
    return tuple(one for one in SCENARIOS if one.key in wanted)


def sweeps(
    observer: Observer, scenarios: Sequence[Scenario], reading: Reading, n: int
) -> dict[str, Sweep]:
    """n values of each scenario with their largest exponents, by letter."""
    return {one.key: sweep(observer, one, reading, n, exponents=True) for one in scenarios}


def points(observer: Observer, scenarios: Sequence[Scenario], reading: Reading) -> list[Point]:
    """The motions of the four-panel figures."""
    keys = "".join(one.key for one in scenarios)
    wanted = [one for one in statements(keys) if isinstance(one, MotionAt)]
    if not wanted:
        return []
    sets = tuple(
        scenario(one.scenario).parameters(reading.parameters, one.value, reading.xi)
        for one in wanted
    )
    length = (POINT_SETTLE, POINT_CYCLES, POINT_CYCLES, True)
    asked = Request(sets, None, *length, effects=reading.effects)
    batch = observer.batch(asked)
    motions = motions_of(batch)
    return [_point(one, asked, batch, i, int(motions[i])) for i, one in enumerate(wanted)]


def _point(one: MotionAt, asked: Request, batch: Batch, i: int, motion: int) -> Point:
    states = batch.sections[i], batch.end[i]
    exponent = float(batch.exponents[i])
    return Point(one, asked.sets[i], *states, motion, exponent, asked.effects)


def evidence(
    observer: Observer,
    one: Scenario,
    reading: Reading,
    found: Sweep,
    single: Sequence[Point],
) -> Evidence:
    """What a scenario's statements are held against: its boundaries are bisected here."""
    return Evidence(
        found,
        {wanted: bisect(observer, one, reading, found, wanted) for wanted in boundaries(one)},
        {
            point.statement.value: (point.motion, point.exponent)
            for point in single
            if point.statement.scenario == one.key
        },
    )


def checked(known: Mapping[str, Evidence]) -> list[Checked]:
    """Every statement of the scenarios with what was obtained, in the order of the paper."""
    return [Checked(one, check(one, known[one.scenario])) for one in statements("".join(known))]


def ways(reading: Reading) -> tuple[Way, ...]:
    """Ways to start and to step, beside the zero start with the Taylor series.

    Random displacements added to the set's own start, alike on both sides (``symmetric``) or not,
    by their standard deviation in b_c; and the paper's method with 50 to 800 steps a cycle.
    """
    zero = initial_state(build_with(reading.parameters, reading.effects))
    sizes = (SMALL, LARGE, LARGE)
    starts = [zero + _symmetric(len(zero), size, seed) for seed, size in enumerate(sizes, 1)]
    starts += [zero + _any(len(zero), size, seed) for seed, size in enumerate(sizes, 4)]
    kinds = itertools.product(("symmetric", "asymmetric"), sizes)
    names = [f"{kind} ±{size:g} ({i})" for i, (kind, size) in enumerate(kinds, 1)]
    random = [Way(name, {}, start) for name, start in zip(names, starts, strict=True)]
    slow = RK4_STEPS[-1]
    stepped = [
        Way(
            f"RK4, {steps} steps",
            {"method": "rk4", "steps_per_cycle": steps},
            share=SLOW_SHARE if steps == slow else STEPPED_SHARE,
        )
        for steps in RK4_STEPS
    ]
    return (*random, *stepped)


def compared_runs(n: int) -> int:
    """Runs of ``compared`` for one scenario: two continuations, six starts, four steps."""
    stepped = (len(RK4_STEPS) - 1) * max(int(n * STEPPED_SHARE), 2)
    return 8 * n + stepped + max(int(n * SLOW_SHARE), 2)


def bisected_runs(one: Scenario) -> int:
    """Runs that its boundaries take at most."""
    return (len(one.windows) - 1) * (ROUNDS * INNER + 2)


def point_runs(scenarios: Sequence[Scenario]) -> int:
    """Four-panel figures of some scenarios."""
    keys = "".join(one.key for one in scenarios)
    return sum(isinstance(one, MotionAt) for one in statements(keys))


def _any(n: int, size: float, seed: int) -> Array:
    start = np.zeros(n)
    start[: n // 2] = size * np.random.default_rng(seed).normal(size=n // 2)
    return start


def _symmetric(n: int, size: float, seed: int) -> Array:
    """Left and right alike: q_L = q_R, r_pL = r_pR."""
    start = np.zeros(n)
    side = (n // 2 - 2) // 2
    q, *r = size * np.random.default_rng(seed).normal(size=1 + side)
    start[: n // 2] = [q, q, *r, *r]
    return start


def compared(
    observer: Observer,
    scenarios: Sequence[Scenario],
    reading: Reading,
    n: int,
    zero: Mapping[str, Sweep],
) -> dict[str, dict[str, Sweep]]:
    """Sweeps by every way: scenario -> way -> sweep; the zero start first."""
    rows: dict[str, dict[str, Sweep]] = {
        one.key: {"zero start": zero[one.key]} for one in scenarios
    }
    for name, direction in (("continued upwards", 1), ("continued downwards", -1)):
        found = continuations(observer, scenarios, reading, n, direction)
        for one, row in zip(scenarios, found, strict=True):
            rows[one.key][name] = row
    for way in ways(reading):
        for one in scenarios:
            count = max(int(n * way.share), 2)
            rows[one.key][way.name] = sweep(observer, one, reading, count, way)
    return rows


def compared_boundaries(rows: Mapping[str, Mapping[str, Sweep]]) -> list[Compared]:
    """Every boundary as every way's sweep shows it."""
    return [
        Compared(way, wanted, locate(row, wanted))
        for key, by_way in rows.items()
        for wanted in boundaries(scenario(key))
        for way, row in by_way.items()
    ]
