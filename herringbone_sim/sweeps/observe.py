"""One part of a sweep: from flat indices to a table, a row a value.

The columns of a table, n rows:

    index               flat index in the grid
    NAME                value of each axis
    period              mesh cycles; 0 aperiodic; NaN failed, or too few points to say
    exponent            largest Lyapunov exponent per tau, and its standard error
    exponent_error
    within, transverse  the same for perturbations that keep, and that part, left and right; NaN
                        where they differ already
    asymmetry           RMS of left less right over the section, b_c
    sun_back, sun_separated, sun_drive, ring_...    shares of the time, mean of the meshes
    contact_loss        0 never, 1 on one side, 2 on both flanks of some mesh
    points              (n, points) section displacements of one mesh, b_c, where wanted
    end                 (n, n_state) last states, where the next value starts from them
    reason              why a value failed, or empty

A failed value is NaN in all but its index, its axes and its reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.batch import Batch, run_batch
from herringbone_sim.core.model import Model, build, initial_state, relative
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.grid import Sweep
from herringbone_sim.sweeps.periods import find_periods

Array = NDArray[np.float64]
Table = dict[str, NDArray[Any]]

STATES = ("back", "separated", "drive")
NO_TIME = 1e-9  # share of the time below which it is rounding
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


def observe(sweep: Sweep, indices: Sequence[int], starts: Array | None = None) -> Table:
    """Table of some values of a sweep.

    Args:
        indices: n flat indices.
        starts: (n, n_state) states at phase 0; the gear's own initial states by default, and
            where a row is NaN.
    """
    table = empty_table(sweep, indices)
    models, reasons = build_all(sweep, indices)
    built = [i for i, model in enumerate(models) if model is not None]
    if built:
        chosen = [model for model in models if model is not None]
        look = sweep.observation
        batch = run_batch(
            chosen,
            None if starts is None else filled(starts[built], chosen),
            look.transient,
            look.cycles,
            look.points,
            look.exponents,
        )
        _fill(table, built, sweep, chosen, batch)
        for i, reason in zip(built, batch.reasons, strict=True):
            reasons[i] = reason
    table["reason"] = np.array(reasons, dtype=object)
    return table


def empty_table(sweep: Sweep, indices: Sequence[int]) -> Table:
    """Rows with their indices and values, all else NaN."""
    n = len(indices)
    values = [sweep.values_at(index) for index in indices]
    table: Table = {"index": np.array(indices, dtype=np.int64)}
    table |= {name: np.array([value[name] for value in values]) for name in sweep.names}
    table |= {name: np.full(n, np.nan) for name in SCALARS}
    if sweep.observation.mesh:
        table["points"] = np.full((n, sweep.observation.points), np.nan)
    if sweep.chained:
        table["end"] = np.full((n, sweep.base.layout.n_state), np.nan)
    return table


def build_all(sweep: Sweep, indices: Sequence[int]) -> tuple[list[Model | None], list[str]]:
    """Models of some values, None where there can be none, and why."""
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


def filled(starts: Array, models: Sequence[Model]) -> Array:
    """Start states (n, n_state) with the initial state of the gear in place of NaN."""
    own = np.array([initial_state(model) for model in models])
    lacking = np.isnan(starts).any(axis=1, keepdims=True)
    result: Array = np.where(lacking, own, starts)
    return result


def section_displacements(sweep: Sweep, models: Sequence[Model], sections: Array) -> Array:
    """Displacements (n, points) of the wanted mesh at phase 0 from states (n, points, n_state)."""
    layout = sweep.base.layout
    mesh = layout.meshes.index(sweep.observation.mesh)
    rest = np.array([relative(m, np.zeros(layout.n_state), 0.0)[0][mesh] for m in models])
    units = np.eye(layout.n_state)[: layout.n_coordinate]
    row = np.round([relative(models[0], unit, 0.0)[0][mesh] - rest[0] for unit in units])
    found: Array = np.repeat(rest[:, None], sections.shape[1], axis=1)
    for k in np.flatnonzero(row):  # one by one: a product of matrices may round by their size
        found += row[k] * sections[..., k]
    return found


def asymmetries(sections: Array) -> Array:
    """RMS (n,) of left less right displacements over sections (n, points, n_state)."""
    q, r = np.split(sections[..., : sections.shape[-1] // 2], [2], axis=-1)
    left, right = np.split(r, 2, axis=-1)
    parted = np.concatenate([q[..., :1] - q[..., 1:], left - right], axis=-1)
    return np.array([np.sqrt(np.mean(one**2)) for one in parted])


def contact_loss(contact: Array) -> Array:
    """0, 1 or 2 (n,) from shares (n, n_mesh, 3): never apart, one flank only, both flanks hit."""
    back, apart, drive = np.moveaxis(contact > NO_TIME, -1, 0)
    both = back & drive
    worst = np.max(np.where(both, 2.0, np.where(apart, 1.0, 0.0)), axis=1)
    result: Array = np.where(np.isnan(contact).any(axis=(1, 2)), np.nan, worst)
    return result


def _fill(
    table: Table, rows: list[int], sweep: Sweep, models: Sequence[Model], batch: Batch
) -> None:
    table["period"][rows] = find_periods(batch.sections)
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
