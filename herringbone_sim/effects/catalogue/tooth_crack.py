"""Tooth crack: k, with all other effects, drops while one tooth is in mesh, k (1 - depth w(s)).

w is a raised cosine of the mesh cycles s from the event, which recurs once a revolution of its
member relative to the carrier: every 27, 25 or 77 mesh cycles for sun, planet, ring of the nominal
rig. Source: the usual reduction of mesh stiffness by a crack, see Eq. (5) with k_b and k_s of one
tooth lowered.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import STIFFNESS, bump, cycles_from_event, law
from herringbone_sim.effects.site import MEMBER, whole_cycles
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, added_states, law):
    """Reduce k while the tooth is in mesh."""
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            s = cycles_from_event(now, site[1, m], site[2, m], theta[1])
            law[STIFFNESS, m] *= 1.0 - theta[0] * bump(s, theta[2])


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Reduce k while the tooth is in mesh."""
    _, cycles, late = whole_cycles(slots.model, mask, options)
    none = np.zeros(mask.shape)
    slots.add_event(cycles, late + theta[1], theta[2], theta[0] * mask, none)


EFFECT = Effect(
    id="tooth_crack",
    text="stiffness drop while one tooth is in mesh, proportional to load",
    level="mesh",
    parameters=(
        Parameter("depth", "-", "largest share of k that is lost", 0.0, 0.95, 0.2),
        Parameter("position", "cycles", "mesh cycle of the event", 0.0, 77.0, 0.0, neutral=None),
        Parameter("width", "cycles", "mesh cycles from onset to end", 0.2, 4.0, 1.5, neutral=None),
    ),
    options=(MEMBER,),
    loci=(("*", "*", "*"), ("*", "all", "*"), ("all", "*", "*")),
    place=whole_cycles,
    fill=fill,
    excite=excite,
    last=True,
)
