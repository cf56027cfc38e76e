"""Derivatives of the state by parameters, as columns that run beside it; the compiled part.

Beside each part of a step go two neighbours of the motion, with the constants of theta + eps and
theta - eps, in the same contact over the same part of the step: half of their difference over eps
is the column there. Where the motion is affine between switches the neighbours start from the
state plus and minus eps times the column. Where it is not they start from the state itself, the
column moves as a tangent vector does, and the difference is added. See ``sensitivity``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.any_motion import (
    expand_any_motion,
    expand_any_tangent,
    expand_derivatives,
)
from herringbone_sim.core.packed import Array, Packed, Work, compiled, inlined
from herringbone_sim.core.series import expand_excitation, expand_motion
from herringbone_sim.core.switching import polynomial

Flags = NDArray[np.bool_]


class Near(NamedTuple):
    """Columns of a run and their neighbours; p columns."""

    packed: Packed  # every field with a leading axis (2 p,): plus, minus of each in turn
    step: Array  # (p,) eps
    excites: Flags  # (p,) whether k, e or the loads differ between the neighbours
    columns: Array  # (p, n_state), moved in place
    more: Array  # (p, n_state) what parameters alone change in a part of a step
    moved: Array  # (p, n_mesh) what they move the next switch of each mesh by, in deflection
    pair: Array  # (2, n_state) both neighbours at the end of a part
    work: Work  # scratch; the state of switches in it is that of the run


@inlined
def packed_at(a, i):
    """Row i of packed models that are stacked."""
    return Packed(
        a.classes,
        a.multiplicity[i],
        a.stiffness[i],
        a.damping[i],
        a.orders[i],
        a.k_cos[i],
        a.k_sin[i],
        a.e_mean[i],
        a.e_cos[i],
        a.e_sin[i],
        a.d_mean[i],
        a.d_cos[i],
        a.d_sin[i],
        a.windows[i],
        a.window_k[i],
        a.window_d[i],
        a.b[i],
        a.inv_M_s[i],
        a.inv_M_p[i],
        a.inv_M_c[i],
        a.load_q[i],
        a.load_r[i],
        a.control_q[i],
        a.control_r[i],
        a.control_order[i],
        a.control_phase[i],
        a.load_orders[i],
        a.load_cos[i],
        a.load_sin[i],
        a.plain[i],
        a.law[i],
        a.slide[i],
        a.own_shift[i],
        a.own_force[i],
        a.own_hold[i],
        a.seat[i],
        a.K[i],
        a.Omega[i],
    )


@inlined
def take_pair(near, m, which, s):
    """State of the neighbour's series at s into ``near.pair``."""
    w, y = near.work, near.pair[which]
    own = w.q.shape[1] - m
    for k in range(m):
        y[k] = polynomial(w.q, k, s)
        y[m + k] = polynomial(w.v, k, s)
    for j in range(own):
        y[2 * m + j] = polynomial(w.q, m + j, s)
        y[2 * m + own + j] = polynomial(w.v, m + j, s)


@inlined
def copy_excitation(run, w):
    """Series of k, e and the loads from one scratch to another."""
    for i in range(w.k.shape[0]):
        for m in range(w.k.shape[1]):
            w.k[i, m] = run.k[i, m]
            w.error[i, m] = run.error[i, m]
        for m in range(w.load.shape[1]):
            w.load[i, m] = run.load[i, m]


@compiled
def move_columns(run, near, y, phase, cycle, h, s):
    """Advance columns by s * h beside a motion that is affine, from the state y on.

    ``run`` is the scratch of the run, with the series of this step.
    """
    w = near.work
    for c in range(near.columns.shape[0]):
        eps = near.step[c]
        for which in range(2):
            p = packed_at(near.packed, 2 * c + which)
            side = eps - 2.0 * which * eps
            for k in range(y.size):
                w.stage[k] = y[k] + side * near.columns[c, k]
            if near.excites[c]:
                expand_excitation(p, w, phase, cycle, h)
            elif which == 0:
                copy_excitation(run, w)
            expand_motion(p, w, w.stage, h, w.error, w.load, 1.0)
            take_pair(near, 2 + 2 * len(p.classes), which, s)
        for k in range(y.size):
            near.columns[c, k] = (near.pair[0, k] - near.pair[1, k]) / (2.0 * eps)


@compiled
def push_columns(near, y, border, phase, cycle, h, s):
    """What the parameters alone make of a part s * h of a step from the state y on.

    Leaves it in ``near.more``, and in ``near.moved`` how far e and border go at the end of it, for
    ``jump_columns``; ``border (n_mesh,)`` tells the side on which each mesh switches.
    """
    w = near.work
    for c in range(near.columns.shape[0]):
        scale = 0.5 / near.step[c]
        for a in range(border.size):
            near.moved[c, a] = 0.0
        for which in range(2):
            p = packed_at(near.packed, 2 * c + which)
            m = 2 + 2 * len(p.classes)
            expand_excitation(p, w, phase, cycle, h)
            expand_any_motion(p, w, y, phase, h)
            take_pair(near, m, which, s)
            sign = scale - 2.0 * which * scale
            for a in range(border.size):
                level = polynomial(w.error, a, s) + border[a] * p.b[a]
                for j in range(p.seat.shape[0]):
                    level -= p.own_shift[j, a] * near.pair[which, 2 * m + j]
                near.moved[c, a] += sign * level
        for k in range(y.size):
            near.more[c, k] = (near.pair[0, k] - near.pair[1, k]) * scale


@compiled
def move_any_columns(p, w, near, derived, phase, h, s):
    """Advance columns by s * h with the series of the step just taken, and ``near.more``.

    Args:
        derived: whether tangent vectors have used ``expand_derivatives`` in this step before.
    """
    if not derived:
        expand_derivatives(p, w)
    for c in range(near.columns.shape[0]):
        expand_any_tangent(p, w, near.columns[c], phase, h, w.none_m, w.any.spring, w.any.hold)
        for k in range(near.columns.shape[1]):
            near.columns[c, k] = near.more[c, k]
        add_state(w, near.columns[c], 2 + 2 * len(p.classes), s)


@inlined
def add_state(w, y, m, s):
    """Add the state of the series at s to y."""
    own = w.q.shape[1] - m
    for k in range(m):
        y[k] += polynomial(w.q, k, s)
        y[m + k] += polynomial(w.v, k, s)
    for j in range(own):
        y[2 * m + j] += polynomial(w.q, m + j, s)
        y[2 * m + own + j] += polynomial(w.v, m + j, s)
