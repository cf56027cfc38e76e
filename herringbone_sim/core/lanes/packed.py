"""What the kernel reads and scribbles on; the last axis of every array is the lane, if any.

A motion whose halves are alike is integrated as one half (``sides`` 1): its meshes stand for two.

Over 300 lines: the rows of the arrays stand beside the functions that fill them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.lanes.vector import LANES
from herringbone_sim.core.model import Model

Indices = NDArray[np.int64]

# Rows of the constants (rows, n_mesh, LANES); by mesh, side or coordinate as in ``Packed``.
STIFFNESS, DAMPING, BORDER, E_MEAN = 0, 1, 2, 3
SUN, PLANET, CARRIER = 4, 5, 6  # inverse masses times the planets and halves they stand for
LOAD_Q, LOAD_R, CONTROL_Q, CONTROL_R = 7, 8, 9, 10
CONTROL_ORDER, CONTROL_PHASE, OMEGA, STEP = 11, 12, 13, 14
HARMONICS = 15  # then ORDER, K_COS, K_SIN, E_COS, E_SIN of each harmonic
ORDER, K_COS, K_SIN, E_COS, E_SIN = range(5)
# Behind the harmonics LOAD_ORDER, LOAD_COS, LOAD_SIN of each torque, by coordinate, and then
# PERIOD, POSITION, WIDTH, WINDOW_K, WINDOW_D of each event.
LOAD_ORDER, LOAD_COS, LOAD_SIN = range(3)
PERIOD, POSITION, WIDTH, WINDOW_K, WINDOW_D = range(5)
# Of gears that are not plain, behind all of these: REFERENCE, EXPONENT, SHARE of the damping by
# another law, its POWER and DEPTH, by mesh; OPEN, the damping out of contact, and HALF, half of
# the play, by mesh and seat; STIFF and ROUNDING of the seats, behind the meshes. Then
# ``own_shift``, a row a further coordinate, and ``push``, a row an acceleration; both twice, for
# motions in which left and right are alike, and for perturbations that part them. Seats have
# DAMPING and BORDER, too.
REFERENCE, EXPONENT, OTHER, POWER, DEPTH, OPEN, HALF, STIFF, ROUNDING = range(9)
ROWS_OF_LAWS = 9
ROWS_A_HARMONIC, ROWS_A_LOAD, ROWS_A_WINDOW = 5, 3, 5
NEVER = 1e300  # mesh cycles between the events of a value that has none

# Rows of ``Work.mesh`` and of ``Work.lane``.
CONTACT, END, END_SLOPE, AT, NEXT, DRIVE, BACK, DEEP, SIGN, AT_DEPTH, AT_SIGN = range(11)
DAMP, JUMP = 11, 12  # damping in the present contact; jump of the force over the rate
DONE, LEFT, SHARE, PHASE, MOVE, ANGLE, CYCLE, SWITCHES = range(8)
START, SIDE, TURN = 8, 9, 10  # turn of the flanks from the pitch point, its side, turn of the step


class Work(NamedTuple):
    """Scratch of one batch; p = order, n = meshes, m = coordinates, s = further ones among them,
    t = pairs, each times LANES.
    """

    constants: Array  # (rows, n)
    y: Array  # (1 + tangents, 2 m) the state and the tangent vectors
    k: Array  # (p + 1, n) series of the stiffness
    error: Array  # (p + 1, n) series of e
    scale: Array  # (p + 1, 1) series of one harmonic without its phase
    load: Array  # (p + 1, m) series of the outer acceleration
    q: Array  # (p + 1, m) series of the displacements
    v: Array  # (p + 1, m) series of the velocities
    x: Array  # (p + 1, n + s) series of the deflections, of seats behind those of meshes
    f: Array  # (p + 1, n + s) the same where in contact, else 0
    force: Array  # (1, n + s) one order of the forces
    forces: Array  # (p + 1, n + s) series of them, of gears that are not plain
    push: Array  # (1, m + 1) accelerations that ``pairs`` add, last of the carrier
    mix: Array  # (4 t, 1) by a force and by its order before; then both where halves part
    mesh: Array  # (13, n + s) contact and what decides on its switching
    lane: Array  # (11, 1) where in its step each lane is
    turned: Array  # (h + l, 1) angle of each harmonic at phase 0 of the cycle
    bump: Array  # (p + 1, 1) series of an event
    shape: Indices  # as ``Shape``
    pairs: Indices  # (t, 2) rows and columns of ``push`` that hold anything in any gear
    shifts: Indices  # (.., 2) rows and columns of ``own_shift``, likewise
    rubs: Indices  # (r,) meshes with friction, likewise
    own: NonlinearWork
    value: Indices  # number of the value in each lane, -1 when idle; as the next ones (LANES,)
    place: Indices  # grid step within the cycle
    cycle: Indices  # cycles done
    steps: Indices  # grid steps a cycle


class NonlinearWork(NamedTuple):
    """Scratch for gears whose forces are nonlinear between switches (``Packed.powers``).

    p, n, s and the axis of lanes as in ``Work``; the series of other gears are empty. f is the
    deflection beyond the backlash, |f| its depth.
    """

    rate: Array  # (p + 1, n + s) series of the rate of deflection
    depth: Array  # (p + 1, n) series of |f|
    spring_power: Array  # (p + 1, n) series of |f| to the exponent of the spring's law
    damper_power: Array  # (p + 1, n) series of |f| to the exponent of the damping's law
    spring: Array  # (p + 1, n) series of the spring's part of the force over k
    damper: Array  # (p + 1, n) series of the factor on c v
    soft: Array  # (p + 1, n) series of the derivative of the mesh force by the deflection
    damp: Array  # (p + 1, n) series of the derivative of the mesh force by the rate
    factor: Array  # (4, n) on f and c v while the law is taken linear, and on the powers else
    give: Array  # (p + 1, s) series of the derivative of the seats' forces by the deflection
    corner: Array  # (6 (p + 1), s) series of both rounded corners of the play of seats
    other: Array  # (p + 1, n) series of ``spring_power`` or ``damper_power`` over |f|
    met: Array  # (1, n) stiffness k at the end of a move


def make_work(
    table: Array,
    shape: Shape,
    n_mesh: int,
    sides: int,
    order: int,
    tangents: int,
    lanes: tuple[int, ...] = (LANES,),
) -> Work:
    """Scratch for a batch with these constants and so much in them.

    Args:
        table: (n, rows, entries) of ``constants``.
        lanes: last axis of all arrays; none, ``()``, for one orbit.
    """
    p, n_all, n_row = order + 1, sides + n_mesh // 2 + shape.own, n_mesh + shape.own
    q = p if shape.powers else 0
    pairs, shifts, rubs = _what_acts(table, shape, n_all, n_row)

    def zeros(*shape: int) -> Array:
        return np.zeros((*shape, *lanes))

    return Work(
        constants=zeros(*table.shape[1:]),
        y=zeros(1 + tangents, 2 * n_all),
        k=zeros(p, n_mesh),
        error=zeros(p, n_mesh),
        scale=zeros(p, 1),
        load=zeros(p, n_all),
        q=zeros(p, n_all),
        v=zeros(p, n_all),
        x=zeros(p, n_row),
        f=zeros(p, n_row),
        force=zeros(1, n_row),
        forces=zeros(p, n_row),
        push=zeros(1, n_all + 1),
        mix=zeros(4 * len(pairs), 1),
        mesh=zeros(13, n_row),
        lane=zeros(11, 1),
        turned=zeros(shape.harmonics + shape.loads, 1),
        bump=zeros(p, 1),
        shape=np.array(shape, dtype=np.int64),
        pairs=pairs,
        shifts=shifts,
        rubs=rubs,
        own=NonlinearWork(
            rate=zeros(q, n_row),
            depth=zeros(q, n_mesh),
            spring_power=zeros(q, n_mesh),
            damper_power=zeros(q, n_mesh),
            spring=zeros(q, n_mesh),
            damper=zeros(q, n_mesh),
            soft=zeros(q, n_mesh),
            damp=zeros(q, n_mesh),
            factor=zeros(4, n_mesh),
            give=zeros(q, shape.own),
            corner=zeros(6 * q, shape.own),
            other=zeros(q, n_mesh),
            met=zeros(1, n_mesh),
        ),
        value=np.full(lanes or 1, -1),
        place=np.zeros(lanes or 1, dtype=np.int64),
        cycle=np.zeros(lanes or 1, dtype=np.int64),
        steps=np.ones(lanes or 1, dtype=np.int64),
    )


class Shape(NamedTuple):
    """The most that any value of a batch has of what the gears may have several of."""

    harmonics: int
    loads: int
    windows: int
    powers: int  # 1 where a gear has powers
    own: int  # further coordinates that are integrated, the same number in every gear
    extended: int  # 1 where a gear is not plain


def shape_of(models: Sequence[Model], own: int) -> Shape:
    """Shape that holds all of these models, with so many further coordinates."""
    gears = [model.packed for model in models]
    return Shape(
        max(len(p.orders) for p in gears),
        max(len(p.load_orders) for p in gears),
        max(len(p.windows) for p in gears),
        int(any(p.powers for p in gears)),
        own,
        int(any(not p.plain for p in gears)),
    )


def constants(models: Sequence[Model], sides: int, shape: Shape) -> Array:
    """Constants (n_models, rows, entries) of models of one layout, of one half or both.

    A row has an entry a mesh and seat, or a coordinate where there are more of those.
    """
    loads = HARMONICS + ROWS_A_HARMONIC * shape.harmonics
    windows = loads + ROWS_A_LOAD * shape.loads
    laws = windows + ROWS_A_WINDOW * shape.windows
    n_all = (models[0].layout.n_coordinate - 2) // 2 * sides + sides + shape.own
    rows_of_laws = ROWS_OF_LAWS + 2 * shape.own + 6 * (n_all + 1)
    n = models[0].layout.n_mesh // 2 * sides
    rows = laws + shape.extended * rows_of_laws
    table = np.zeros((len(models), rows, max(n + shape.own, n_all)))
    for i, model in enumerate(models):
        _fill(table[i, :, :n], model, sides)
        _fill_loads(table[i, loads:windows], model, sides)
        _fill_windows(table[i, windows:laws, :n], model, sides)
        if shape.extended:
            _fill_laws(table[i], laws, model, sides)
    return table


def _what_acts(
    table: Array, shape: Shape, n_all: int, n_row: int
) -> tuple[Indices, Indices, Indices]:
    """Pairs, shifts and meshes that rub of a table of constants, as in ``Work``."""
    none = np.zeros((0, 2), dtype=np.int64)
    if not shape.extended:
        return none, none, none[:, 0]
    acts: NDArray[np.bool_] = np.any(table[:, :, :n_row] != 0.0, axis=0)
    first = len(acts) - 6 * (n_all + 1)
    push: NDArray[np.bool_] = np.any(acts[first:].reshape(2, 3, n_all + 1, n_row), axis=0)
    shift = acts[first - 2 * shape.own : first].reshape(2, shape.own, n_row).any(axis=0)
    pairs, shifts = np.argwhere(push.any(axis=0)), np.argwhere(shift)
    rubs = np.flatnonzero(push[1:].any(axis=(0, 1)))
    return np.ascontiguousarray(pairs), np.ascontiguousarray(shifts), rubs


def _fill(row: Array, model: Model, sides: int) -> None:
    p = model.packed
    c, meshes = model.layout.n_classes, _meshes(model, sides)
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
    for j, order in enumerate(p.orders):
        one = row[HARMONICS + ROWS_A_HARMONIC * j :]
        one[ORDER] = order
        one[K_COS], one[K_SIN] = p.k_cos[j, meshes], p.k_sin[j, meshes]
        one[E_COS], one[E_SIN] = p.e_cos[j, meshes], p.e_sin[j, meshes]


def _meshes(model: Model, sides: int) -> Indices:
    """Numbers of the meshes that are integrated."""
    c = model.layout.n_classes
    return np.arange(4 * c).reshape(2, 2, c)[:, :sides].ravel()


def _fill_loads(rows: Array, model: Model, sides: int) -> None:
    p, c = model.packed, model.layout.n_classes
    m, own = model.layout.n_coordinate, chosen_own(model, sides)
    chosen = np.concatenate([np.arange(sides), 2 + np.arange(sides * c), m + own])
    for j, order in enumerate(p.load_orders):
        one = rows[ROWS_A_LOAD * j :]
        one[LOAD_ORDER] = order
        one[LOAD_COS, : len(chosen)] = p.load_cos[j, chosen]
        one[LOAD_SIN, : len(chosen)] = p.load_sin[j, chosen]


def _fill_windows(rows: Array, model: Model, sides: int) -> None:
    rows[PERIOD::ROWS_A_WINDOW] = NEVER
    p, meshes = model.packed, _meshes(model, sides)
    for j, window in enumerate(p.windows):
        one = rows[ROWS_A_WINDOW * j :]
        one[PERIOD], one[POSITION], one[WIDTH] = window
        one[WINDOW_K], one[WINDOW_D] = p.window_k[j, meshes], p.window_d[j, meshes]


def _fill_laws(rows: Array, laws: int, model: Model, sides: int) -> None:
    """Laws, friction and further coordinates, from a row on, and the dampers of seats."""
    p, c, m = model.packed, model.layout.n_classes, model.layout.n_coordinate
    own, meshes = chosen_own(model, sides), _meshes(model, sides)
    s, n = len(own), len(meshes)
    seat, behind = p.seat[own], slice(n, n + s)
    rows[DAMPING, behind] = seat[:, 1]
    rows[BORDER, behind] = np.where((seat[:, 2] > 0.0) & (seat[:, 3] == 0.0), seat[:, 2], -NEVER)
    law = rows[laws:]
    law[: DEPTH + 1, :n] = p.law[:, meshes]
    law[OPEN, :n] = p.damping[meshes] * (1.0 - p.law[2, meshes])
    law[OPEN, behind], law[HALF, behind] = seat[:, 1], seat[:, 2]
    law[HALF, :n] = p.b[meshes]
    law[STIFF, behind], law[ROUNDING, behind] = seat[:, 0], seat[:, 3]
    to = np.concatenate([np.arange(sides), 2 + np.arange(sides * c), m + own, [m + len(p.seat)]])
    sources = np.concatenate([meshes, 4 * c + own])
    shifts = law[ROWS_OF_LAWS : ROWS_OF_LAWS + 2 * s, :n].reshape(2, s, n)
    pushes = law[ROWS_OF_LAWS + 2 * s :, : n + s].reshape(2, 3, len(to), n + s)
    shifts[:], pushes[:] = p.own_shift[own][:, meshes], p.push[:, to][:, :, sources]
    if sides == 1:  # the other half moves along, or against it
        mirror, twins = np.arange(4 * c).reshape(2, 2, c)[:, ::-1].ravel(), own_mirror(model)[own]
        other_shift = p.own_shift[twins][:, meshes]
        other_push = p.push[:, to][:, :, np.concatenate([mirror[meshes], 4 * c + twins])]
        here = np.concatenate([np.ones(n), twins != own])  # on the mirror it counts once
        shifts[0] += here[n:, None] * other_shift
        pushes[0] += here * other_push
        shifts[1] -= other_shift
        pushes[1] -= other_push


def own_mirror(model: Model) -> Indices:
    """Further coordinate (s,) that each one is the mirror image of, left for right.

    One that carries both halves is its own; one without an image, too, which ``batch`` finds out.
    """
    p, c = model.packed, model.layout.n_classes
    mirrored = p.own_shift.reshape(-1, 2, 2, c)[:, :, ::-1].reshape(-1, 4 * c)
    found = np.arange(len(p.seat))
    for j in found:
        same = (p.own_shift == mirrored[j]).all(axis=1) & (p.seat == p.seat[j]).all(axis=1)
        if same.any():
            found[j] = np.flatnonzero(same)[0]
    return found


def chosen_own(model: Model, sides: int) -> Indices:
    """Numbers of the further coordinates that are integrated: of mirror images the first."""
    every = np.arange(model.n_own)
    return every if sides == 2 else every[every <= own_mirror(model)]
