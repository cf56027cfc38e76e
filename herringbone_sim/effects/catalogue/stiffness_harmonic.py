"""Additional harmonic of k(t): k += k_m [cos cos(order phase) + sin sin(order phase)].

Source: Eq. (7) with one more term; order 1 corrects amplitude and phase of Eq. (8).
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import mean_stiffness
from herringbone_sim.effects.effect import Effect, Option, Options, Parameter
from herringbone_sim.effects.law import MEAN_K, PHASE, STIFFNESS, law
from herringbone_sim.effects.site import ANYWHERE, ORDER, mesh_order
from herringbone_sim.effects.slots import Slots


@law
def excite(theta, site, gear, now, added_states, law):
    """Add k_m (theta[0] cos + theta[1] sin)(order phase) to k of the meshes of the locus.

    k_m is the mean stiffness of the gear without effects. Arrays: see ``effects.law``.
    """
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            angle = site[ORDER, m] * now[PHASE]
            share = theta[0] * np.cos(angle) + theta[1] * np.sin(angle)
            law[STIFFNESS, m] += gear[MEAN_K, m] * share


def fill(slots: Slots, theta: tuple[float, ...], mask: Array, options: Options) -> None:
    """Add the harmonic to k, with amplitudes relative to the mean of the gear without effects."""
    k_m = mean_stiffness(slots.model.parameters) * mask
    slots.add_stiffness(float(options["order"]), theta[0] * k_m, theta[1] * k_m)


EFFECT = Effect(
    id="stiffness_harmonic",
    text="a further mesh-order harmonic of k(t), or a wrong first one",
    level="mesh",
    parameters=(
        Parameter("cos", "-", "cosine amplitude as a share of the mean", -0.5, 0.5, 0.05),
        Parameter("sin", "-", "sine amplitude as a share of the mean", -0.5, 0.5, 0.05),
    ),
    options=(Option("order", "of the mesh frequency", 2, tuple(range(1, 9))),),
    loci=ANYWHERE,
    place=mesh_order,
    fill=fill,
    excite=excite,
)
