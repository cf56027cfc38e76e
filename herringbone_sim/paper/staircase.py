"""Sweeps of a scenario: every value from the same start, or by continuation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.batch import Batch
from herringbone_sim.core.model import build, relative
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.paper.observe import BatchRunner, Request
from herringbone_sim.paper.regimes import Sweep, motions_of
from herringbone_sim.paper.scenarios import Scenario

SETTLE, STAY = 600, 120


@dataclass(frozen=True)
class Reading:
    """Values chosen for the parameters that the paper leaves open.

    Attributes:
        parameters: of section 3, as in ``config/paper.yaml``.
        xi: damping ratio of section 4; 0.10 is printed.
        effects: of the gear; the paper's gear has none.
    """

    parameters: Parameters
    xi: float
    effects: tuple[Active, ...] = ()


@dataclass(frozen=True)
class Way:
    """Start and step size of a sweep that is compared with others.

    Attributes:
        name: name in tables and figures.
        changes: parameters that differ from the reading's (method, steps, ...).
        start: (n_state,) state at phase 0 from which every value starts; None for the initial one.
        share: factor on the number of values, below 1 for a way that is slow to compute.
    """

    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    start: Array | None = None
    share: float = 1.0


def request(
    scenario: Scenario,
    reading: Reading,
    values: Sequence[float] | Array,
    way: Way | None = None,
    exponents: bool = False,
    cycles: int = 0,
) -> Request:
    """Request the runs at some values of the swept parameter.

    Args:
        scenario: sweep of the paper.
        reading: parameters that the paper leaves open.
        values: of the swept parameter.
        way: start and step; None for the initial state and the Taylor series.
        exponents: whether to compute Lyapunov exponents.
        cycles: mesh cycles observed at each value; 0 for the default of ``Request``.
    """
    way = way or Way("")
    base = reading.parameters.changed(way.changes)
    sets = tuple(scenario.parameters(base, float(value), reading.xi) for value in values)
    starts = None if way.start is None else np.repeat(way.start[None], len(sets), axis=0)
    runs = Request(sets, starts, SETTLE, exponents=exponents, effects=reading.effects)
    return replace(runs, cycles=cycles) if cycles else runs


def sweep_from_batch(values: Array, batch: Batch, runs: Request) -> Sweep:
    """Motions over the values (n,) of a sweep, from the batch of the requested runs."""
    model = build(runs.sets[0])
    errors = relative(model, np.zeros(model.layout.n_state), 0.0)[0]
    x = batch.sections[:, :, 0] - batch.sections[:, :, 2] + errors[0]
    exponents = np.stack(
        [batch.exponents, batch.exponent_errors, batch.within, batch.transverse], axis=1
    )
    return Sweep(np.asarray(values, dtype=float), motions_of(batch), x, exponents)


def sweep(
    runner: BatchRunner,
    scenario: Scenario,
    reading: Reading,
    n: int,
    way: Way | None = None,
    exponents: bool = False,
) -> Sweep:
    """Sweep n values of a scenario, each from the same start, see ``request``."""
    values = scenario.values(n)
    runs = request(scenario, reading, values, way, exponents, cycles=200 if exponents else 0)
    return sweep_from_batch(values, runner.batch(runs), runs)


def continuations(
    runner: BatchRunner, scenarios: Sequence[Scenario], reading: Reading, n: int, direction: int
) -> list[Sweep]:
    """Sweep n values of each scenario, each value from the final state of its neighbour.

    The scenarios advance side by side, one batch per step.

    Args:
        runner: integrates the batches.
        scenarios: of one layout.
        reading: parameters that the paper leaves open.
        n: number of values.
        direction: +1 for rising, -1 for falling values.
    """
    grids = np.array([s.values(n)[::direction] for s in scenarios])
    starts: Array | None = None
    batches, requests, cycle = [], [], 0
    for column in grids.T:
        pairs = zip(scenarios, column, strict=True)
        sets = tuple(s.parameters(reading.parameters, v, reading.xi) for s, v in pairs)
        settle = SETTLE if starts is None else STAY
        requests.append(Request(sets, starts, settle, before=cycle, effects=reading.effects))
        cycle += requests[-1].transient + requests[-1].cycles
        batches.append(runner.batch(requests[-1]))
        starts = batches[-1].end
    steps = [sweep_from_batch(*step) for step in zip(grids.T, batches, requests, strict=True)]
    return [_row(steps[::direction], i) for i in range(len(scenarios))]


def _row(steps: Sequence[Sweep], i: int) -> Sweep:
    return Sweep(
        np.array([step.values[i] for step in steps]),
        np.array([step.motions[i] for step in steps]),
        np.array([step.x[i] for step in steps]),
        np.array([step.exponents[i] for step in steps]),
    )
