"""Derivatives of the state by parameters (columns), integrated beside it: the compiled part.

For each parameter theta and each move two neighbours of the motion are integrated, with the
constants of theta + eps and theta - eps, in the same contact over the same fraction of the
interval; their difference over 2 eps is the column. Where the motion is affine between switches
the neighbours start from the state plus and minus eps times the column. Where it is not, they
start from the state itself, the column is integrated as a tangent vector, and the difference is
added. Where a force jumps, columns jump as tangent vectors do, with a term for the border that
theta moves. See ``core.sensitivity``; for arguments ``lanes.packed``.
"""

from __future__ import annotations

from typing import NamedTuple

from herringbone_sim.arrays import Array, Flags, Indices
from herringbone_sim.core.lanes.extended import jump_rows, shift_row
from herringbone_sim.core.lanes.nonlinear_series import (
    expand_nonlinear_motion,
    expand_nonlinear_tangent,
)
from herringbone_sim.core.lanes.packed import (
    ANGLE,
    BORDER,
    CONTACT,
    CONTROL_PHASE,
    MOVE,
    NEXT,
    SWITCHES,
    Work,
)
from herringbone_sim.core.lanes.series import expand_excitation, expand_motion, take_state
from herringbone_sim.core.lanes.vector import choose, fma, get, load, put, store
from herringbone_sim.core.packed import called, inlined
from herringbone_sim.core.reference import row_of


class Neighbours(NamedTuple):
    """Columns of the n models of a batch, p each, and work arrays of their neighbours."""

    table: Array  # (n, 2 p, rows, entries) constants, plus and minus of each in turn
    steps: Array  # (n, p, 1) eps
    starts: Array  # (n, p, n_state) columns at the start
    ends: Array  # (n, p, n_state) columns at the end
    constants: Array  # (2 p, rows, entries, LANES) of the models in the lanes
    step: Array  # (p, 1, LANES) eps of the models in the lanes
    excites: Flags  # (p,) whether k, e or the loads of any model differ between the neighbours
    columns: Array  # (p, n_state, LANES) present columns, advanced in place
    more: Array  # (p, n_state, LANES) change of the end of a move by each parameter alone
    border_shift: Array  # (p, n_mesh, LANES) change of the border that a mesh meets
    pair: Array  # (1, n_state, LANES) end state of the neighbour on the plus side
    work: Work  # work arrays of the neighbours
    # (2 p + 1, ..) tables of references: of ``work`` with the constants of each neighbour, then of
    # the motion's work arrays with ``columns`` as tangent vectors
    works: Indices


@called
def take_columns(neighbours, lane, value):
    """Copy start columns and neighbours' constants of model number ``value`` into a lane."""
    for c in range(neighbours.table.shape[1]):
        for row in range(neighbours.table.shape[2]):
            for m in range(neighbours.table.shape[3]):
                put(neighbours.constants[c], row, m, lane, neighbours.table[value, c, row, m])
    for c in range(neighbours.steps.shape[1]):
        put(neighbours.step, c, 0, lane, neighbours.steps[value, c, 0])
        for j in range(neighbours.starts.shape[2]):
            put(neighbours.columns, c, j, lane, neighbours.starts[value, c, j])


@called
def tell_columns(neighbours, lane, value):
    """Copy the columns of a lane into ``neighbours.ends``, as results of model ``value``."""
    for c in range(neighbours.columns.shape[0]):
        for j in range(neighbours.columns.shape[1]):
            neighbours.ends[value, c, j] = get(neighbours.columns, c, j, lane)


@inlined
def follow(w, neighbours):
    """Copy progress and contact of the lanes into the work arrays of the neighbours."""
    for row in range(w.progress.shape[0]):
        store(neighbours.work.progress, row, 0, load(w.progress, row, 0))
    for row in range(w.mesh_state.shape[0]):
        for m in range(w.mesh_state.shape[1]):
            store(neighbours.work.mesh_state, row, m, load(w.mesh_state, row, m))
    store(neighbours.work.progress, SWITCHES, 0, 1.0)  # not 0: contact and signs are not set anew


@inlined
def neighbour(w, neighbours, i):
    """Return the neighbours' work arrays with constants and control angle of neighbour i."""
    other = row_of(neighbours.work, neighbours.works, i)
    ahead = load(other.constants, CONTROL_PHASE, 0) - load(w.constants, CONTROL_PHASE, 0)
    store(other.progress, ANGLE, 0, load(w.progress, ANGLE, 0) + ahead)
    return other


@called
def copy_excitation(run, w):
    """Copy the series of k, e and the loads from the work arrays ``run`` to ``w``."""
    for i in range(w.k.shape[0]):
        for m in range(w.k.shape[1]):
            store(w.k, i, m, load(run.k, i, m))
            store(w.error, i, m, load(run.error, i, m))
        for k in range(w.load.shape[1]):
            store(w.load, i, k, load(run.load, i, k))


