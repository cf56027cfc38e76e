"""Ring flexibility: each half of the ring rotates on a spring; rigid at infinite stiffness.

M_r u'' = cos beta sum F_rp - k u - c u', with M_r = I_r / r_br^2 and c = 2 damping sqrt(k M_r);
the ring meshes of that side get the displacement d = -u cos beta. Source: Eq. (13) for a ring that
is not fixed, as in lumped models of planetary gears (Lin and Parker 1999).
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import SHIFT, SHIFT_RATE, law
from herringbone_sim.effects.slots import Coordinates, Slots

MASS, COS_BETA, MULTIPLICITY = range(1, 4)


def place(model: Model, mask: Array, options: Options) -> Array:
    """Return ``site``, rows (4, n_mesh): mask, M_r [kg], cos beta, planets a mesh represents."""
    ones = np.ones(mask.shape)
    s = model.scales
    return np.stack([mask, s.M_r * ones, s.cos_beta * ones, model.packed.multiplicity * ones])


@law
def excite(theta, site, gear, now, added_states, law):
    """Add the displacement d = -u cos beta and its rate on the ring meshes of each side."""
    half = law.shape[1] // 2
    if not np.isinf(theta[0]):
        for m in range(half, law.shape[1]):
            if site[0, m] != 0.0:
                side = (m - half) // (half // 2)
                law[SHIFT, m] -= site[COS_BETA, m] * added_states[2 * side]
                law[SHIFT_RATE, m] -= site[COS_BETA, m] * added_states[2 * side + 1]


@law
def drive(theta, site, gear, now, added_states, force, slope):
    """Write u' and u'' of the left and the right half of the ring."""
    half = force.size // 2
    slope[:] = 0.0
    if not np.isinf(theta[0]):
        mass = site[MASS, 0]
        damping = 2.0 * theta[1] * np.sqrt(theta[0] * mass)
        for side in range(2):
            u, rate = added_states[2 * side], added_states[2 * side + 1]
            load = -theta[0] * u - damping * rate
            for m in range(half + side * (half // 2), half + (side + 1) * (half // 2)):
                load += site[0, m] * site[MULTIPLICITY, m] * site[COS_BETA, m] * force[m]
            slope[2 * side] = rate
            slope[2 * side + 1] = load / mass


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Add u of each ring half with a mesh in the mask as a coordinate."""
    if np.isinf(theta[0]):
        return
    model = slots.model
    M_r, cos_beta = model.scales.M_r, model.scales.cos_beta
    ring = np.concatenate([0.0 * mask[: mask.size // 2], mask[mask.size // 2 :]])
    side = np.arange(mask.size) // (mask.size // 4) % 2
    here = np.array([ring * (side == half) for half in range(2)])
    here = here[here.any(axis=1)]
    s, bodies = len(here), len(model.layout.bodies)
    damping = 2.0 * theta[1] * np.sqrt(theta[0] * M_r)
    slots.add_coordinates(
        Coordinates(
            shift=-cos_beta * here,
            seat=np.tile([theta[0], damping, 0.0, 0.0], (s, 1)),
            force=model.bare.multiplicity * cos_beta / M_r * here,
            hold=-np.eye(s) / M_r,
            load=np.zeros(s),
            control=np.zeros(s),
            body_force=np.zeros((mask.size, bodies)),
            body_hold=np.zeros((s, bodies)),
            body_load=np.zeros(bodies),
            body_control=np.zeros(bodies),
        )
    )


EFFECT = Effect(
    id="ring_flexibility",
    text="the ring turns on its own spring",
    level="mesh",
    parameters=(
        Parameter("stiffness", "N/m", "of its spring", 1e7, 1e12, 3e9, neutral=np.inf),
        Parameter("damping", "-", "damping ratio", 0.0, 1.0, 0.05, neutral=None),
    ),
    loci=(("rp", "all", "all"), ("rp", "all", "*")),
    place=place,
    fill=fill,
    excite=excite,
    drive=drive,
    states=lambda model: 4,
)
