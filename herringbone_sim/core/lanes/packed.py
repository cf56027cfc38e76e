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
HARMONICS = 15  # then ORDER, K_COS, K_SIN, E_COS, E_SIN of each harmonic
ORDER, K_COS, K_SIN, E_COS, E_SIN = range(5)
# Behind the harmonics LOAD_ORDER, LOAD_COS, LOAD_SIN of each torque, by coordinate, and then
# PERIOD, POSITION, WIDTH, WINDOW_K, WINDOW_D of each event.
LOAD_ORDER, LOAD_COS, LOAD_SIN = range(3)
PERIOD, POSITION, WIDTH, WINDOW_K, WINDOW_D = range(5)
# Of gears that are not plain, behind all that is counted from the end: REFERENCE, EXPONENT, SHARE
# of the damping by another law, its POWER and DEPTH, by mesh; STIFF, DASHPOT, HALF_PLAY, ROUNDING
# of each further coordinate; then a row a coordinate of slide (two), own_force and own_hold, and a
# row a further coordinate of own_shift.
REFERENCE, EXPONENT, OTHER, POWER, DEPTH = range(5)
STIFF, DASHPOT, HALF_PLAY, ROUNDING = range(5, 9)
ROWS_OF_LAWS = 9
ROWS_A_HARMONIC, ROWS_A_LOAD, ROWS_A_WINDOW = 5, 3, 5
NEVER = 1e300  # mesh cycles between the events of a value that has none

# Rows of ``Work.mesh`` and of ``Work.lane``.
CONTACT, END, END_SLOPE, AT, NEXT, DRIVE, BACK, DEEP, SIGN, AT_DEPTH, AT_SIGN = range(11)
DONE, LEFT, SHARE, PHASE, MOVE, ANGLE, CYCLE, SWITCHES = range(8)


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
    lane: Array  # (8, 1) where in its step each lane is
    turned: Array  # (h + l, 1) angle of each harmonic at phase 0 of the cycle
    bump: Array  # (p + 1, 1) series of an event
    shape: Indices  # as ``Shape``
    own: AnyWork
    value: Indices  # number of the value in each lane, -1 when idle; as the next ones (LANES,)
    place: Indices  # grid step within the cycle
    cycle: Indices  # cycles done
    steps: Indices  # grid steps a cycle


