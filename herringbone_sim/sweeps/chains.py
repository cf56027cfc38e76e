"""Continuations and ramps: each value starts from the final state of the value before it.

A chain runs along the first axis of a sweep; the other axes give chains side by side. If a value
has no valid gear or its motion diverges, the chain starts again from the initial state of the gear
at the next valid value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.stepper import change, stepper
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.grid import Sweep
from herringbone_sim.sweeps.observe import (
    ObservationRequest,
    Table,
    asymmetries,
    build_models,
    empty_table,
    observe,
    section_displacements,
)


@dataclass(frozen=True)
class Job:
    """One part of a sweep, cut out so that little data goes to a worker.

    Attributes:
        part: number of the part.
        sweep: sub-grid with the part and, in a chain, the values before it.
        indices: flat indices of the part in that sub-grid.
        first: flat index in the whole sweep of the first value of the sub-grid.
        visited: positions on the first axis that the chains passed before this part.
        before: (width, n_state) final states of the part before it; None for the first part, and
            where every value starts from the initial state.
    """

    part: int
    sweep: Sweep
    indices: range
    first: int
    visited: int = 0
    before: Array | None = None

    @property
    def rows(self) -> list[range]:
        """Groups of flat indices that are computed together, in the order of the computation.

        All of them; in a chained sweep one group for each position on the first axis.
        """
        sweep, indices = self.sweep, self.indices
        if not sweep.chained:
            return [indices]
        firsts = range(indices.start, indices.stop, sweep.width)
        rows = [range(first, first + sweep.width) for first in firsts]
        return rows[::-1] if sweep.downwards else rows


def job_of(sweep: Sweep, part: int, before: Array | None = None) -> Job:
    """Cut the job of a part out of a sweep; ``before`` as in ``Job``."""
    indices = sweep.part(part)
    if not sweep.chained:
        small, first = sweep.cut(indices)
        return Job(part, small, _moved(indices, first), first)
    past = sweep.size - indices.stop if sweep.downwards else indices.start
    low, high = indices.start, indices.stop
    if past and sweep.downwards:
        high += sweep.width
    elif past:
        low -= sweep.width
    small, first = sweep.cut(range(low, high))
    return Job(part, small, _moved(indices, first), first, past // sweep.width, before)


def _moved(indices: range, first: int) -> range:
    """Range of indices relative to ``first``."""
    return range(indices.start - first, indices.stop - first)


def observe_parts(jobs: Sequence[Job]) -> list[Table]:
    """Compute the tables of several jobs side by side; rows in the order of the grid."""
    rows, before = [job.rows for job in jobs], [job.before for job in jobs]
    tables: list[list[Table]] = [[] for _ in jobs]
    for step in range(max(map(len, rows))):
        going = [i for i in range(len(jobs)) if step < len(rows[i])]
        computed = _observe([replace(jobs[i], before=before[i]) for i in going], step)
        for i, table in zip(going, computed, strict=True):
            tables[i].append(table)
            before[i] = table.get("end")
    return [_whole(job, parts) for job, parts in zip(jobs, tables, strict=True)]


def part_before(sweep: Sweep, part: int) -> int | None:
    """Number of the part of a chained sweep that is computed just before a part.

    The chains of ``part`` start from the final states of that part. In a downwards sweep it is
    ``part`` + 1.

    Returns:
        None for the part that is computed first, and for a sweep that is not chained.
    """
    before = part + 1 if sweep.downwards else part - 1
    return before if sweep.chained and 0 <= before < sweep.n_parts else None


def last_states(sweep: Sweep, table: Table) -> Array:
    """Final states (width, n_state) of the chains of a part, from its table."""
    ends: Array = table["end"][: sweep.width] if sweep.downwards else table["end"][-sweep.width :]
    return ends


def _observe(jobs: Sequence[Job], step: int) -> list[Table]:
    """Table of the group number ``step`` of each job."""
    if jobs[0].sweep.ramped:
        return [_ramp(job, job.rows[step], job.visited + step) for job in jobs]
    return observe([_request(job, job.rows[step], job.visited + step) for job in jobs])


def _request(job: Job, row: range, place: int) -> ObservationRequest:
    """Request for one group of a job, at position ``place`` of the first axis in chain order."""
    look = job.sweep.observation
    return ObservationRequest(
        job.sweep, row, _starts(job, row), place * (look.transient + look.cycles)
    )


def _whole(job: Job, tables: list[Table]) -> Table:
    """Table of a job from those of its groups: in grid order, with indices of the whole sweep."""
    ordered = tables[::-1] if job.sweep.downwards else tables
    table = {name: np.concatenate([table[name] for table in ordered]) for name in tables[0]}
    return table | {"index": table["index"] + job.first}


def _neighbour(sweep: Sweep, index: int) -> int:
    """Flat index of the value before ``index`` in its chain."""
    return index + sweep.width if sweep.downwards else index - sweep.width


def _starts(job: Job, row: range) -> Array | None:
    """Start states (width, n_state) of a group: final ones of the group before, carried over.

    NaN, to start anew, where a gear is invalid or has none; None if ``job.before`` is.
    """
    if job.before is None:
        return None
    starts = np.full_like(job.before, np.nan)
    (models, _) = build_models(job.sweep, row)
    for i, (index, new) in enumerate(zip(row, models, strict=True)):
        if new is not None and not np.isnan(job.before[i]).any():
            starts[i] = _carried(job.sweep, index, job.before[i], new.parameters)
    return starts


def _carried(sweep: Sweep, index: int, end: Array, parameters: Parameters) -> Array:
    """State that continues the final state of the value before ``index`` with ``parameters``."""
    before, actives = sweep.parameters_at(_neighbour(sweep, index)), sweep.actives
    old, new = (stepper(build(p), actives) for p in (before, parameters))
    return change(old, new, replace(old.start(), y=end)).y


def _ramp(job: Job, row: range, place: int) -> Table:
    """Table of one group of a ramp, at position ``place`` of the first axis in chain order."""
    table, before = empty_table(job.sweep, row), job.before
    reasons = []
    for i, index in enumerate(row):
        start = None if before is None or np.isnan(before[i]).any() else before[i]
        reasons.append(_ramp_one(job.sweep, table, i, index, start, place))
    table["reason"] = np.array(reasons, dtype=object)
    return table


def _ramp_one(
    sweep: Sweep, table: Table, i: int, index: int, start: Array | None, place: int
) -> str:
    """Ramp from ``start`` to the value at ``index``, and fill row i of the table.

    Returns:
        Why it failed, or an empty text.
    """
    look = sweep.observation
    try:
        path = _path(sweep, index, start is None)
        if start is not None:
            start = _carried(sweep, index, start, path[0])
        cycle = look.transient + (place + 1) * look.cycles - len(path)
        states, model = ramp(path, start, cycle, sweep.actives)
    except ParameterError as error:
        return str(error)
    if states is None:
        return "diverged"
    seen = states[None, -1 - look.points : -1, : model.layout.n_state]
    table["end"][i] = states[-1]
    table["asymmetry"][i] = asymmetries(seen)[0]
    if "points" in table:
        table["points"][i] = section_displacements(sweep, [model], seen)[0]
    return ""


def _path(sweep: Sweep, index: int, anew: bool) -> list[Parameters]:
    """Parameters of every mesh cycle of a ramp to one value, from the value before it.

    ``anew``: constant parameters over transient and cycles, to begin a chain.
    """
    look = sweep.observation
    if anew:
        return [sweep.parameters_at(index)] * (look.transient + look.cycles)
    name = sweep.names[0]
    first, last = (sweep.values_at(at)[name] for at in (_neighbour(sweep, index), index))
    here = sweep.parameters_at(index)
    return [here.changed({name: value}) for value in np.linspace(first, last, look.cycles + 1)[1:]]


def ramp(
    path: list[Parameters],
    start: Array | None = None,
    cycle: int = 0,
    actives: Sequence[Active] = (),
) -> tuple[Array | None, Model]:
    """Integrate one gear while its parameters change once a mesh cycle, as in a live run.

    Args:
        path: n parameter sets that differ in live parameters.
        start: (n_state,) state at phase 0 with the first of them; by default its initial state.
        cycle: mesh cycles elapsed before the start, which set the phase of control and effects.
        actives: effects of the gear; states that they add are the last of the state vector.

    Returns:
        states: (n + 1, n_state) at the start of every cycle and at the end; None if the motion
            diverged.
        model: with the last parameters that were integrated.
    """
    gear_stepper = stepper(build(path[0]), actives)
    state = replace(gear_stepper.start(), cycle=cycle)
    if start is not None:
        state = replace(state, y=start.copy())
    states = [state.y]
    for parameters in path:
        if parameters is not gear_stepper.model.parameters:
            new = stepper(build(parameters), actives)
            state, gear_stepper = change(gear_stepper, new, state), new
        block = gear_stepper.advance(state, parameters.samples_per_cycle)
        if block.diverged:
            return None, gear_stepper.model
        state = block.end
        states.append(state.y)
    return np.array(states), gear_stepper.model
