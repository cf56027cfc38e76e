"""The nominal gear inside its tolerance, with effects, laid out for the filter.

A state is z (coordinates over b_c), its rates over b_c omega_n, the effects' own states, then the
rigid rotation over b_c and its rate, which forces in the meshes don't move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model, build
from herringbone_sim.core.packed import Packed
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import Laws, Scratch, gear_table, laws, scratch
from herringbone_sim.gap.data.geometry import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Stage(NamedTuple):
    """Scratch of an integration; n = n_mesh, s = size of the state."""

    x: Array  # (n,) deflection [m]
    v: Array  # (n,) its rate [m/s]
    scaled: Array  # (n,) mesh forces, dimensionless
    stage: Array  # (s,)
    rate: Array  # (4, s)
    projection: float


@dataclass(frozen=True)
class Gear:
    """All that the compiled filter asks of a gear at an operating point.

    Attributes:
        laws, table, packed: effects, meshes, bodies.
        si: units, see ``effects.run.at_instant``.
        push: (n_bodies + 1,) of the rigid rotation, see ``filter_kernel``.
        now: (5,) phase, mesh frequency [rad/s], delta_T [K], T_1 [N m], K.
        w, g: scratch.
        H: (k, size) what the channels that are there see of a state [SI].
        to: (size,) state of the filter whose gain a state takes; -1 for effects' own states.
        start: (size,) a state with the rigid rotation that the control forces.
    """

    laws: Laws
    table: Array
    packed: Packed
    si: Array
    push: Array
    now: Array
    w: Scratch
    g: Stage
    H: Array
    to: Index
    start: Array


def reduced(model: Model) -> Model:
    """The same gear with identical planets."""
    return build(model.parameters.changed({"model": "reduced"}))


def gear_of(
    run: PreparedRun,
    model: Model,
    factors: Array,
    inverse: Array,
    actives: Sequence[Active] = (),
) -> Gear:
    """A gear with calibration and effects.

    Args:
        run: whose operating point and channels count.
        model: full, or reduced where planets can't be told apart.
        factors: (6,) of the law, ``recalibrate.NAMES``; inverse (3,) on 1/M_s, 1/M_p, 1/M_c.
    """
    found = laws(model, actives)
    layout, s = model.layout, model.scales
    size = layout.n_state + found.n_own + 2
    n, m = layout.n_mesh, layout.n_coordinate
    force = s.b_c * s.omega_n**2 / s.projection
    p = packed(model, inverse)._replace(Omega=run.omega_rad_per_s / s.omega_n)
    M = masses(model, inverse)
    rigid = rigid_rotation(model)
    inertia = float(rigid**2 @ M)
    wave = p.K * s.M_c / s.cos_beta / inertia * np.where(p.control_order == 1.0, 1.0, 0.0)
    x, v, scaled = np.zeros((3, n))
    start = np.zeros(size)
    start[-2:] = (
        wave / p.Omega**2 * np.array([-np.cos(run.phase[0]), p.Omega * np.sin(run.phase[0])])
    )
    to = np.full(size, -1)
    to[: 2 * m] = filter_index(layout.n_classes)
    to[-2:] = (8, 9)
    P = model.parameters
    return Gear(
        laws=found,
        table=calibrated(gear_table(model), factors),
        packed=p,
        si=np.array([s.b_c, s.velocity_m_per_s, force, s.b_c / s.cos_beta, s.omega_n]),
        push=np.append(rigid / (inertia * s.b_c * s.omega_n**2), wave),
        now=np.array([0.0, run.omega_rad_per_s, P.delta_T, P.T_1, P.K]),
        w=scratch(model, found.n_own),
        g=Stage(x, v, scaled, np.zeros(size), np.zeros((4, size)), s.projection),
        H=observation(run, model, M, size),
        to=to,
        start=start,
    )


def filter_index(classes: int) -> Index:
    """State of the reduced gear that each coordinate and rate (2 m,) of a gear stands for."""
    one = np.concatenate([[0, 1], np.repeat([2, 3], classes)])
    return np.concatenate([one, one + 4])


def rigid_rotation(model: Model) -> Array:
    """Displacements (n_bodies,) that leave every mesh alone; planets once for each they stand."""
    rigid = np.ones(len(model.layout.bodies))
    rigid[:2] = 2.0
    return rigid


def masses(model: Model, inverse: Array) -> Array:
    """M (n_bodies,) [kg]: of planets, all that a class stands for."""
    packed, s = model.packed, model.scales
    planets = packed.multiplicity / packed.inv_M_p.ravel() / inverse[1]
    suns = 1.0 / packed.inv_M_s / inverse[0]
    return np.concatenate([suns, [s.M_c / inverse[2]], planets])


def packed(model: Model, inverse: Array) -> Packed:
    """The kernel's model with factors (3,) on 1/M_s, 1/M_p, 1/M_c."""
    p = model.packed
    output = p.load_r
    sun, planet, carrier = inverse
    return p._replace(
        inv_M_s=p.inv_M_s * sun,
        inv_M_p=p.inv_M_p * planet,
        inv_M_c=p.inv_M_c * carrier,
        load_q=(p.load_q - 2.0 * output) * sun + 2.0 * output * carrier,
        load_r=output * carrier,
        control_q=p.control_q * carrier,
        control_r=p.control_r * carrier,
    )


