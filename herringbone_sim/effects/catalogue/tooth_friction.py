"""Tooth friction: mu |F| along the flanks against the sliding, which reverses at the pitch point.

The contact is at s = p_b wrap(phase) / 2 pi from the pitch point on the line of action, p_b the
base pitch. With g = mu |F| cos beta sign(s), the torques over base radius are:
sun mesh: -g (tan alpha_t + s / r_bs) on the sun, g (tan alpha_t - s / r_bp) on the planet,
g tan alpha_t on the carrier;
ring mesh: -g (tan alpha_t + s / r_bp) on the planet, g tan alpha_t (r_br - r_bp) / r_bc on the
carrier. Their power, -g |s| times the rolling speed, is never positive. The normal force does not
contain the friction. Source: Coulomb's law with the lever arms of involute flanks, for example
Vaishya and Singh (J. Sound Vib. 248, 671, 2001).
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import PHASE, law
from herringbone_sim.effects.site import is_ring
from herringbone_sim.effects.slots import Slots

TAN, DRIVER_ARM, DRIVEN_ARM, CARRIER_ARM, COS_BETA, MULTIPLICITY = range(1, 7)


def place(model: Model, mask: Array, options: Options) -> Array:
    """Return ``site``, rows (7, n_mesh).

    Mask; tan alpha_t; p_b over the base radius of the driving and of the driven gear; lever arm on
    the carrier; cos beta; number of planets that a mesh represents.
    """
    p, s = model.parameters, model.scales
    ring = is_ring(model.layout)
    tan = np.tan(np.radians(p.alpha_n)) / s.cos_beta
    pitch = TWO_PI * s.r_bs / p.z_s
    ones = np.ones(mask.shape)
    return np.stack(
        [
            mask,
            tan * ones,
            pitch / np.where(ring > 0.0, s.r_bp, s.r_bs),
            pitch / np.where(ring > 0.0, s.r_br, s.r_bp),
            tan * np.where(ring > 0.0, (s.r_br - s.r_bp) / s.r_bc, 1.0),
            s.cos_beta * ones,
            model.packed.multiplicity * ones,
        ]
    )


@law
def react(theta, site, gear, now, added_states, x, v, law, force, torque):
    """Add the friction torques of each mesh to its bodies; the normal force does not change."""
    turn = now[PHASE] / TWO_PI
    s = turn - np.floor(turn + 0.5)
    half = force.size // 2
    planets = half // 2
    for m in range(force.size):
        if site[0, m] != 0.0 and s != 0.0:
            g = theta[0] * abs(force[m]) * site[COS_BETA, m] * np.sign(s)
            driver = -g * (site[TAN, m] + s * site[DRIVER_ARM, m])
            driven = g * (site[TAN, m] - s * site[DRIVEN_ARM, m])
            if m < half:
                torque[m // planets] += site[MULTIPLICITY, m] * driver
                torque[3 + m] += driven
            else:
                torque[3 + m - half] += driver
            torque[2] += site[MULTIPLICITY, m] * g * site[CARRIER_ARM, m]


def friction_arms(model: Model, mask: Array) -> tuple[Array, Array]:
    """Return friction torques over base radius (n_mesh, n_bodies) per |F| of each mesh at mu = 1.

    Returns:
        constant: the part that is multiplied by sign(s), s in mesh cycles from the pitch point.
        lever: the part that is multiplied by |s|.
    """
    rows = place(model, mask, {})
    half, planets = mask.size // 2, mask.size // 4
    constant, lever = np.zeros((2, mask.size, len(model.layout.bodies)))
    for m in np.flatnonzero(mask):
        g = rows[COS_BETA, m]
        driver = m // planets if m < half else 3 + m - half
        multiplicity = rows[MULTIPLICITY, m] if m < half else 1.0
        constant[m, driver] -= multiplicity * g * rows[TAN, m]
        lever[m, driver] -= multiplicity * g * rows[DRIVER_ARM, m]
        if m < half:
            constant[m, 3 + m] += g * rows[TAN, m]
            lever[m, 3 + m] -= g * rows[DRIVEN_ARM, m]
        constant[m, 2] += rows[MULTIPLICITY, m] * g * rows[CARRIER_ARM, m]
    return constant, lever


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Add the friction torques; the normal force does not change."""
    constant, lever = friction_arms(slots.model, mask)
    slots.add_friction(theta[0] * constant, theta[0] * lever)


EFFECT = Effect(
    id="tooth_friction",
    text="sliding friction, sign change at the pitch point",
    level="body",
    parameters=(Parameter("mu", "-", "friction coefficient", 0.0, 0.5, 0.05),),
    loci=(("all", "all", "all"), ("*", "all", "all")),
    place=place,
    fill=fill,
    react=react,
)
