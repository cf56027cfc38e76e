"""What the lane kernel reads and scribbles on; the last axis of every array is the lane.

A motion whose halves are alike is integrated as one half (``sides`` 1): its meshes stand for two.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.lanes.vector import LANES
from herringbone_sim.core.model import Model

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Rows of the constants (rows, n_mesh, LANES); by mesh, side or coordinate as in ``Packed``.
STIFFNESS, DAMPING, BORDER, E_MEAN = 0, 1, 2, 3
SUN, PLANET, CARRIER = 4, 5, 6  # inverse masses times the planets and halves they stand for
LOAD_Q, LOAD_R, CONTROL_Q, CONTROL_R = 7, 8, 9, 10
CONTROL_ORDER, CONTROL_PHASE, OMEGA, STEP = 11, 12, 13, 14
HARMONICS = 15  # then K_COS, K_SIN, E_COS, E_SIN of each harmonic

# Rows of ``Work.mesh`` and of ``Work.lane``.
CONTACT, END, END_SLOPE, AT, NEXT, DRIVE, BACK = range(7)
DONE, LEFT, PHASE, MOVE, ANGLE, SWITCHES = range(6)


class Work(NamedTuple):
    """Scratch of one batch; p = order, n = meshes, m = coordinates, each times LANES."""

    constants: Array  # (rows, n)
    y: Array  # (1 + tangents, 2 m) the state and the tangent vectors
    k: Array  # (p + 1, n) series of the stiffness
    error: Array  # (p + 1, n) series of e
    scale: Array  # (p + 1, 1) series of one harmonic without its phase
    load: Array  # (p + 1, m) series of the outer acceleration
    q: Array  # (p + 1, m) series of the displacements
    v: Array  # (p + 1, m) series of the velocities
    x: Array  # (p + 1, n) series of the deflections
    f: Array  # (p + 1, n) the same where in contact, else 0
    force: Array  # (1, n) one order of the mesh forces
    mesh: Array  # (7, n) contact and what decides on its switching
    lane: Array  # (6, 1) where in its step each lane is
    value: Indices  # number of the value in each lane, -1 when idle; as the next ones (LANES,)
    place: Indices  # grid step within the cycle
    cycle: Indices  # cycles done
    steps: Indices  # grid steps a cycle


def make_work(rows: int, n_mesh: int, n_coordinate: int, order: int, tangents: int) -> Work:
    """Scratch for a batch."""
    p = order + 1

    def zeros(*shape: int) -> Array:
        return np.zeros((*shape, LANES))

    return Work(
        constants=zeros(rows, n_mesh),
        y=zeros(1 + tangents, 2 * n_coordinate),
        k=zeros(p, n_mesh),
        error=zeros(p, n_mesh),
        scale=zeros(p, 1),
        load=zeros(p, n_coordinate),
        q=zeros(p, n_coordinate),
        v=zeros(p, n_coordinate),
        x=zeros(p, n_mesh),
        f=zeros(p, n_mesh),
        force=zeros(1, n_mesh),
        mesh=zeros(7, n_mesh),
        lane=zeros(6, 1),
        value=np.full(LANES, -1),
        place=np.zeros(LANES, dtype=np.int64),
        cycle=np.zeros(LANES, dtype=np.int64),
        steps=np.ones(LANES, dtype=np.int64),
    )


def constants(models: Sequence[Model], sides: int) -> Array:
    """Constants (n_models, rows, n_mesh) of models of one layout, of one half or both."""
    table = np.zeros((len(models), _rows(models), models[0].layout.n_mesh // 2 * sides))
    for i, model in enumerate(models):
        _fill(table[i], model, sides)
    return table


def _rows(models: Sequence[Model]) -> int:
    return HARMONICS + 4 * max(
        max(len(model.packed.k_cos), len(model.packed.e_cos)) for model in models
    )


def _fill(row: Array, model: Model, sides: int) -> None:
    p, c = model.packed, model.layout.n_classes
    meshes = np.arange(4 * c).reshape(2, 2, c)[:, :sides].ravel()
    row[STIFFNESS], row[DAMPING] = p.stiffness[meshes], p.damping[meshes]
    row[BORDER], row[E_MEAN] = p.b[meshes], p.e_mean[meshes]
    row[SUN, :sides] = p.multiplicity * p.inv_M_s[:sides]
    row[PLANET, : sides * c] = p.inv_M_p[:sides].ravel()
    row[CARRIER] = p.multiplicity * (2 / sides) * p.inv_M_c
    row[LOAD_Q, :sides], row[LOAD_R] = p.load_q[:sides], p.load_r
    row[CONTROL_Q, :sides], row[CONTROL_R, :sides] = (
        p.K * p.control_q[:sides],
        p.K * p.control_r[:sides],
    )
    row[CONTROL_ORDER], row[CONTROL_PHASE] = p.control_order, p.control_phase
    row[OMEGA], row[STEP] = p.Omega, 2 * np.pi / (p.Omega * model.parameters.steps)
    for first, table in enumerate((p.k_cos, p.k_sin, p.e_cos, p.e_sin)):
        for j, amplitudes in enumerate(table):
            row[HARMONICS + 4 * j + first] = amplitudes[meshes]
