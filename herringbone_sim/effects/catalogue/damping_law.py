"""Damping law: c v replaced in part, c v [1 - share + share s], s by what the law says.

``contact``: s = 1 in contact, 0 out of it. ``load``: s = |f| / f_0 with f_0 = 10 micrometres, so
in proportion to the spring's load (Hunt and Crossley 1975). Source: Eq. (12) with another c.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Effect, Option, Options, Parameter
from herringbone_sim.effects.law import DAMPING, PLAY, law, play

F_0 = 1e-5
LAWS = ("contact", "load")


def place(model: Model, mask: NDArray[np.float64], options: Options) -> NDArray[np.float64]:
    """Rows mask, which law (2, n_mesh)."""
    return np.stack([mask, np.full(mask.shape, float(LAWS.index(options["law"])))])


@law
def react(theta, site, gear, now, own, x, v, law, force, torque):
    """c v by its share elsewhere than everywhere."""
    for m in range(force.size):
        if site[0, m] != 0.0:
            f = abs(play(x[m], law[PLAY, m]))
            s = f / F_0 if site[1, m] == 1.0 else (1.0 if f > 0.0 else 0.0)
            force[m] += theta[0] * law[DAMPING, m] * v[m] * (s - 1.0)


EFFECT = Effect(
    id="damping_law",
    text="damping not c v everywhere (only in contact, or proportional to load)",
    level="mesh",
    parameters=(Parameter("share", "-", "of c v that follows the other law", 0.0, 1.0, 0.3),),
    options=(Option("law", "what the share follows", "contact", LAWS),),
    loci=(("all", "all", "all"), ("*", "all", "all")),
    place=place,
    react=react,
)