def calibrated(table: Array, factors: Array) -> Array:
    """``effects.gear.gear_table`` with the factors on k, c and e."""
    table = table.copy()
    k, c, e = (np.repeat(factors[i : i + 2], table.shape[1] // 2) for i in (0, 2, 4))
    table[0] *= k
    table[1] *= c
    table[3] *= e
    for row in range(4, len(table)):
        table[row] *= k if (row - 4) % 4 < 2 else e
    return table


def observation(run: PreparedRun, model: Model, M: Array, size: int) -> Array:
    """H (k, size): x + e, v + de/dt and u of the channels that are there, of a state.

    Channels of the full gear; a reduced model gives all planets the same.
    """
    s, layout = model.scales, model.layout
    m = layout.n_coordinate
    D = coordinates_to_meshes(run.model.layout)
    expand = np.zeros((run.model.layout.n_coordinate, m))
    if m == len(expand):
        expand = np.eye(m)
    else:
        expand[np.arange(len(expand)), filter_index(run.model.layout.n_classes)[: len(expand)]] = 1
    x, v, u = (np.zeros((len(there), size)) for there in (run.x.there, run.v.there, run.u.there))
    x[:, :m] = s.b_c * D @ expand
    v[:, m : 2 * m] = s.velocity_m_per_s * D @ expand
    # z = B u, and no momentum but that of the rigid rotation.
    whole = np.vstack([bodies_to_coordinates(model), rigid_rotation(model) * M])
    bodies = s.b_c * np.linalg.inv(whole)[:, :m]
    planets = np.concatenate([np.arange(3), 3 + filter_index_of_planets(run.model, model)])
    u[:, :m] = bodies[planets]
    u[:, -2] = s.b_c * rigid_rotation(model)[planets]
    H: Array = np.vstack([x[run.x.there], v[run.v.there], u[run.u.there]])
    return H


def filter_index_of_planets(full: Model, model: Model) -> Index:
    """Planet half of a model that stands for each of the full one."""
    c = full.layout.n_classes
    if model.layout.n_classes == c:
        return np.arange(2 * c)
    return np.repeat([0, 1], c)


def seen(run: PreparedRun) -> tuple[Array, Array]:
    """Channels x + e, v + de/dt, u that are there (n, k), and the variance of their noise (k,)."""
    x, v, u = run.x, run.v, run.u
    values = np.hstack(
        [
            (x.values + run.waves.e)[:, x.there],
            (v.values + run.waves.e_rate)[:, v.there],
            u.values[:, u.there],
        ]
    )
    sigma = np.concatenate([x.sigma[x.there], v.sigma[v.there], u.sigma[u.there]])
    return np.ascontiguousarray(values), sigma**2
