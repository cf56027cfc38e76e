"""Left-right symmetry of states and gears, and equality of planets."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.lanes.packed import added_mirror, integrated_added
from herringbone_sim.core.layout import Layout
from herringbone_sim.core.model import Model


def layout_mirror(layout: Layout) -> Indices:
    """Return the indices (n_state,) that exchange left and right in a state of a layout."""
    m = layout.n_coordinate
    half = np.concatenate([[1, 0], np.roll(np.arange(2, m), layout.n_classes)])
    return np.concatenate([half, m + half])


def state_mirror(model: Model) -> Indices:
    """Return the indices that exchange left and right in a state with coordinates of effects."""
    first, added = model.layout.n_state, added_mirror(model)
    return np.concatenate(
        [layout_mirror(model.layout), first + added, first + model.n_added_coordinates + added]
    )


def has_equal_halves(model: Model) -> bool:
    """Whether the left and right halves of a gear, effects included, are bitwise equal.

    False for a gear that is integrated by the laws of its effects, which can't be compared.
    """
    p, c = model.packed, model.layout.n_classes
    n, m, added = model.layout.n_mesh, model.layout.n_coordinate, added_mirror(model)
    by_mesh = _of_meshes(model)
    by_side = (p.inv_M_s, p.inv_M_p, p.load_q, p.control_q, p.control_r)
    loads = np.concatenate([p.load_cos, p.load_sin])
    mesh = np.arange(n).reshape(2, 2, c)[:, ::-1].ravel()
    mirror = np.concatenate([layout_mirror(model.layout)[:m], m + added])
    to = np.concatenate([mirror, [m + len(added)]])
    return (
        model.integrator is None
        and np.array_equal(added[added], np.arange(len(added)))
        and np.array_equal(p.seat[added], p.seat)
        and np.array_equal(p.added_shift[added][:, mesh], p.added_shift)
        and np.array_equal(p.push[:, to][:, :, np.concatenate([mesh, n + added])], p.push)
        and np.array_equal(by_mesh[:, :, 0], by_mesh[:, :, 1])
        and all(np.array_equal(row[0], row[1]) for row in by_side)
        and np.array_equal(loads, loads[:, mirror])
    )


def has_equal_planets(model: Model) -> bool:
    """Whether the planets of a gear without effects are bitwise equal, mesh phases included."""
    inertia = model.packed.inv_M_p
    return all(bool(np.all(a == a[..., :1])) for a in (_of_meshes(model), inertia))


def _of_meshes(model: Model) -> Array:
    """Stack the constants of ``packed`` that each mesh has: (rows, kind, side, planet)."""
    p = model.packed
    single = (p.stiffness, p.damping, p.b, p.e_mean, p.d_mean)
    many = (p.k_cos, p.k_sin, p.e_cos, p.e_sin, p.d_cos, p.d_sin, p.event_k, p.event_d, p.law)
    return np.concatenate([np.array(single), *many]).reshape(-1, 2, 2, model.layout.n_classes)


def left_half(model: Model) -> Indices:
    """Return the indices of the left half in a state.

    Coordinates of effects that are their own mirror image belong to it.
    """
    m, c, added = model.layout.n_coordinate, model.layout.n_classes, integrated_added(model, 1)
    half = np.concatenate([[0], np.arange(2, 2 + c)])
    return np.concatenate(
        [half, m + half, 2 * m + added, 2 * m + model.n_added_coordinates + added]
    )


def from_left_half(model: Model) -> Indices:
    """Return the indices that make a whole symmetric state of its left half (``left_half``)."""
    c, added = model.layout.n_classes, integrated_added(model, 1)
    half = np.concatenate([[0, 0], np.tile(np.arange(1, 1 + c), 2)])
    image = np.minimum(added_mirror(model), np.arange(model.n_added_coordinates))
    rest = 2 * (1 + c) + np.searchsorted(added, image)
    return np.concatenate([half, 1 + c + half, rest, len(added) + rest])


def self_mirrored(model: Model) -> Indices:
    """Return where in a left half coordinates are that are their own mirror image.

    These are displacements and rates; an antisymmetric perturbation leaves them at rest.
    """
    added, first = integrated_added(model, 1), 2 * (1 + model.layout.n_classes)
    alone = np.flatnonzero(added_mirror(model)[added] == added)
    return np.concatenate([first + alone, first + len(added) + alone])
