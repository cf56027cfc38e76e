"""Continuations and ramps: each value goes on from where the one before ended.

Chains run along the first axis of a sweep, side by side over the others. A chain that breaks
(no gear by such values, or a motion that diverges) begins anew at the initial state of the gear
once there is one again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.integrate import State, Stepper, change
from herringbone_sim.core.model import Model, build, carry_over, initial_state
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.grid import Sweep
from herringbone_sim.sweeps.observe import (
    Table,
    asymmetries,
    build_all,
    empty_table,
    observe,
    section_displacements,
)

Array = NDArray[np.float64]


def observe_part(sweep: Sweep, part: int, before: Array | None = None) -> Table:
    """Table of one part of a sweep, in the order of the grid.

    Args:
        before: (width, n_state) states in which the part before it on its chains ended; None for
            the first one, and where every value starts by itself.
    """
    indices = sweep.part(part)
    if not sweep.chained:
        return observe(sweep, indices)
    tables = []
    for row in _rows(sweep, indices):
        table = _ramp(sweep, row, before) if sweep.ramped else _follow(sweep, row, before)
        before = table["end"]
        tables.append(table)
    ordered = tables[::-1] if sweep.downwards else tables
    return {name: np.concatenate([table[name] for table in ordered]) for name in tables[0]}


def part_before(sweep: Sweep, part: int) -> int | None:
    """The part whose end the chains of a part start from; None for the first one."""
    before = part + 1 if sweep.downwards else part - 1
    return before if sweep.chained and 0 <= before < sweep.n_parts else None


def last_states(sweep: Sweep, table: Table) -> Array:
    """States (width, n_state) in which the chains leave a part, from its table."""
    ends: Array = table["end"][: sweep.width] if sweep.downwards else table["end"][-sweep.width :]
    return ends


def _rows(sweep: Sweep, indices: range) -> list[range]:
    """The places of the first axis in a part, in the order in which the chains visit them."""
    firsts = range(indices.start, indices.stop, sweep.width)
    rows = [range(first, first + sweep.width) for first in firsts]
    return rows[::-1] if sweep.downwards else rows


def _neighbour(sweep: Sweep, index: int) -> int:
    """Flat index of the value visited before."""
    return index + sweep.width if sweep.downwards else index - sweep.width


def _follow(sweep: Sweep, row: range, before: Array | None) -> Table:
    if before is None:
        return observe(sweep, row)
    starts = np.full_like(before, np.nan)
    for i, index in enumerate(row):
        if not np.isnan(before[i]).any():
            old = build(sweep.parameters_at(_neighbour(sweep, index)))
            (new,), _ = build_all(sweep, [index])
            starts[i] = np.nan if new is None else carry_over(old, new, before[i], 0.0)
    return observe(sweep, row, starts)


def _ramp(sweep: Sweep, row: range, before: Array | None) -> Table:
    table = empty_table(sweep, row)
    reasons = []
    for i, index in enumerate(row):
        start = None if before is None or np.isnan(before[i]).any() else before[i]
        reasons.append(_ramp_one(sweep, table, i, index, start))
    table["reason"] = np.array(reasons, dtype=object)
    return table


def _ramp_one(sweep: Sweep, table: Table, i: int, index: int, start: Array | None) -> str:
    try:
        path = _path(sweep, index, start is None)
        states, model = ramp(path, start)
    except ParameterError as error:
        return str(error)
    if states is None:
        return "diverged"
    seen = states[None, -1 - sweep.observation.points : -1]
    table["end"][i] = states[-1]
    table["asymmetry"][i] = asymmetries(seen)[0]
    if "points" in table:
        table["points"][i] = section_displacements(sweep, [model], seen)[0]
    return ""


def _path(sweep: Sweep, index: int, anew: bool) -> list[Parameters]:
    """The gear in every mesh cycle: from the value before to this one, or held where none is."""
    look = sweep.observation
    if anew:
        return [sweep.parameters_at(index)] * (look.transient + look.cycles)
    name = sweep.names[0]
    first, last = (sweep.values_at(at)[name] for at in (_neighbour(sweep, index), index))
    here = sweep.parameters_at(index)
    return [here.changed({name: value}) for value in np.linspace(first, last, look.cycles + 1)[1:]]


def ramp(path: list[Parameters], start: Array | None = None) -> tuple[Array | None, Model]:
    """Drive one gear through a path of parameters, a mesh cycle each, as the node does.

    Args:
        path: n parameter sets that differ in live parameters.
        start: (n_state,) state at phase 0 with the first of them; by default its initial state.

    Returns:
        (n + 1, n_state) states at the start of every cycle and at the end, None when the motion
        diverged; and the last model.
    """
    model = build(path[0])
    y = initial_state(model) if start is None else start
    layout = model.layout
    state = State(y.copy(), 0, 0, 0.0, np.zeros((0, layout.n_state)), np.zeros(0))
    states = [state.y]
    stepper = Stepper(model)
    for parameters in path:
        if parameters is not model.parameters:
            new = build(parameters)
            state, model = change(model, new, state), new
            stepper = Stepper(model)
        block = stepper.advance(state, parameters.samples_per_cycle)
        if block.diverged:
            return None, model
        state = replace(block.end, cycle=0)
        states.append(state.y)
    return np.array(states), model
