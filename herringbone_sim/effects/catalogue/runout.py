"""Run-out: e + amplitude sin(2 pi (cycles - late) / Z + phase), once a revolution of a member.

Z are the mesh cycles of a revolution relative to the carrier (27, 25, 77 for sun, planet, ring of
the nominal rig); ``late`` is when the same place of the member reaches the mesh of each planet.
Source: eccentricity as one more harmonic of e(t), Eq. (9), which Eqs. (15), (16) subtract from the
deflection.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import FREQUENCY, PHASE, SHIFT, SHIFT_RATE, law
from herringbone_sim.effects.site import MEMBER, revolutions
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, own, law):
    """Add a wave to e, once a revolution, and its rate."""
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            angle = (now[PHASE] - TWO_PI * site[2, m]) / site[1, m] + theta[1]
            law[SHIFT, m] -= theta[0] * np.sin(angle)
            law[SHIFT_RATE, m] -= theta[0] * np.cos(angle) * now[FREQUENCY] / site[1, m]


def fill(
    slots: Slots, theta: tuple[float, ...], mask: NDArray[np.float64], options: Options
) -> None:
    """Add one harmonic to e, once a revolution."""
    _, cycles, late = revolutions(slots.model, mask, options)
    order = 1.0 / float(cycles[0])
    angle = theta[1] - 2.0 * np.pi * late * order
    amplitude = theta[0] * mask
    slots.add_displacement(order, -amplitude * np.sin(angle), -amplitude * np.cos(angle))


EFFECT = Effect(
    id="runout",
    text="once-a-revolution (against the carrier) displacement of one member",
    level="mesh",
    parameters=(
        Parameter("amplitude", "m", "of the wave in e", 0.0, 2e-4, 1e-5),
        Parameter("phase", "rad", "at phase 0 on planet 1", -3.1416, 3.1416, 0.0, neutral=None),
    ),
    options=(MEMBER,),
    loci=(("*", "all", "all"), ("*", "all", "*"), ("all", "*", "all"), ("all", "*", "*")),
    place=revolutions,
    fill=fill,
    excite=excite,
)
