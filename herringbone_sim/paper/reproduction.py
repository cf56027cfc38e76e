"""Reproduction of the paper: sweeps, boundaries, single motions, other starts and steps."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import initial_state
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.errors import AnalysisError
from herringbone_sim.paper.boundaries import Boundary, bisect, locate
from herringbone_sim.paper.checks import CheckResult, Evidence, check
from herringbone_sim.paper.observe import BatchRunner, Request
from herringbone_sim.paper.regimes import Sweep, motions_of
from herringbone_sim.paper.scenarios import SCENARIOS, Scenario, scenario
from herringbone_sim.paper.staircase import Reading, Way, continuations, sweep
from herringbone_sim.paper.statements import (
    BoundaryAt,
    MotionAt,
    Statement,
    boundaries,
    statements,
)

POINT_SETTLE, POINT_CYCLES = 1000, 2000
SMALL, LARGE = 0.01, 0.3  # b_c, standard deviations of random starts
RK4_STEPS = (50, 100, 200, 800)
STEPPED_SHARE, SLOW_SHARE = 0.5, 0.25  # of the values of a sweep, with RK4; with its 800 steps


@dataclass(frozen=True)
class CheckedStatement:
    """A published statement and the result of its check."""

    statement: Statement
    obtained: CheckResult


@dataclass(frozen=True)
class Point:
    """The motion of one four-panel figure.

    Attributes:
        statement: what is published of it.
        parameters: of the gear.
        sections: (cycles, n_state) states at phase 0.
        end: (n_state,) state at phase 0 after them.
        motion: period in mesh cycles, 0 = aperiodic, -1 = failed.
        exponent: largest Lyapunov exponent per tau.
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
    """A published boundary as obtained from one start or with one step size.

    Attributes:
        way: start or step, see ``Way.name``.
        statement: published boundary.
        boundary: obtained boundary.
    """

    way: str
    statement: BoundaryAt
    boundary: Boundary


def scenarios_of(keys: str) -> tuple[Scenario, ...]:
    """Scenarios by letters, in the order of the paper; AnalysisError for no or wrong letters."""
    if not keys:
        raise AnalysisError(
            f"no scenario was chosen: name one or more of {', '.join(s.key for s in SCENARIOS)}"
        )
    wanted = {scenario(key).key for key in keys}
    return tuple(s for s in SCENARIOS if s.key in wanted)


def sweeps(
    runner: BatchRunner, scenarios: Sequence[Scenario], reading: Reading, n: int
) -> dict[str, Sweep]:
    """Sweep each scenario with n values from the initial state, with exponents; by letter."""
    return {s.key: sweep(runner, s, reading, n, exponents=True) for s in scenarios}


def points(runner: BatchRunner, scenarios: Sequence[Scenario], reading: Reading) -> list[Point]:
    """Compute the motions of the four-panel figures of the scenarios, with exponents."""
    keys = "".join(s.key for s in scenarios)
    figures = [s for s in statements(keys) if isinstance(s, MotionAt)]
    if not figures:
        return []
    sets = tuple(
        scenario(s.scenario).parameters(reading.parameters, s.value, reading.xi) for s in figures
    )
    length = (POINT_SETTLE, POINT_CYCLES, POINT_CYCLES, True)
    batch = runner.batch(Request(sets, None, *length, effects=reading.effects))
    rows = zip(figures, sets, batch.sections, batch.end, strict=True)
    results = zip(map(int, motions_of(batch)), map(float, batch.exponents), strict=True)
    return [
        Point(*row, *result, reading.effects) for row, result in zip(rows, results, strict=True)
    ]


def evidence(
    runner: BatchRunner,
    scenario: Scenario,
    reading: Reading,
    sweep: Sweep,
    points: Sequence[Point],
) -> Evidence:
    """Collect what the statements of a scenario are checked with; bisects its boundaries."""
    return Evidence(
        sweep,
        {b: bisect(runner, scenario, reading, sweep, b) for b in boundaries(scenario)},
        {
            point.statement.value: (point.motion, point.exponent)
            for point in points
            if point.statement.scenario == scenario.key
        },
    )


def checked(evidence: Mapping[str, Evidence]) -> list[CheckedStatement]:
    """Check all statements of the scenarios, in the order of the paper."""
    return [
        CheckedStatement(s, check(s, evidence[s.scenario])) for s in statements("".join(evidence))
    ]


def ways(reading: Reading) -> tuple[Way, ...]:
    """Starts and step sizes to compare with the initial state and the Taylor series.

    Starts add random displacements to the initial state, with left = right (``symmetric``) or not,
    named by their standard deviation in b_c. Steps are those of RK4, 50 to 800 per cycle.
    """
    zero = initial_state(build_with(reading.parameters, reading.effects))
    sizes = (SMALL, LARGE, LARGE)
    starts = [zero + _symmetric(len(zero), size, seed) for seed, size in enumerate(sizes, 1)]
    starts += [zero + _asymmetric(len(zero), size, seed) for seed, size in enumerate(sizes, 4)]
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


def _asymmetric(n: int, size: float, seed: int) -> Array:
    """State (n,) with random displacements of standard deviation ``size``, at rest."""
    start = np.zeros(n)
    start[: n // 2] = size * np.random.default_rng(seed).normal(size=n // 2)
    return start


def _symmetric(n: int, size: float, seed: int) -> Array:
    """State (n,) as ``_asymmetric``, but with q_L = q_R and r_pL = r_pR."""
    start = np.zeros(n)
    side = (n // 2 - 2) // 2
    q, *r = size * np.random.default_rng(seed).normal(size=1 + side)
    start[: n // 2] = [q, q, *r, *r]
    return start


def compared(
    runner: BatchRunner,
    scenarios: Sequence[Scenario],
    reading: Reading,
    n: int,
    zero: Mapping[str, Sweep],
) -> dict[str, dict[str, Sweep]]:
    """Sweep each scenario from other starts and with other step sizes.

    Args:
        runner: integrates the batches.
        scenarios: scenarios to sweep.
        reading: parameters that the paper leaves open.
        n: number of values of a sweep; for a way of ``ways`` times its ``share``, but at least 2.
        zero: sweep from the initial state of each scenario, by its letter.

    Returns:
        By letter, then by name: ``zero start`` (the given sweep), ``continued upwards`` and
        ``continued downwards`` (each value from the final state of the value before), then the
        ``ways`` by name.
    """
    rows: dict[str, dict[str, Sweep]] = {s.key: {"zero start": zero[s.key]} for s in scenarios}
    for name, direction in (("continued upwards", 1), ("continued downwards", -1)):
        continued = continuations(runner, scenarios, reading, n, direction)
        for s, row in zip(scenarios, continued, strict=True):
            rows[s.key][name] = row
    for way in ways(reading):
        count = max(int(n * way.share), 2)
        for s in scenarios:
            rows[s.key][way.name] = sweep(runner, s, reading, count, way)
    return rows


def compared_boundaries(rows: Mapping[str, Mapping[str, Sweep]]) -> list[Compared]:
    """Locate every published boundary in every sweep of ``compared``."""
    return [
        Compared(way, statement, locate(row, statement))
        for key, by_way in rows.items()
        for statement in boundaries(scenario(key))
        for way, row in by_way.items()
    ]