@called
def move_columns(unrolled, w, neighbours, inverse, controlled):
    """Advance columns by the move of each lane, for affine motions; ``w.y`` is before the move."""
    follow(w, neighbours)
    n = neighbours.columns.shape[1]
    for c in range(neighbours.columns.shape[0]):
        eps = load(neighbours.step, c, 0)
        for which in range(2):
            other = neighbour(w, neighbours, 2 * c + which)
            side = eps * (1.0 - 2.0 * which)
            for j in range(n):
                store(other.y, 0, j, fma(side, load(neighbours.columns, c, j), load(w.y, 0, j)))
            if neighbours.excites[c]:
                expand_excitation(other, inverse, controlled)
            elif which == 0:
                copy_excitation(w, other)
            expand_motion(unrolled, other, 0, True, True, controlled, inverse)
            take_state(unrolled, other, 0)
            if len(unrolled[2]) > 0:
                put_border_shift(w, neighbours, other, c, (0.5 - which) / eps, which == 0)
            for j in range(n):
                if which == 0:
                    store(neighbours.pair, 0, j, load(other.y, 0, j))
                else:
                    difference = load(neighbours.pair, 0, j) - load(other.y, 0, j)
                    store(neighbours.columns, c, j, difference / (eps + eps))


@called
def push_columns(unrolled, w, neighbours, inverse, controlled):
    """Compute the changes of a move by the parameters alone.

    They are ``neighbours.more`` and ``neighbours.border_shift``.
    """
    follow(w, neighbours)
    n = neighbours.columns.shape[1]
    for c in range(neighbours.columns.shape[0]):
        eps = load(neighbours.step, c, 0)
        scale = 0.5 / eps
        for which in range(2):
            other = neighbour(w, neighbours, 2 * c + which)
            for j in range(n):
                store(other.y, 0, j, load(w.y, 0, j))
            expand_excitation(other, inverse, controlled)
            expand_nonlinear_motion(unrolled, other, controlled, inverse)
            take_state(unrolled, other, 0)
            put_border_shift(w, neighbours, other, c, scale * (1.0 - 2.0 * which), which == 0)
            for j in range(n):
                if which == 0:
                    store(neighbours.pair, 0, j, load(other.y, 0, j))
                else:
                    difference = load(neighbours.pair, 0, j) - load(other.y, 0, j)
                    store(neighbours.more, c, j, difference * scale)


@called
def put_border_shift(w, neighbours, other, c, scale, fresh):
    """Add ``scale`` times the deflection at which each mesh of a neighbour meets its border.

    The sum is row c of ``neighbours.border_shift``, at the end of the move; ``fresh`` begins a new
    sum. Errors are added to the border, displacements by added coordinates subtracted.
    """
    first = w.q.shape[1] - w.sizes[4]
    for a in range(w.k.shape[1]):
        contact = load(w.mesh_state, CONTACT, a)
        side = choose(contact == 0.0, load(w.mesh_state, NEXT, a), contact)
        level = fma(side, load(other.constants, BORDER, a), at_move(w, other.error, a))
        for t in range(w.shifts.shape[0]):
            if w.shifts[t, 1] == a:
                j = w.shifts[t, 0]
                shift = load(other.constants, shift_row(w, True, j), a)
                level = level - shift * at_move(w, w.q, first + j)
        if fresh:
            store(neighbours.border_shift, c, a, level * scale)
        else:
            store(
                neighbours.border_shift,
                c,
                a,
                fma(level, scale, load(neighbours.border_shift, c, a)),
            )


@inlined
def at_move(w, series, a):
    """Return the value of column a of a series at the end of each lane's move."""
    move, value = load(w.progress, MOVE, 0), load(series, series.shape[0] - 1, a)
    for i in range(series.shape[0] - 2, -1, -1):
        value = fma(value, move, load(series, i, a))
    return value


@inlined
def jump_columns(unrolled, w, neighbours):
    """Apply the saltation matrix to columns where a mesh force jumps at the end of a move."""
    for c in range(neighbours.columns.shape[0]):
        jump_rows(unrolled, w, neighbours.columns, c, True, neighbours.border_shift)


@called
def move_nonlinear_columns(unrolled, w, neighbours, inverse):
    """Advance columns as tangent vectors and add ``neighbours.more``.

    Call ``expand_derivatives`` before.
    """
    of_columns = row_of(w, neighbours.works, neighbours.works.shape[0] - 1)
    for c in range(neighbours.columns.shape[0]):
        expand_nonlinear_tangent(unrolled, of_columns, c, True, inverse)
        take_state(unrolled, of_columns, c)
        for j in range(neighbours.columns.shape[1]):
            store(
                neighbours.columns,
                c,
                j,
                load(neighbours.columns, c, j) + load(neighbours.more, c, j),
            )
