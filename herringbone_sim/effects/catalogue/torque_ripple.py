"""Torque ripple: the input torque is T_1 [1 + amplitude cos(order angle + phase)].

The angle is that of the input shaft to ground: a revolution takes z_s z_r / (z_s + z_r) mesh
cycles, 19.99 for the nominal rig. Half of the torque acts on each side of the sun. Source: T_1 of
Eq. (12), not constant.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Effect, Option, Options, Parameter
from herringbone_sim.effects.law import PHASE, TORQUE, law
from herringbone_sim.effects.slots import Slots

ORDER, SHAFT_CYCLES, RADIUS = range(1, 4)


def place(model: Model, mask: Array, options: Options) -> Array:
    """Return ``site``, rows (4, n_mesh).

    Mask; order; mesh cycles per revolution of the input shaft; base radius of the sun [m].
    """
    p = model.parameters
    ones = np.ones(mask.shape)
    turn = p.z_s * p.z_r / (p.z_s + p.z_r)
    return np.stack([mask, options["order"] * ones, turn * ones, model.scales.r_bs * ones])


@law
def react(theta, site, gear, now, added_states, x, v, law, force, torque):
    """Add the ripple to the torque on both halves of the sun."""
    angle = site[ORDER, 0] * now[PHASE] / site[SHAFT_CYCLES, 0] + theta[1]
    more = 0.5 * now[TORQUE] / site[RADIUS, 0] * theta[0] * np.cos(angle)
    torque[0] += more
    torque[1] += more


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Add the ripple to the torque on both halves of the sun.

    Args:
        slots: changed in place.
        theta: amplitude as a share of T_1, and phase [rad].
        mask: not used, as the ripple acts on the whole sun.
        options: ``order``, periods per revolution of the input shaft.
    """
    p, s = slots.model.parameters, slots.model.scales
    order = options["order"] * (p.z_s + p.z_r) / (p.z_s * p.z_r)
    push = np.zeros(len(slots.model.layout.bodies))
    push[:2] = 0.5 * p.T_1 / s.r_bs * theta[0]
    slots.add_torque(order, push * np.cos(theta[1]), -push * np.sin(theta[1]))


EFFECT = Effect(
    id="torque_ripple",
    text="input torque not constant",
    level="body",
    divisible=False,
    parameters=(
        Parameter("amplitude", "-", "share of T_1", 0.0, 2.0, 0.1),
        Parameter("phase", "rad", "at phase 0", -3.1416, 3.1416, 0.0, neutral=None),
    ),
    options=(Option("order", "events a turn of the input shaft", 1, tuple(range(1, 61))),),
    place=place,
    fill=fill,
    react=react,
)
