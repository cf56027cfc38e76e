"""Damping law: c v becomes c v [1 - share + share s], with s = (|f| / depth)^power.

Power 0 is damping in contact only (s = 1 in contact, 0 out of it), power 1 damping in proportion
to the spring's load (Hunt and Crossley 1975). Source: Eq. (12) with another c.
"""

from __future__ import annotations

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import DAMPING, PLAY, law, play
from herringbone_sim.effects.slots import Slots


@law
def react(theta, site, gear, now, added_states, x, v, law, force, torque):
    """Multiply c v by 1 - share + share s."""
    for m in range(force.size):
        if site[0, m] != 0.0:
            f = abs(play(x[m], law[PLAY, m]))
            s = (f / theta[2]) ** theta[1] if f > 0.0 else 0.0
            force[m] += theta[0] * law[DAMPING, m] * v[m] * (s - 1.0)


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Multiply c v by 1 - share + share s."""
    slots.bend_damping(mask, *theta)


EFFECT = Effect(
    id="damping_law",
    text="damping not c v everywhere (only in contact, or proportional to load)",
    level="mesh",
    parameters=(
        Parameter("share", "-", "of c v that follows the other law", 0.0, 1.0, 0.3),
        Parameter("power", "-", "0: in contact only; 1: by load", 0.0, 1.5, 0.5, None),
        Parameter("depth", "m", "f at which it is c v", 1e-6, 1e-4, 1e-5, None),
    ),
    loci=(("all", "all", "all"), ("*", "all", "all")),
    fill=fill,
    react=react,
)
