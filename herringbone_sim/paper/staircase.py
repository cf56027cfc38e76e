"""Sweeps of a scenario: from one start at every value, or by continuation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from herringbone_sim.core.batch import Batch
from herringbone_sim.core.model import build, relative
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.paper.observe import Observer, Request
from herringbone_sim.paper.regimes import Sweep, motions_of
from herringbone_sim.paper.scenarios import Array, Scenario

SETTLE, STAY = 600, 120


@dataclass(frozen=True)
class Reading:
    """How the paper's open parameters are read.

    Attributes:
        parameters: the set of Sec. 3, as ``config/paper.yaml``.
        xi: damping ratio of section 4; 0.10 is printed.
        effects: of the gear; the paper's has none.
    """

    parameters: Parameters
    xi: float
    effects: tuple[Active, ...] = ()


@dataclass(frozen=True)
class Way:
    """One way to start and to step: a row of the comparison.

    Attributes:
        name: in words.
        changes: parameters that differ from the reading's (method, steps, ...).
        start: (n_state,) state at phase 0 from which every value starts; None for the set's own.
        share: of the number of values that this way is given: slow ones get fewer.
    """

    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    start: Array | None = None
    share: float = 1.0


def request(
    one: Scenario,
    reading: Reading,
    values: Sequence[float] | Array,
    way: Way | None = None,
    exponents: bool = False,
    cycles: int = 0,
) -> Request:
    """The runs of some values, each from the way's start."""
    way = way or Way("")
    base = reading.parameters.changed(way.changes)
    sets = tuple(one.parameters(base, float(value), reading.xi) for value in values)
    starts = None if way.start is None else np.repeat(way.start[None], len(sets), axis=0)
    asked = Request(sets, starts, SETTLE, exponents=exponents, effects=reading.effects)
    return replace(asked, cycles=cycles) if cycles else asked


def sweep_of(values: Array, batch: Batch, asked: Request) -> Sweep:
    """Motions, section displacements and exponents of a batch."""
    model = build(asked.sets[0])
    errors = relative(model, np.zeros(model.layout.n_state), 0.0)[0]
    x = batch.sections[:, :, 0] - batch.sections[:, :, 2] + errors[0]
    exponents = np.stack(
        [batch.exponents, batch.exponent_errors, batch.within, batch.transverse], axis=1
    )
    return Sweep(np.asarray(values, dtype=float), motions_of(batch), x, exponents, batch.reasons)


def sweep(
    observer: Observer,
    one: Scenario,
    reading: Reading,
    n: int,
    way: Way | None = None,
    exponents: bool = False,
) -> Sweep:
    """n values of a scenario, each from the same start."""
    values = one.values(n)
    asked = request(one, reading, values, way, exponents, cycles=200 if exponents else 0)
    return sweep_of(values, observer.batch(asked), asked)


def continuations(
    observer: Observer, scenarios: Sequence[Scenario], reading: Reading, n: int, direction: int
) -> list[Sweep]:
    """n values of each scenario, every value from the end of its neighbour.

    The scenarios step side by side, one batch a step. ``direction`` is +1 for rising values.
    """
    grids = np.array([one.values(n)[::direction] for one in scenarios])
    starts: Array | None = None
    batches, asked, cycle = [], [], 0
    for column in grids.T:
        pairs = zip(scenarios, column, strict=True)
        sets = tuple(one.parameters(reading.parameters, v, reading.xi) for one, v in pairs)
        settle = SETTLE if starts is None else STAY
        asked.append(Request(sets, starts, settle, before=cycle, effects=reading.effects))
        cycle += asked[-1].transient + asked[-1].cycles
        batches.append(observer.batch(asked[-1]))
        starts = batches[-1].end
    steps = [sweep_of(col, b, a) for col, b, a in zip(grids.T, batches, asked, strict=True)]
    return [_row(steps[::direction], i) for i in range(len(scenarios))]


def _row(steps: Sequence[Sweep], i: int) -> Sweep:
    return Sweep(
        np.array([step.values[i] for step in steps]),
        np.array([step.motions[i] for step in steps]),
        np.array([step.x[i] for step in steps]),
        np.array([step.exponents[i] for step in steps]),
        tuple(step.reasons[i] for step in steps),
    )
