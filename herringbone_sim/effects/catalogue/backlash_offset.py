"""Backlash offset: half-backlash b' + offset of some meshes (wear, tooth thickness).

A positive offset gives more play. Source: Eq. (3) with another b.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import PLAY, law
from herringbone_sim.effects.site import ANYWHERE
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, added_states, law):
    """Add the offset to b', limited to zero from below."""
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            law[PLAY, m] = max(law[PLAY, m] + theta[0], 0.0)


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Add the offset to b', limited to zero from below."""
    slots.half_backlash = np.maximum(slots.half_backlash + theta[0] * mask, 0.0)


EFFECT = Effect(
    id="backlash_offset",
    text="half-backlash b' of some meshes not nominal (wear, thickness)",
    level="mesh",
    parameters=(Parameter("offset", "m", "more half-backlash", -6e-5, 2e-4, 5e-6),),
    loci=ANYWHERE,
    fill=fill,
    excite=excite,
)