class AnyWork(NamedTuple):
    """Scratch of gears that are not plain, as ``core.packed.AnyWork``, each times LANES."""

    rate: Array  # (p + 1, n) series of the rate of deflection
    depth: Array  # (p + 1, n) series of |f|
    spring_power: Array  # (p + 1, n) series of its power in the law of the spring
    damper_power: Array  # (p + 1, n) series of its power in the law of the damping
    spring: Array  # (p + 1, n) series of the spring's part of the force over k
    damper: Array  # (p + 1, n) series of the factor on c v
    force: Array  # (p + 1, n) series of the mesh force
    soft: Array  # (p + 1, n) series of its derivative by the deflection
    damp: Array  # (p + 1, n) series of its derivative by the rate
    factor: Array  # (4, n) on f and c v while the law is taken linear, and on the powers else
    hold: Array  # (p + 1, s) series of the springs on further coordinates
    give: Array  # (p + 1, s) series of their derivative
    corner: Array  # (6 (p + 1), s) series of both corners of their play
    other: Array  # (p + 1, n) the same as ``force`` and ``hold`` of a tangent vector
    other_hold: Array  # (p + 1, s)
    met: Array  # (1, n) stiffness at the end of a move
    jump: Array  # (1, n) of the mesh force at a switch, over the rate of deflection
    push: Array  # (1, m + s)
    turn: Array  # (3, 1) turn from the pitch point, which side, and turn of the step


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
    p, n_all = order + 1, sides + n_mesh // 2 + shape.own
    q = p if shape.any else 0

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
        x=zeros(p, n_mesh),
        f=zeros(p, n_mesh),
        force=zeros(1, n_mesh),
        mesh=zeros(11, n_mesh),
        lane=zeros(8, 1),
        turned=zeros(shape.harmonics + shape.loads, 1),
        bump=zeros(p, 1),
        shape=np.array(shape, dtype=np.int64),
        own=AnyWork(
            rate=zeros(q, n_mesh),
            depth=zeros(q, n_mesh),
            spring_power=zeros(q, n_mesh),
            damper_power=zeros(q, n_mesh),
            spring=zeros(q, n_mesh),
            damper=zeros(q, n_mesh),
            force=zeros(q, n_mesh),
            soft=zeros(q, n_mesh),
            damp=zeros(q, n_mesh),
            factor=zeros(4, n_mesh),
            hold=zeros(q, shape.own),
            give=zeros(q, shape.own),
            corner=zeros(6 * q, shape.own),
            other=zeros(q, n_mesh),
            other_hold=zeros(q, shape.own),
            met=zeros(1, n_mesh),
            jump=zeros(1, n_mesh),
            push=zeros(1, n_all),
            turn=zeros(3, 1),
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
    any: int  # 1 where a gear is not plain
    own: int  # further coordinates, the same number in every gear
    rubs: int  # 1 where there is friction

    @property
    def rows_of_laws(self) -> int:
        """Rows of the constants for gears that are not plain, without those a coordinate."""
        return ROWS_OF_LAWS + self.own if self.any else 0


def shape_of(models: Sequence[Model]) -> Shape:
    """Shape that holds all of these models."""
    gears = [model.packed for model in models]
    return Shape(
        max(len(p.orders) for p in gears),
        max(len(p.load_orders) for p in gears),
        max(len(p.windows) for p in gears),
        int(any(not p.plain for p in gears)),
        len(gears[0].seat),
        int(any(len(p.slide) for p in gears)),
    )


def constants(models: Sequence[Model], sides: int, shape: Shape) -> Array:
    """Constants (n_models, rows, entries) of models of one layout, of one half or both.

    A row has an entry a mesh, or a coordinate where there are more of those.
    """
    loads = HARMONICS + ROWS_A_HARMONIC * shape.harmonics
    windows = loads + ROWS_A_LOAD * shape.loads
    laws = windows + ROWS_A_WINDOW * shape.windows
    n_all = (models[0].layout.n_coordinate - 2) // 2 * sides + sides + shape.own
    rows = laws + shape.rows_of_laws + 4 * n_all * shape.any
    n = models[0].layout.n_mesh // 2 * sides
    table = np.zeros((len(models), rows, max(n, n_all)))
    for i, model in enumerate(models):
        _fill(table[i, :, :n], model, sides)
        _fill_loads(table[i, loads:windows], model, sides)
        _fill_windows(table[i, windows:laws, :n], model, sides)
        if shape.any:
            _fill_laws(table[i, laws:], model, sides, shape)
    return table


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
    m, s = model.layout.n_coordinate, model.n_own
    chosen = np.concatenate([np.arange(sides), 2 + np.arange(sides * c), m + np.arange(s)])
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


def _fill_laws(rows: Array, model: Model, sides: int, shape: Shape) -> None:
    """Laws, friction and further coordinates; of one half its meshes stand for both."""
    p, s = model.packed, shape.own
    c, m, meshes = model.layout.n_classes, model.layout.n_coordinate, _meshes(model, sides)
    n = len(meshes)
    rows[:5, :n] = p.law[:, meshes]
    rows[5:9, :s] = p.seat.T
    rows[ROWS_OF_LAWS : ROWS_OF_LAWS + s, :n] = p.own_shift[:, meshes]
    first = ROWS_OF_LAWS + s
    chosen = np.concatenate([np.arange(sides), 2 + np.arange(sides * c), m + np.arange(s)])
    n_all = len(chosen)
    slide = np.zeros((2, m + s, 4 * c))
    slide[:, :m] = p.slide if len(p.slide) else 0.0
    both = [slide[0], slide[1], p.own_force]
    if sides == 1:
        both = [one + one.reshape(-1, 2, 2, c)[:, :, ::-1].reshape(-1, 4 * c) for one in both]
    for which, one in enumerate(both):
        here = rows[first + which * n_all : first + (which + 1) * n_all, :n]
        here[:] = one[np.ix_(chosen, meshes)]
    rows[first + 3 * n_all : first + 4 * n_all, :s] = p.own_hold[chosen]
