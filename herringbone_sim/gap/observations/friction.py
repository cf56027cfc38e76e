"""Friction of the teeth: its shapes over the mesh cycle, and how it acts on the bodies."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.effects.catalogue.tooth_friction import friction_arms
from herringbone_sim.gap.observations.body_motion import rigid_mode

# Knots [mesh cycles] about the nominal pitch point and about the change of teeth half a cycle from
# it, where sliding reverses too, chosen: the actual ones may lie a tenth of a cycle off, and
# friction rises or fades near them.
REVERSAL_KNOTS = np.array([-0.12, -0.06, 0.0, 0.06, 0.12])
NEAR = tuple(f"near {i}" for i in range(2 * len(REVERSAL_KNOTS)))
ELASTIC = "elastic"  # part of friction by which it follows the spring force instead of all of F
LOAD = "load"  # what the load is smaller by, as the rotation is steady
OF_COULOMB = ("sign", "lever", LOAD)
# Shapes of friction over the mesh cycle: direction of sliding, lever arm, load, free departures.
FRICTION = (*OF_COULOMB, "sin 1", "sin 2", "cos 1", "cos 2", *NEAR, ELASTIC)


def friction_of_mesh(
    shape: str, shapes: Mapping[str, Array], force: Array, spring_force: Array
) -> Array:
    """Friction (n,) [N] of one mesh by a shape of ``FRICTION``, at a coefficient of 1.

    Args:
        shapes: see ``friction_shapes``.
        force: (n,) normal force [N].
        spring_force: (n,) part of it by the spring [N]; where NaN, it counts as all of it.
    """
    if shape == ELASTIC:
        elastic = np.abs(np.where(np.isnan(spring_force), force, spring_force))
        return np.asarray((elastic - np.abs(force)) * shapes["sign"])
    if shape == LOAD:
        return np.full(len(force), -np.mean(np.abs(force) * shapes["lever"]))
    return np.asarray(np.abs(force) * shapes[shape])


def friction_directions(model: Model, mask: Array) -> dict[str, Array]:
    """Forces (n_mesh, n_bodies) on the bodies by unit ``friction_of_mesh``, of ``OF_COULOMB``.

    Departures act as the sign does. Friction by the lever arm does work on the rigid rotation of
    the gear, that at the pitch point does none; a constant force on the carrier makes up for it.

    Args:
        mask: (n_mesh,) 1 on meshes with friction, else 0.
    """
    sign, lever = friction_arms(model, mask)
    load = np.zeros_like(lever)
    load[:, model.layout.bodies.index("c")] = lever @ rigid_mode(model)
    return {"sign": sign, "lever": lever, LOAD: load}


def friction_shapes(phase: Array, reversal_rad: float = 0.0) -> dict[str, Array]:
    """Shapes of ``FRICTION`` over the mesh phase (n,) [rad], pitch point at 0: all but two.

    ``ELASTIC`` and ``LOAD`` depend on the force, see ``friction_of_mesh``.

    Departures are orthogonal to the sign over a mesh cycle, so that its amplitude, the coefficient
    of friction, is that of the whole curve.

    Args:
        reversal_rad: half the phase over which sliding reverses, for integrators that would step
            over a jump; 0: none.
    """
    s = phase / (2.0 * np.pi)
    s = s - np.floor(s + 0.5)
    from_reversal = 2.0 * np.pi * np.minimum(np.abs(s), 0.5 - np.abs(s))
    sign = np.sign(s) * (np.minimum(from_reversal / reversal_rad, 1.0) if reversal_rad else 1.0)
    # Mean over a cycle of the product of hat functions and sign.
    beside = (np.sign(REVERSAL_KNOTS) * (REVERSAL_KNOTS[1] - REVERSAL_KNOTS[0]))[:, None] * sign
    near = [*(_tents(s) - beside), *(_tents(np.where(s < 0.0, s + 0.5, s - 0.5)) + beside)]
    return {
        "sign": sign,
        "lever": np.abs(s),
        "sin 1": np.sin(phase) - 2.0 / np.pi * sign,
        "sin 2": np.sin(2 * phase),
        "cos 1": np.cos(phase),
        "cos 2": np.cos(2 * phase),
        **dict(zip(NEAR, near, strict=True)),
    }


def _tents(s: Array) -> Array:
    """Hat functions (knots, n) over ``REVERSAL_KNOTS`` at s (n,) mesh cycles from a reversal."""
    width = REVERSAL_KNOTS[1] - REVERSAL_KNOTS[0]
    tents: Array = np.maximum(1.0 - np.abs(s - REVERSAL_KNOTS[:, None]) / width, 0.0)
    return tents
