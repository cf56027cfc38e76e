"""Matrices between body rotations u, coordinates z = (q, r) and mesh displacements x.

u [m] is the rotation of a body times its base radius, in the order of ``Layout.bodies``: suns L
and R, carrier, planets.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import Layout
from herringbone_sim.core.model import Model


def coordinates_to_meshes(layout: Layout) -> Array:
    """Return D (n_mesh, n_coordinate) of x = D z - e, with z as in ``Layout.state_names``."""
    n, c = layout.n_mesh, layout.n_classes
    D = np.zeros((n, layout.n_coordinate))
    for side in range(2):
        for planet in range(c):
            sun, ring = side * c + planet, n // 2 + side * c + planet
            D[sun, side] = 1.0
            D[sun, 2 + side * c + planet] = -1.0
            D[ring, 2 + side * c + planet] = 1.0
    return D


def bodies_to_coordinates(model: Model) -> Array:
    """Return B (n_coordinate, n_bodies) [-] of z = B u, both in m.

    z is q of both sides, then r of the planets. B r = 0 for the rigid rotation
    r = (2, 2, 1, 1, ...) of suns, carrier and planets.
    """
    layout, cos_beta = model.layout, model.scales.cos_beta
    B = np.zeros((layout.n_coordinate, len(layout.bodies)))
    B[0, 0] = B[1, 1] = cos_beta
    B[:2, 2] = -2.0 * cos_beta
    B[2:, 2] = -cos_beta
    B[2:, 3:] = cos_beta * np.eye(layout.n_coordinate - 2)
    return B


def bodies_to_meshes(model: Model) -> Array:
    """Return G = D B (n_mesh, n_bodies) of x = G u - e."""
    return np.asarray(coordinates_to_meshes(model.layout) @ bodies_to_coordinates(model))


def inverse_masses(model: Model) -> Array:
    """Return 1/M (n_bodies,) of the bodies [1/kg]: base radius^2 over inertia."""
    packed = model.packed
    return np.concatenate([packed.inv_M_s, [1.0 / model.scales.M_c], packed.inv_M_p.ravel()])


def forces_to_coordinates(model: Model) -> Array:
    """Return accelerations (n_coordinate, n_bodies) of z by unit forces on the bodies [1/kg]."""
    return np.asarray(bodies_to_coordinates(model) * inverse_masses(model))


def cycles_per_shaft_turn(model: Model) -> dict[str, float]:
    """Return mesh cycles per revolution of sun (s), carrier (c), planet (p) against the ring."""
    p = model.parameters
    return {
        "s": p.z_s * p.z_r / (p.z_s + p.z_r),
        "c": float(p.z_r),
        "p": 1.0 / abs(1.0 / p.z_p - 1.0 / p.z_r),
    }
