"""Compute one part of a sweep: from flat indices to a table with one row a value.

The columns of a table, n rows:

    index               flat index in the grid
    NAME                value of each axis
    period              mesh cycles; 0 aperiodic; NaN failed, or too few points to decide
    exponent            largest Lyapunov exponent per tau, and its standard error
    exponent_error
    within, transverse  the same of left-right symmetric and antisymmetric perturbations; NaN
                        for a motion whose left and right differ
    asymmetry           RMS of left minus right displacements over the section, b_c
    sun_back, sun_separated, sun_drive, ring_...    fractions of the time, mean of the meshes
    contact_loss        0 never, 1 lost on one flank, 2 contact on both flanks of some mesh
    points              (n, points) section displacements of one mesh, b_c, if requested
    end                 (n, n_state) final states, those of effects included, if the next value
                        starts from them
    reason              why a value failed, or empty

A failed value is NaN in all but its index, its axes and its reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.analysis.periods import MAX_PERIOD, MIN_REPEATS
from herringbone_sim.arrays import Array
from herringbone_sim.core.batch import Batch, run_batch
from herringbone_sim.core.model import Model, build, initial_state, relative
from herringbone_sim.dynamics.flow import forcing_cycles
from herringbone_sim.effects.assemble import assemble
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.grid import Sweep
from herringbone_sim.sweeps.periods import find_periods

Table = dict[str, NDArray[Any]]

STATES = ("back", "separated", "drive")
NO_TIME = 1e-9  # fraction of the time below which a contact state counts as rounding error
SCALARS = (
    "period",
    "exponent",
    "exponent_error",
    "within",
    "transverse",
    "asymmetry",
    *(f"{kind}_{state}" for kind in ("sun", "ring") for state in STATES),
    "contact_loss",
)


@dataclass(frozen=True)
class ObservationRequest:
    """Values of one sweep to be computed.

    Attributes:
        sweep: the sweep.
        indices: n flat indices.
        starts: (n, n_state) states at phase 0; NaN in a row, or None, for the initial state of the
            gear.
        cycle: mesh cycles elapsed before the starts, which set the phase of control and effects.
    """

    sweep: Sweep
    indices: Sequence[int]
    starts: Array | None = None
    cycle: int = 0


def observe(asked: Sequence[ObservationRequest]) -> list[Table]:
    """Compute a table for each request, all in one batch.

    The sweeps must have equal observation, effects, layout and Taylor order. A value at which no
    gear can be built fails with the reason, without an exception.
    """
    tables = [empty_table(request.sweep, request.indices) for request in asked]
    actives = asked[0].sweep.actives
    builds = [build_models(request.sweep, request.indices) for request in asked]
    models = [[model for model in built if model is not None] for built, _ in builds]
    all_models = [model for chosen in models for model in chosen]
    look = asked[0].sweep.observation
    starts = [_starts(request, built) for request, (built, _) in zip(asked, builds, strict=True)]
    length = (look.transient, look.cycles, look.points, look.exponents)
    batch, forcings = None, np.zeros(0, dtype=int)
    before = np.repeat([request.cycle for request in asked], [len(chosen) for chosen in models])
    if all_models:
        gears = [assemble(model, actives) for model in all_models]
        batch = run_batch(gears, np.concatenate(starts), *length, before=before)
        batch = batch.of_gear(gears[0].layout)
        forcings = np.array([forcing_cycles(gear) for gear in gears])
    first = 0
    for request, table, (built, reasons), chosen in zip(
        asked, tables, builds, models, strict=True
    ):
        rows = [i for i, model in enumerate(built) if model is not None]
        if rows and batch is not None:
            mine = _slice(batch, first, first + len(rows))
            table["period"][rows] = _periods(mine.sections, forcings[first : first + len(rows)])
            _fill(table, rows, request.sweep, chosen, mine)
            for i, reason in zip(rows, mine.reasons, strict=True):
                reasons[i] = reason
        table["reason"] = np.array(reasons, dtype=object)
        first += len(rows)
    return tables


def empty_table(sweep: Sweep, indices: Sequence[int]) -> Table:
    """Table with indices and axis values filled in, the other columns NaN; without reasons."""
    n = len(indices)
    values = [sweep.values_at(index) for index in indices]
    table: Table = {"index": np.array(indices, dtype=np.int64)}
    table |= {name: np.array([value[name] for value in values]) for name in sweep.names}
    table |= {name: np.full(n, np.nan) for name in SCALARS}
    if sweep.observation.mesh:
        table["points"] = np.full((n, sweep.observation.points), np.nan)
    if sweep.chained:
        table["end"] = np.full((n, sweep.n_state), np.nan)
    return table


def build_models(sweep: Sweep, indices: Sequence[int]) -> tuple[list[Model | None], list[str]]:
    """Models without effects at flat indices, None where no gear can be built, and reasons."""
    models: list[Model | None] = []
    reasons: list[str] = []
    for index in indices:
        try:
            models.append(build(sweep.parameters_at(index)))
            reasons.append("")
        except ParameterError as error:
            models.append(None)
            reasons.append(str(error))
    return models, reasons


def section_displacements(sweep: Sweep, models: Sequence[Model], sections: Array) -> Array:
    """Displacements (n, points) of the chosen mesh at phase 0 from states (n, points, n_state)."""
    layout = sweep.base.layout
    mesh = layout.meshes.index(sweep.observation.mesh)
    at_rest = np.array([relative(m, np.zeros(layout.n_state), 0.0)[0][mesh] for m in models])
    units = np.eye(layout.n_state)[: layout.n_coordinate]
    row = np.round([relative(models[0], unit, 0.0)[0][mesh] - at_rest[0] for unit in units])
    displacements: Array = np.repeat(at_rest[:, None], sections.shape[1], axis=1)
    for k in np.flatnonzero(row):  # a matrix product would round differently by batch size
        displacements += row[k] * sections[..., k]
    return displacements


def asymmetries(sections: Array) -> Array:
    """RMS (n,) of left minus right displacements [b_c] over sections (n, points, n_state)."""
    q, r = np.split(sections[..., : sections.shape[-1] // 2], [2], axis=-1)
    left, right = np.split(r, 2, axis=-1)
    parted = np.concatenate([q[..., :1] - q[..., 1:], left - right], axis=-1)
    return np.array([np.sqrt(np.mean(differences**2)) for differences in parted])


def contact_loss(contact: Array) -> Array:
    """Class of contact loss (n,) from the fractions of the time in each contact (n, n_mesh, 3).

    0 never separated, 1 separated but one flank only, 2 contact on both flanks of some mesh; NaN
    where a fraction is NaN.
    """
    back, apart, drive = np.moveaxis(contact > NO_TIME, -1, 0)
    both = back & drive
    worst = np.max(np.where(both, 2.0, np.where(apart, 1.0, 0.0)), axis=1)
    result: Array = np.where(np.isnan(contact).any(axis=(1, 2)), np.nan, worst)
    return result


def _starts(request: ObservationRequest, built: Sequence[Model | None]) -> Array:
    """States (k, n_state) from which the k values begin whose model could be built."""
    chosen = {i: model for i, model in enumerate(built) if model is not None}
    own = np.zeros((len(chosen), request.sweep.n_state))
    for row, model in zip(own, chosen.values(), strict=True):
        row[: model.layout.n_state] = initial_state(model)
    if request.starts is None:
        return own
    given = request.starts[list(chosen)]
    result: Array = np.where(np.isnan(given).any(axis=1, keepdims=True), own, given)
    return result


def _periods(sections: Array, forcings: Array) -> Array:
    """Periods (n,) of motions from sections (n, m, k), and forcing periods (n,) [mesh cycles]."""
    periods: Array = np.full(len(sections), np.nan)
    for forcing in np.unique(forcings):
        found = find_periods(sections[forcings == forcing], MAX_PERIOD * int(forcing))
        if sections.shape[1] < MIN_REPEATS * forcing:
            found[found == 0.0] = np.nan  # a period of the forcing was not looked for
        periods[forcings == forcing] = found
    return periods


def _slice(batch: Batch, first: int, stop: int) -> Batch:
    """Rows first .. stop of all arrays of a batch."""
    return Batch(*(getattr(batch, item.name)[first:stop] for item in fields(batch)))


def _fill(
    table: Table, rows: list[int], sweep: Sweep, models: Sequence[Model], batch: Batch
) -> None:
    """Enter the results of a batch into rows of a table."""
    table["exponent"][rows] = batch.exponents
    table["exponent_error"][rows] = batch.exponent_errors
    table["within"][rows] = batch.within
    table["transverse"][rows] = batch.transverse
    table["asymmetry"][rows] = asymmetries(batch.sections)
    table["contact_loss"][rows] = contact_loss(batch.contact)
    shares = np.mean(batch.contact.reshape(len(models), 2, -1, 3), axis=2)
    for i, kind in enumerate(("sun", "ring")):
        for j, state in enumerate(STATES):
            table[f"{kind}_{state}"][rows] = shares[:, i, j]
    if "points" in table:
        table["points"][rows] = section_displacements(sweep, models, batch.sections)
    if "end" in table:
        table["end"][rows] = batch.end
