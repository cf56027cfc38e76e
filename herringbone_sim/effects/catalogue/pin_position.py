"""Pin position: one planet's pin is displaced, e + offset on its sun and its ring meshes.

Source: a pin that lies w ahead in the direction of the carrier's motion reduces the deflection of
all four meshes in Eqs. (15) and (16) by w cos beta, as a mean error e of Eq. (9) does.
"""

from __future__ import annotations

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import SHIFT, law
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, added_states, law):
    """Add the offset to e, that is -offset to d."""
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            law[SHIFT, m] -= theta[0]


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Add the offset to e, that is -offset to d."""
    slots.displacement = slots.displacement - theta[0] * mask


EFFECT = Effect(
    id="pin_position",
    text="one planet's pin off its place: constant displacement on its sun and ring meshes",
    level="mesh",
    parameters=(Parameter("offset", "m", "added to e", -2e-4, 2e-4, 1e-5),),
    loci=(("all", "*", "all"),),
    fill=fill,
    excite=excite,
)
