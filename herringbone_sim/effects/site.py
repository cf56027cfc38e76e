"""Mesh constants (rows of ``site``) for events once a revolution, and parts shared by effects."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import KINDS, Layout
from herringbone_sim.core.model import Model, mesh_phases
from herringbone_sim.effects.effect import Option, Options, Parameter
from herringbone_sim.errors import ParameterError

ANYWHERE = (
    *(("all", "all", "all"), ("*", "all", "all"), ("all", "*", "all"), ("all", "all", "*")),
    *(("*", "*", "all"), ("*", "all", "*"), ("all", "*", "*"), ("*", "*", "*")),
)
CURVATURE = Parameter(
    "curvature",
    "-",
    "share by which T exceeds delta_T at 100 K",
    low=-2.0,
    high=2.0,
    start=0.0,
    neutral=None,
    bends=True,
)
ORDER = 1  # row of ``mesh_order``
MEMBER = Option("member", "the gear that carries it", "sun", ("sun", "planet", "ring"))


def mesh_order(model: Model, mask: Array, options: Options) -> Array:
    """Return ``site``, rows (2, n_mesh): mask, order of a harmonic (``options["order"]``)."""
    return np.stack([mask, np.full(mask.shape, float(options["order"]))])


def planet_angles(model: Model) -> Array:
    """Return the angle [rad] (n_mesh,) on the carrier of the planet of each mesh.

    Zeros in the reduced model, which does not distinguish planets.
    """
    p = model.parameters
    if not model.layout.numbered:
        return np.zeros(model.layout.n_mesh)
    equal = 360.0 * np.arange(p.n_planets) / p.n_planets
    psi = np.radians(np.array(p.planet_angle) if p.planet_angle else equal)
    return np.tile(psi, 4)


def is_ring(layout: Layout) -> Array:
    """Return an array (n_mesh,): 1 on ring-planet meshes, 0 on sun-planet meshes."""
    return np.repeat(np.arange(len(KINDS), dtype=float), layout.n_mesh // 2)


def revolutions(model: Model, mask: Array, options: Options) -> Array:
    """Return when a tooth of a gear member passes each mesh.

    A tooth of the sun meets the planets in the order of their angles, a tooth of the ring in the
    opposite order; a tooth of a planet meets the ring half a revolution after the sun. The gear
    member is ``options["member"]``.

    Returns:
        Rows (3, n_mesh): mask; mesh cycles per revolution of the member relative to the carrier;
        delay in mesh cycles.

    Raises:
        ParameterError: the mask has meshes that the member is not part of.
    """
    member = options["member"]
    ring = is_ring(model.layout)
    p = model.parameters
    psi = planet_angles(model) / (2.0 * np.pi)
    if np.any(mask * {"sun": ring, "planet": 0.0 * ring, "ring": 1.0 - ring}[member]):
        raise ParameterError(
            f"meshes of a {member} are meant, the locus has others: set its mesh to "
            f"{'sp' if member == 'sun' else 'rp'}"
        )
    cycles = {"sun": p.z_s, "planet": p.z_p, "ring": p.z_r}[member]
    late = {"sun": psi, "planet": 0.5 * ring, "ring": -psi}[member]
    return np.stack([mask, np.full(mask.shape, float(cycles)), cycles * late])


def whole_cycles(model: Model, mask: Array, options: Options) -> Array:
    """Return ``revolutions`` for a single tooth, its delay in whole cycles of each mesh's k(t).

    A tooth enters every mesh at the same phase of that mesh, see ``core.model.mesh_phases``.
    """
    rows = revolutions(model, mask, options)
    ahead = mesh_phases(model.parameters) / (2.0 * np.pi)
    rows[2] = np.rint(rows[2] + ahead) - ahead
    return rows
