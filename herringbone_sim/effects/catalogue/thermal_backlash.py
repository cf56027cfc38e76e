"""Thermal backlash: b' changes with temperature at another rate, b' + rate T.

T = delta_T [1 + curvature (delta_T / 50 K - 1)], which is delta_T at 50 K. A positive rate
gives more backlash. Source: Eqs. (2), (3) with another expansion coefficient.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import DELTA_T, PLAY, bent_temperature, law
from herringbone_sim.effects.site import CURVATURE
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, added_states, law):
    """Add rate T to b', limited to zero from below."""
    warm = bent_temperature(now[DELTA_T], theta[1])
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            law[PLAY, m] = max(law[PLAY, m] + theta[0] * warm, 0.0)


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Add rate T to b', limited to zero from below."""
    more = theta[0] * bent_temperature(slots.model.parameters.delta_T, theta[1])
    slots.half_backlash = np.maximum(slots.half_backlash + more * mask, 0.0)


EFFECT = Effect(
    id="thermal_backlash",
    text="half-backlash b' changes with temperature at another rate",
    level="mesh",
    parameters=(
        Parameter("rate", "m/K", "more half-backlash a kelvin", -5e-7, 2e-6, 5e-8),
        CURVATURE,
    ),
    loci=(("all", "all", "all"), ("*", "all", "all")),
    fill=fill,
    excite=excite,
)
