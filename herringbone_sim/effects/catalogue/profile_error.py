"""Profile error: e + cos cos(order phase) + sin sin(order phase), independent of load.

Source: one more harmonic of the transmission error, Eq. (9), which Eqs. (15), (16) subtract from
the deflection.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Effect, Option, Options, Parameter
from herringbone_sim.effects.law import FREQUENCY, PHASE, SHIFT, SHIFT_RATE, law
from herringbone_sim.effects.site import ANYWHERE, ORDER, mesh_order
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, added_states, law):
    """Add one harmonic to e: subtract it from the displacement d, and its rate from d'."""
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            angle = site[ORDER, m] * now[PHASE]
            cos, sin = np.cos(angle), np.sin(angle)
            rate = site[ORDER, m] * now[FREQUENCY]
            law[SHIFT, m] -= theta[0] * cos + theta[1] * sin
            law[SHIFT_RATE, m] -= rate * (theta[1] * cos - theta[0] * sin)


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Add one harmonic to e: subtract it from the displacement d."""
    slots.add_displacement(float(options["order"]), -theta[0] * mask, -theta[1] * mask)


EFFECT = Effect(
    id="profile_error",
    text="transmission error of mesh order, independent of load",
    level="mesh",
    parameters=(
        Parameter("cos", "m", "cosine amplitude in e", -1e-4, 1e-4, 3e-6),
        Parameter("sin", "m", "sine amplitude in e", -1e-4, 1e-4, 3e-6),
    ),
    options=(Option("order", "of the mesh frequency", 2, tuple(range(1, 9))),),
    loci=ANYWHERE,
    place=mesh_order,
    fill=fill,
    excite=excite,
)
