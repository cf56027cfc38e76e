"""Tooth spall: e + height w(s) while one tooth is in mesh, independent of the load.

w is a raised cosine of the mesh cycles s from the event, which recurs once a revolution of its
member relative to the carrier, as for a crack. A pit, where the flank recedes, has a positive
height, a bump a negative one. Source: a local fault as part of e(t), which Eqs. (15), (16)
subtract from the deflection.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import (
    FREQUENCY,
    SHIFT,
    SHIFT_RATE,
    bump,
    bump_slope,
    cycles_from_event,
    law,
)
from herringbone_sim.effects.site import MEMBER, whole_cycles
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, added_states, law):
    """Add the event to e: subtract it from the displacement d, and its rate from d'."""
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            s = cycles_from_event(now, site[1, m], site[2, m], theta[1])
            rate = now[FREQUENCY] / TWO_PI
            law[SHIFT, m] -= theta[0] * bump(s, theta[2])
            law[SHIFT_RATE, m] -= theta[0] * bump_slope(s, theta[2]) * rate


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Add the event to e: subtract it from the displacement d."""
    _, cycles, late = whole_cycles(slots.model, mask, options)
    none = np.zeros(mask.shape)
    slots.add_event(cycles, late + theta[1], theta[2], none, -theta[0] * mask)


EFFECT = Effect(
    id="tooth_spall",
    text="displacement event while one tooth is in mesh, whatever the load",
    level="mesh",
    parameters=(
        Parameter("height", "m", "depth of the pit, the largest e", -2e-4, 2e-4, 1e-5),
        Parameter("position", "cycles", "mesh cycle of the event", 0.0, 77.0, 0.0, neutral=None),
        Parameter("width", "cycles", "mesh cycles from onset to end", 0.2, 4.0, 1.0, neutral=None),
    ),
    options=(MEMBER,),
    loci=(("*", "*", "*"), ("*", "all", "*"), ("all", "*", "*")),
    place=whole_cycles,
    fill=fill,
    excite=excite,
)
