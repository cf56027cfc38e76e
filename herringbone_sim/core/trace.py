"""The compiled trace: states, tangent vectors and columns at samples, as they are."""

from __future__ import annotations

from typing import Any

from herringbone_sim.core.any_step import any_step
from herringbone_sim.core.packed import TWO_PI, compiled, embedded
from herringbone_sim.core.taylor import taylor_step


@embedded
def trace(step, p, w, y, tangents, near, place, steps, stride, states, all_tangents, all_columns):
    """State, tangents and columns at samples ``stride`` steps apart, as they are, into rows.

    Args:
        place: (cycle, index), moves on.
        states, all_tangents, all_columns: (n, n_state), (n, k, n_state), (n, p, n_state).
    """
    h = TWO_PI / (p.Omega * steps)
    for i in range(states.shape[0]):
        for j in range(y.size):
            states[i, j] = y[j]
            for k in range(tangents.shape[0]):
                all_tangents[i, k, j] = tangents[k, j]
            if near is not None:
                for k in range(near.columns.shape[0]):
                    all_columns[i, k, j] = near.columns[k, j]
        for _ in range(stride):
            step(p, w, y, tangents, near, TWO_PI * place[1] / steps, place[0], h)
            place[1] += 1
            if place[1] == steps:
                place[1] = 0
                place[0] += 1


@compiled
def trace_plain(p, w, y, tangents, near, place, steps, stride, states, all_tangents, all_columns):
    """``trace`` of a gear that is plain."""
    trace(
        taylor_step,
        p,
        w,
        y,
        tangents,
        near,
        place,
        steps,
        stride,
        states,
        all_tangents,
        all_columns,
    )


@compiled
def trace_any(p, w, y, tangents, near, place, steps, stride, states, all_tangents, all_columns):
    """``trace`` of any gear."""
    trace(
        any_step,
        p,
        w,
        y,
        tangents,
        near,
        place,
        steps,
        stride,
        states,
        all_tangents,
        all_columns,
    )


def tracer(plain: bool) -> Any:
    """The compiled ``trace`` for a kind of gear."""
    return trace_plain if plain else trace_any
