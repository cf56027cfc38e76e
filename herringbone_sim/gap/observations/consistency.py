"""Consistency of motion sensors as an observation: x = G u - e and dx/dt = v, for any force law.

Twelve x, twelve v and nine u measure eight coordinates and their rates. The residuals of these
relations, and of increments of z minus the integral of dz/dt, are noise unless a sensor is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import Layout
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.gap.data.kinematics import bodies_to_meshes, cycles_per_shaft_turn
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.force_law import ENCODER_ERROR_RAD, drift_spread, slow_waves
from herringbone_sim.gap.residuals.fusion import Fused
from herringbone_sim.gap.sensors.consistency import Relation, error_signals, relations
from herringbone_sim.gap.sensors.correction import without_sensor_error
from herringbone_sim.gap.sensors.groups import sensor_names

NAME = "consistency"
ERROR_KINDS = ("gain", "bias", "delay", "clock")


def function_names(layout: Layout, swap: tuple[str, str] | None) -> tuple[str, ...]:
    """Names of the columns: ``ERROR of CHANNEL`` for all x, v, u; ``swap`` if one is given."""
    errors = tuple(f"{kind} of {name}" for name in sensor_names(layout) for kind in ERROR_KINDS)
    return errors if swap is None else (*errors, "swap")


def block(
    run: PreparedRun,
    fused: Fused,
    swap: tuple[str, str] | None,
    least_rows: int = 0,
) -> Block | None:
    """Return the whitened residuals of the relations between motion channels of a run.

    Args:
        fused: motion from which the columns are formed.
        swap: channels that may have been swapped; None: no such column.
        least_rows: least number of rows, so that all runs have as many; rows beyond the relations
            of this run are zero.

    Returns:
        The block; None without rows.
    """
    J = len(sensor_names(run.model.layout))
    signals = error_signals(run, fused)
    parts = [_relation_rows(relation, len(run)) for relation in relations(run, signals)]
    rows = max(least_rows, sum(part[0].shape[1] for part in parts))
    if not rows:
        return None
    residual, columns, weights = (
        _with_rows([part[i] for part in parts], shape, rows)
        for i, shape in enumerate(((len(run),), (len(run), signals[0].size), (1, J)))
    )
    names = function_names(run.model.layout, swap)
    if swap is not None:
        right = relations(without_sensor_error(run, "swap", swap, 1.0), signals, run)
        swapped = [_relation_rows(relation, len(run))[0] for relation in right]
        exchanged = _with_rows(swapped, (len(run),), rows)
        columns = np.concatenate([columns, (residual - exchanged)[:, :, None]], axis=2)
    slow = slow_waves(run.times - run.times[0])
    turns = _shaft_waves(run)
    R = residual.shape[1]
    nuisance = np.concatenate([slow, turns], axis=1)
    sd = np.concatenate(
        [
            np.full((R, slow.shape[1]), drift_spread(slow.shape[1])),
            np.repeat(_grating_sizes(run, weights[0])[:, None], turns.shape[1], axis=1) + 1e-9,
        ],
        axis=1,
    )
    return Block(
        NAME,
        residual,
        np.ones_like(residual),
        names,
        columns,
        np.repeat(nuisance[:, None, :], R, axis=1),
        sd,
        np.zeros((0, R, len(names))),
        np.zeros(0),
    )


def _with_rows(parts: Sequence[Array], shape: tuple[int, ...], rows: int) -> Array:
    """Parts (n, d, ...) joined along axis 1, zeros up to ``rows``; ``shape``: (n, ...)."""
    padded = np.zeros((shape[0], rows, *shape[1:]))
    at = 0
    for part in parts:
        padded[:, at : at + part.shape[1]] = part
        at += part.shape[1]
    return padded


def dominant_channels(block: Block) -> tuple[Array, Array]:
    """Columns of gain and delay (n, R each) of the channel with most weight in each row.

    They are proportional to the signal of the channel and to its rate.
    """
    of_gain, of_delay = (
        np.array([i for i, f in enumerate(block.functions) if f.startswith(f"{kind} of")])
        for kind in ("gain", "delay")
    )
    most = np.argmax(np.mean(block.columns[:, :, of_gain] ** 2, axis=0), axis=1)
    rows = np.arange(len(most))
    return block.columns[:, rows, of_gain[most]], block.columns[:, rows, of_delay[most]]


def _relation_rows(relation: Relation, n: int) -> tuple[Array, Array, Array]:
    """Residual (n, d), columns (n, d, Q), padded with 0 to n; weights (1, d, J) of channels."""
    pad = n - len(relation.residual)
    residual = np.pad(relation.residual, ((0, pad), (0, 0)))
    signals = np.pad(relation.signals, ((0, pad), (0, 0), (0, 0)))
    columns = relation.columns[None, :, :, None] * signals[:, None, :, :]
    return (
        residual,
        columns.reshape(n, residual.shape[1], -1),
        relation.columns.T[None].transpose(0, 2, 1),
    )


def _shaft_waves(run: PreparedRun) -> Array:
    """Return cosine and sine of the shaft angles (n, 6)."""
    waves = [
        trig(run.phase / cycles)
        for cycles in cycles_per_shaft_turn(run.model).values()
        for trig in (np.cos, np.sin)
    ]
    return np.stack(waves, axis=1)


def _grating_sizes(run: PreparedRun, weights: Array) -> Array:
    """Return the standard deviation (R,) that eccentric gratings cause in each relation.

    u may be read from one set of gratings and x = G u - e be computed from another. Either set has
    one error a body, so relations between x alone hold whatever the gratings do.

    Args:
        weights: (R, J) matrix by which the channels x, v, u enter the relations.
    """
    G = bodies_to_meshes(run.model)
    n, nu = G.shape
    per_body = np.array(
        [ENCODER_ERROR_RAD * run.model.scales.base_radius(b) for b in run.model.layout.bodies]
    )
    of_x, of_u = weights[:, :n] @ G, weights[:, 2 * n : 2 * n + nu]
    return np.asarray(np.sqrt((of_x**2 + of_u**2) @ per_body**2))
