"""Thermal backlash: b' changes with temperature at another rate, b' + rate delta_T.

Source: Eqs. (2), (3) with another expansion coefficient. A positive rate gives more backlash.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import DELTA_T, PLAY, law
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, own, law):
    """Add rate delta_T to b', limited to zero from below."""
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            law[PLAY, m] = max(law[PLAY, m] + theta[0] * now[DELTA_T], 0.0)


def fill(
    slots: Slots, theta: tuple[float, ...], mask: NDArray[np.float64], options: Options
) -> None:
    """Add rate delta_T to b', limited to zero from below."""
    more = theta[0] * slots.model.parameters.delta_T
    slots.half_backlash = np.maximum(slots.half_backlash + more * mask, 0.0)


EFFECT = Effect(
    id="thermal_backlash",
    text="half-backlash b' changes with temperature at another rate",
    level="mesh",
    parameters=(Parameter("rate", "m/K", "more half-backlash a kelvin", -5e-7, 2e-6, 5e-8),),
    loci=(("all", "all", "all"), ("*", "all", "all")),
    fill=fill,
    excite=excite,
)
