"""Run-out: e + amplitude sin(order 2 pi (cycles - late) / Z + phase), by rotation of a member.

Order 1 is eccentricity, higher orders are further long waves of its pitch error. Z is the number
of mesh cycles per revolution relative to the carrier (27, 25, 77 for sun, planet, ring of the
nominal rig); ``late`` is the delay in mesh cycles with which a tooth of the member reaches each
mesh. Source: one more harmonic of e(t), Eq. (9), which Eqs. (15), (16) subtract from the
deflection.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.effects.effect import Effect, Option, Options, Parameter
from herringbone_sim.effects.law import FREQUENCY, PHASE, SHIFT, SHIFT_RATE, law
from herringbone_sim.effects.site import MEMBER, revolutions
from herringbone_sim.effects.slots import Slots


def place(model: Model, mask: Array, options: Options) -> Array:
    """Return ``site``, rows (3, n_mesh): mask, mesh cycles per wave, delay in mesh cycles."""
    rows = revolutions(model, mask, options)
    rows[1] /= options["order"]
    return rows


@law
def excite(theta, site, gear, now, added_states, law):
    """Add the wave to e: subtract it from the displacement d, and its rate from d'."""
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            angle = (now[PHASE] - TWO_PI * site[2, m]) / site[1, m] + theta[1]
            law[SHIFT, m] -= theta[0] * np.sin(angle)
            law[SHIFT_RATE, m] -= theta[0] * np.cos(angle) * now[FREQUENCY] / site[1, m]


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Add the wave to e: subtract it from the displacement d."""
    _, cycles, late = place(slots.model, mask, options)
    order = 1.0 / float(cycles[0])
    angle = theta[1] - 2.0 * np.pi * late * order
    amplitude = theta[0] * mask
    slots.add_displacement(order, -amplitude * np.sin(angle), -amplitude * np.cos(angle))


EFFECT = Effect(
    id="runout",
    text="displacement by the turn of one member against the carrier",
    level="mesh",
    parameters=(
        Parameter("amplitude", "m", "of the wave in e", 0.0, 2e-4, 1e-5),
        Parameter("phase", "rad", "at phase 0 on planet 1", -3.1416, 3.1416, 0.0, neutral=None),
    ),
    options=(MEMBER, Option("order", "waves a revolution", 1, tuple(range(1, 7)), bends=True)),
    loci=(("*", "all", "all"), ("*", "all", "*"), ("all", "*", "all"), ("all", "*", "*")),
    place=place,
    fill=fill,
    excite=excite,
)
