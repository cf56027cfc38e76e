"""Contact nonlinearity: stiffness grows with load, F = k f (|f| / f_0)^(exponent - 1) + c v.

f_0 = 10 micrometres. Source: Hertz, F ~ f^exponent with 10/9 for line and 3/2 for point contact,
instead of the linear k_h of Eq. (5).
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import PLAY, STIFFNESS, law, play
from herringbone_sim.effects.slots import Slots

F_0 = 1e-5  # m


@law
def react(theta, site, gear, now, added_states, x, v, law, force, torque):
    """Change the spring force k f to k f (|f| / f_0)^(exponent - 1)."""
    for m in range(force.size):
        f = play(x[m], law[PLAY, m])
        if site[0, m] != 0.0 and f != 0.0:
            power = np.exp((theta[0] - 1.0) * np.log(abs(f) / F_0))
            force[m] += law[STIFFNESS, m] * f * (power - 1.0)


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Change the spring force k f to k f (|f| / f_0)^(exponent - 1)."""
    slots.bend_spring(mask, theta[0], F_0)


EFFECT = Effect(
    id="contact_nonlinearity",
    text="stiffness grows with load (Hertz)",
    level="mesh",
    parameters=(Parameter("exponent", "-", "power of f", 0.7, 2.0, 1.1, neutral=1.0),),
    loci=(("all", "all", "all"), ("*", "all", "all")),
    fill=fill,
    react=react,
)
