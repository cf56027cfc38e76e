"""Mean stiffness: k(t) multiplied by a factor.

Source: a factor on Eq. (7); Eqs. (5), (6) of the paper give k_m from the parts of a tooth pair.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import STIFFNESS, law
from herringbone_sim.effects.site import ANYWHERE
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, added_states, law):
    """Multiply k by the factor."""
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            law[STIFFNESS, m] *= theta[0]


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Multiply k by the factor."""
    slots.scale_stiffness(np.where(mask > 0.0, theta[0], 1.0))


EFFECT = Effect(
    id="mean_stiffness",
    text="mesh stiffness off by a factor",
    level="mesh",
    parameters=(Parameter("factor", "-", "k over its own value", 0.3, 3.0, 1.1, neutral=1.0),),
    loci=ANYWHERE,
    fill=fill,
    excite=excite,
)
