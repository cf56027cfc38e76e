"""Thermal stiffness: k decreases with temperature, k [1 - rate T].

T = delta_T [1 + curvature (delta_T / 50 K - 1)], which is delta_T at 50 K. Source: the temperature
coefficient of Young's modulus in k_h, k_a, k_b, k_s, k_f of Eq. (5).
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import DELTA_T, STIFFNESS, bent_temperature, law
from herringbone_sim.effects.site import CURVATURE
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, added_states, law):
    """Multiply k by 1 - rate T, limited to 0.05 from below."""
    warm = bent_temperature(now[DELTA_T], theta[1])
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            law[STIFFNESS, m] *= max(1.0 - theta[0] * warm, 0.05)


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Multiply k by 1 - rate T, limited to 0.05 from below."""
    factor = max(1.0 - theta[0] * bent_temperature(slots.model.parameters.delta_T, theta[1]), 0.05)
    slots.scale_stiffness(np.where(mask > 0.0, factor, 1.0))


EFFECT = Effect(
    id="thermal_stiffness",
    text="stiffness falls with temperature",
    level="mesh",
    parameters=(
        Parameter("rate", "1/K", "share of k lost a kelvin", -0.01, 0.01, 1e-3),
        CURVATURE,
    ),
    loci=(("all", "all", "all"), ("*", "all", "all")),
    fill=fill,
    excite=excite,
)
