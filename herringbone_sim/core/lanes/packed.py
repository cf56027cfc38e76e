"""Constants and work arrays of the kernel; the last axis of every array is the lane, if any.

A motion whose halves are equal is integrated as one half (``sides`` 1): its meshes stand for two.
Lanes advance by moves. A move goes to the end of an interval or to the first switch in it; the
interval goes to the end of the step of the phase grid, or to the first place in it that is known
before, as the edge of an event. Series are Taylor coefficients, order i in row i, in the fraction
of the interval. Common arguments of the compiled functions:

- ``w``: a reference (``core.reference``) to ``Work``; ``i``: an order; ``a``, ``m``: a column, of
  a mesh or, behind the meshes, of a seat (the spring of a coordinate that effects add, see
  ``core.packed``); ``lane``: one lane.
- ``unrolled``: tuples of zeros, as many as sides, as classes, and one if a gear is not plain.
  Their lengths are part of their type: loops are unrolled, and plain gears compile without the
  rest.
- ``forced``: True for the state; tangent vectors are without errors, borders and loads.
- ``coupled``: False for tangent vectors that are antisymmetric in left and right.
- ``controlled``: whether any gear has control or added torques; ``inverse``: 1 / i at index i.
- ``neighbours``: None, or the derivatives by parameters to integrate too, see
  ``columns.Neighbours``.

Over 300 lines: the rows of the arrays stand beside the functions that fill them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from herringbone_sim.arrays import Array, Flags, Indices
from herringbone_sim.core.lanes.vector import LANES
from herringbone_sim.core.model import Model

# Rows of the constants (rows, entries, LANES); by mesh, half or coordinate, see ``constants``.
STIFFNESS, DAMPING, BORDER, E_MEAN = 0, 1, 2, 3
SUN, PLANET, CARRIER = 4, 5, 6  # inverse masses times the planets and halves they stand for
LOAD_Q, LOAD_R, CONTROL_Q, CONTROL_R = 7, 8, 9, 10
CONTROL_ORDER, CONTROL_PHASE, OMEGA, STEP, LONGEST = 11, 12, 13, 14, 15
HARMONICS = 16  # then ORDER, K_COS, K_SIN, E_COS, E_SIN of each harmonic
ORDER, K_COS, K_SIN, E_COS, E_SIN = range(5)
# Behind the harmonics LOAD_ORDER, LOAD_COS, LOAD_SIN of each torque, by coordinate, and then
# PERIOD, POSITION, WIDTH, EVENT_K, EVENT_D of each event.
LOAD_ORDER, LOAD_COS, LOAD_SIN = range(3)
PERIOD, POSITION, WIDTH, EVENT_K, EVENT_D = range(5)
# Of gears that are not plain, behind all of these: the five rows of ``Packed.law`` by mesh
# (DAMPING_SHARE, POWER, DEPTH are law[2:]); OPEN, the damping out of contact, and HALF, half of
# the play, by mesh and seat; STIFF and ROUNDING of the seats, behind the meshes. Then
# ``added_shift``, a row for each added coordinate, and ``push``, a row for each acceleration; both
# twice, for ``coupled`` motions and for antisymmetric perturbations. Seats have DAMPING and
# BORDER, too.
REFERENCE, EXPONENT, DAMPING_SHARE, POWER, DEPTH, OPEN, HALF, STIFF, ROUNDING = range(9)
ROWS_OF_LAWS = 9
ROWS_A_HARMONIC, ROWS_A_LOAD, ROWS_AN_EVENT = 5, 3, 5
# Of the amplitude of what effects add, see ``_parts_of_step``: the accuracy that
# ``benchmarks.effects`` holds states to.
LEFT_OUT = 1e-8
NEVER = 1e300  # mesh cycles between the events of a model that has none

# Rows of ``Work.mesh_state``: contact (1 drive, 0 separated, -1 back); x and its slope at the end
# of the interval; fraction of it at which contact switches (2: not) and to which; grid steps in
# drive and back contact; whether |f| > ``LINEAR_BELOW``; sign of the force; fractions at which
# these two switch.
CONTACT, END, END_SLOPE, AT, NEXT, DRIVE, BACK, DEEP, SIGN, AT_DEPTH, AT_SIGN = range(11)
DAMP, JUMP = 11, 12  # damping in the present contact; jump of the force over the rate
# Rows of ``Work.progress``: fraction of the grid step that is done; length of the interval (tau)
# and its fraction of the rest of the step; phase at its start; fraction of it that the move
# covers; angle of the control at phase 0; mesh cycle; moves done in the step.
DONE, LEFT, SHARE, PHASE, MOVE, ANGLE, CYCLE, SWITCHES = range(8)
# Mesh cycles from the pitch point, and on which side of it; mesh cycles of the interval.
PITCH_START, PITCH_SIDE, INTERVAL_CYCLES = 8, 9, 10


class Work(NamedTuple):
    """Constants and work arrays of the lanes, or of one orbit (arrays then have no lane axis).

    p = order of the series, n = meshes, m = coordinates, s = those among them that effects add,
    h = harmonics, l = harmonics of added torques, t = pairs, r = meshes with friction. A pair is
    an acceleration (of a coordinate, or last of the carrier) and a mesh or seat whose force
    contributes to it by the rows ``push`` of the constants; plain gears have none.
    """

    constants: Array  # (rows, n)
    y: Array  # (1 + tangents, 2 m) the state and the tangent vectors
    k: Array  # (p + 1, n) series of the stiffness
    error: Array  # (p + 1, n) series of e
    scale: Array  # (p + 1, 1) series of one harmonic without its phase
    load: Array  # (p + 1, m) series of minus the acceleration by control and added torques
    q: Array  # (p + 1, m) series of the displacements
    v: Array  # (p + 1, m) series of the velocities
    x: Array  # (p + 1, n + s) series of the deflections, of seats behind those of meshes
    f: Array  # (p + 1, n + s) series of the deflection beyond the backlash
    force: Array  # (1, n + s) one order of the forces
    forces: Array  # (p + 1, n + s) series of the forces, of gears that are not plain
    push: Array  # (1, m + 1) one order of the accelerations by ``pairs``, last of the carrier
    mix: Array  # (4 t, 1) factors of ``pairs`` on orders i, i - 1 of a force; antisymmetric ones
    mesh_state: Array  # (13, n + s) contact and its switching, see CONTACT and the other rows
    progress: Array  # (11, 1) progress of each lane, see DONE and the other rows
    start_angles: Array  # (h + l, 1) angle of each harmonic at phase 0 of the cycle
    bump: Array  # (p + 1, 1) series of the height of an event
    sizes: Indices  # as ``Sizes``
    pairs: Indices  # (t, 2) rows and columns of ``push`` that are non-zero in any gear
    shifts: Indices  # (.., 2) rows and columns of ``added_shift``, likewise
    rubs: Indices  # (r,) meshes with friction in any gear
    nonlinear: NonlinearWork
    value: Indices  # (LANES,) number of the model in each lane, -1 for none
    step_index: Indices  # (LANES,) grid step within the cycle
    cycle: Indices  # (LANES,) cycles done
    steps: Indices  # (LANES,) grid steps per cycle


class NonlinearWork(NamedTuple):
    """Work arrays for gears whose forces are nonlinear between switches (``Packed.powers``).

    p, n, s and the axis of lanes as in ``Work``; the series of other gears are empty. f is the
    deflection beyond the backlash, |f| its depth.
    """

    rate: Array  # (p + 1, n + s) series of the rate of deflection
    depth: Array  # (p + 1, n) series of |f|
    spring_power: Array  # (p + 1, n) series of |f| to the exponent of the spring's law
    damper_power: Array  # (p + 1, n) series of |f| to the exponent of the damping's law
    spring: Array  # (p + 1, n) series of the spring's part of the force over k
    damper: Array  # (p + 1, n) series of the factor on c v
    force_by_x: Array  # (p + 1, n) series of the derivative of the mesh force by x
    force_by_v: Array  # (p + 1, n) series of the derivative of the mesh force by v
    factor: Array  # (4, n) on f and c v where the law is replaced by a linear one; on the powers
    seat_stiffness: Array  # (p + 1, s) series of the derivative of the seats' forces by x
    corner: Array  # (6 (p + 1), s) series of both rounded corners of the play of seats
    power_over_depth: Array  # (p + 1, n) series of ``spring_power`` or ``damper_power`` over |f|
    met: Array  # (1, n) stiffness k at the end of a move


def make_work(
    table: Array,
    sizes: Sizes,
    n_mesh: int,
    sides: int,
    order: int,
    tangents: int,
    lanes: tuple[int, ...] = (LANES,),
) -> Work:
    """Return work arrays that can hold the constants in a table; no constants are copied.

    Args:
        table: (n, rows, entries) of ``constants``.
        sizes: from ``sizes_of``.
        n_mesh, sides: meshes and halves that are integrated.
        lanes: last axis of all arrays; ``()`` for one orbit.
    """
    p, n_all, n_row = order + 1, sides + n_mesh // 2 + sizes.added, n_mesh + sizes.added
    q = p if sizes.powers else 0
    pairs, shifts, rubs = _what_acts(table, sizes, n_all, n_row)

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
        mesh_state=zeros(13, n_row),
        progress=zeros(11, 1),
        start_angles=zeros(sizes.harmonics + sizes.loads, 1),
        bump=zeros(p, 1),
        sizes=np.array(sizes, dtype=np.int64),
        pairs=pairs,
        shifts=shifts,
        rubs=rubs,
        nonlinear=NonlinearWork(
            rate=zeros(q, n_row),
            depth=zeros(q, n_mesh),
            spring_power=zeros(q, n_mesh),
            damper_power=zeros(q, n_mesh),
            spring=zeros(q, n_mesh),
            damper=zeros(q, n_mesh),
            force_by_x=zeros(q, n_mesh),
            force_by_v=zeros(q, n_mesh),
            factor=zeros(4, n_mesh),
            seat_stiffness=zeros(q, sizes.added),
            corner=zeros(6 * q, sizes.added),
            power_over_depth=zeros(q, n_mesh),
            met=zeros(1, n_mesh),
        ),
        value=np.full(lanes or 1, -1),
        step_index=np.zeros(lanes or 1, dtype=np.int64),
        cycle=np.zeros(lanes or 1, dtype=np.int64),
        steps=np.ones(lanes or 1, dtype=np.int64),
    )


class Sizes(NamedTuple):
    """Largest number of harmonics, torques, events ... that any gear of a batch has."""

    harmonics: int
    loads: int  # harmonics of added torques
    events: int
    powers: int  # 1 if any gear has powers
    added: int  # added coordinates that are integrated, the same number in every gear
    extended: int  # 1 if any gear is not plain


def sizes_of(models: Sequence[Model], added: int) -> Sizes:
    """Return the sizes that hold all models, with ``added`` added coordinates integrated."""
    gears = [model.packed for model in models]
    return Sizes(
        max(len(p.orders) for p in gears),
        max(len(p.load_orders) for p in gears),
        max(len(p.events) for p in gears),
        int(any(p.powers for p in gears)),
        added,
        int(any(not p.plain for p in gears)),
    )


def constants(models: Sequence[Model], sides: int, sizes: Sizes) -> Array:
    """Return a table (n_models, rows, entries) of the constants of models of one layout.

    The top of this module names the rows. The entries of a row are by mesh and seat, by half, by
    planet or by coordinate, as the row requires; entries behind them are 0. A single value stands
    in the entry of every mesh.

    Args:
        sides: number of halves that are integrated, 1 or 2.
        sizes: from ``sizes_of``.
    """
    loads = HARMONICS + ROWS_A_HARMONIC * sizes.harmonics
    events = loads + ROWS_A_LOAD * sizes.loads
    laws = events + ROWS_AN_EVENT * sizes.events
    n_all = (models[0].layout.n_coordinate - 2) // 2 * sides + sides + sizes.added
    rows_of_laws = ROWS_OF_LAWS + 2 * sizes.added + 6 * (n_all + 1)
    n = models[0].layout.n_mesh // 2 * sides
    rows = laws + sizes.extended * rows_of_laws
    table = np.zeros((len(models), rows, max(n + sizes.added, n_all)))
    for i, model in enumerate(models):
        _fill(table[i, :, :n], model, sides)
        _fill_loads(table[i, loads:events], model, sides)
        _fill_events(table[i, events:laws, :n], model, sides)
        if sizes.extended:
            _fill_laws(table[i], laws, model, sides)
    return table


def _what_acts(
    table: Array, sizes: Sizes, n_all: int, n_row: int
) -> tuple[Indices, Indices, Indices]:
    """Return ``pairs``, ``shifts`` and ``rubs`` of ``Work`` for a table of constants."""
    none = np.zeros((0, 2), dtype=np.int64)
    if not sizes.extended:
        return none, none, none[:, 0]
    acts: Flags = np.any(table[:, :, :n_row] != 0.0, axis=0)
    first = len(acts) - 6 * (n_all + 1)
    push: Flags = np.any(acts[first:].reshape(2, 3, n_all + 1, n_row), axis=0)
    shift = acts[first - 2 * sizes.added : first].reshape(2, sizes.added, n_row).any(axis=0)
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
    row[LONGEST] = row[STEP] / _parts_of_step(model)
    for j, order in enumerate(p.orders):
        harmonic = row[HARMONICS + ROWS_A_HARMONIC * j :]
        harmonic[ORDER] = order
        harmonic[K_COS], harmonic[K_SIN] = p.k_cos[j, meshes], p.k_sin[j, meshes]
        harmonic[E_COS], harmonic[E_SIN] = p.e_cos[j, meshes], p.e_sin[j, meshes]


def _parts_of_step(model: Model) -> int:
    """Return the number of intervals into which the fastest of what effects add divides a step.

    ``Parameters.steps`` knows the gear without effects. Effects add harmonics of other orders,
    windows of some width and seats that vibrate. In an interval in which one of them turns by z
    rad, the first term that a series of order n leaves out is z^(n + 1) / (n + 1)! of it; it
    stays below ``LEFT_OUT``, or z is that of the gear's own highest harmonic.
    """
    p, known = model.packed, model.parameters
    n = known.order
    acts = np.any([p.k_cos, p.k_sin, p.e_cos, p.e_sin], axis=(0, 2))
    orders = [*p.orders[acts], *p.load_orders, *(1.0 / p.events[:, 2])]
    added = slice(model.layout.n_coordinate, -1), slice(model.layout.n_mesh, None)
    squares = -np.diagonal(p.push[0][added]) * p.seat[:, 0]
    fastest = max(p.Omega * max(orders, default=0.0), np.sqrt(np.max(squares, initial=0.0)))
    z = fastest * 2.0 * np.pi / (p.Omega * known.steps)
    own = 2.0 * np.pi * max(len(known.k_amp), len(known.e_amp)) / known.steps
    longest = max(own, (LEFT_OUT * math.factorial(n + 1)) ** (1.0 / (n + 1)))
    parts: int = max(1, math.ceil(z / longest - 1e-9))
    return parts


def _meshes(model: Model, sides: int) -> Indices:
    """Return the indices of the meshes that are integrated."""
    c = model.layout.n_classes
    return np.arange(4 * c).reshape(2, 2, c)[:, :sides].ravel()


def _fill_loads(rows: Array, model: Model, sides: int) -> None:
    p, c = model.packed, model.layout.n_classes
    m, added = model.layout.n_coordinate, integrated_added(model, sides)
    chosen = np.concatenate([np.arange(sides), 2 + np.arange(sides * c), m + added])
    for j, order in enumerate(p.load_orders):
        harmonic = rows[ROWS_A_LOAD * j :]
        harmonic[LOAD_ORDER] = order
        harmonic[LOAD_COS, : len(chosen)] = p.load_cos[j, chosen]
        harmonic[LOAD_SIN, : len(chosen)] = p.load_sin[j, chosen]


def _fill_events(rows: Array, model: Model, sides: int) -> None:
    rows[PERIOD::ROWS_AN_EVENT] = NEVER
    p, meshes = model.packed, _meshes(model, sides)
    for j, event in enumerate(p.events):
        event_rows = rows[ROWS_AN_EVENT * j :]
        event_rows[PERIOD], event_rows[POSITION], event_rows[WIDTH] = event
        event_rows[EVENT_K], event_rows[EVENT_D] = p.event_k[j, meshes], p.event_d[j, meshes]


def _fill_laws(rows: Array, laws: int, model: Model, sides: int) -> None:
    """Write laws, ``added_shift``, ``push`` from row ``laws`` on; DAMPING and BORDER of seats."""
    p, c, m = model.packed, model.layout.n_classes, model.layout.n_coordinate
    added, meshes = integrated_added(model, sides), _meshes(model, sides)
    s, n = len(added), len(meshes)
    seat, behind = p.seat[added], slice(n, n + s)
    rows[DAMPING, behind] = seat[:, 1]
    rows[BORDER, behind] = np.where((seat[:, 2] > 0.0) & (seat[:, 3] == 0.0), seat[:, 2], -NEVER)
    law = rows[laws:]
    law[: DEPTH + 1, :n] = p.law[:, meshes]
    law[OPEN, :n] = p.damping[meshes] * (1.0 - p.law[2, meshes])
    law[OPEN, behind], law[HALF, behind] = seat[:, 1], seat[:, 2]
    law[HALF, :n] = p.b[meshes]
    law[STIFF, behind], law[ROUNDING, behind] = seat[:, 0], seat[:, 3]
    to = np.concatenate([np.arange(sides), 2 + np.arange(sides * c), m + added, [m + len(p.seat)]])
    sources = np.concatenate([meshes, 4 * c + added])
    shifts = law[ROWS_OF_LAWS : ROWS_OF_LAWS + 2 * s, :n].reshape(2, s, n)
    pushes = law[ROWS_OF_LAWS + 2 * s :, : n + s].reshape(2, 3, len(to), n + s)
    shifts[:], pushes[:] = p.added_shift[added][:, meshes], p.push[:, to][:, :, sources]
    if sides == 1:  # the other half moves with this one, or against it
        mirror = np.arange(4 * c).reshape(2, 2, c)[:, ::-1].ravel()
        twins = added_mirror(model)[added]
        other_shift = p.added_shift[twins][:, meshes]
        other_push = p.push[:, to][:, :, np.concatenate([mirror[meshes], 4 * c + twins])]
        here = np.concatenate([np.ones(n), twins != added])  # a coordinate of both halves: once
        shifts[0] += here[n:, None] * other_shift
        pushes[0] += here * other_push
        shifts[1] -= other_shift
        pushes[1] -= other_push


def added_mirror(model: Model) -> Indices:
    """Return the index (s,) of the added coordinate that is the mirror image of each.

    A coordinate of both halves is its own image; so is one without an image, which
    ``mirror.has_equal_halves`` detects.
    """
    p, c = model.packed, model.layout.n_classes
    mirrored = p.added_shift.reshape(-1, 2, 2, c)[:, :, ::-1].reshape(-1, 4 * c)
    images = np.arange(len(p.seat))
    for j in images:
        same = (p.added_shift == mirrored[j]).all(axis=1) & (p.seat == p.seat[j]).all(axis=1)
        if same.any():
            images[j] = np.flatnonzero(same)[0]
    return images


def integrated_added(model: Model, sides: int) -> Indices:
    """Return the indices of the added coordinates that are integrated.

    With ``sides`` 2 all; with 1 the first of each two mirror images.
    """
    every = np.arange(model.n_added_coordinates)
    return every if sides == 2 else every[every <= added_mirror(model)]
