"""Bearing clearance: a planet moves freely in its support within a dead zone.

m_p w'' = (F_sp + F_rp) cos beta - k g(w) - c w' [g(w) != 0], with g the backlash function of
half-width clearance / 2, k the support's stiffness and c = 2 ratio sqrt(k m_p), ratio 0.05, in
each half of the planet; what gives way is taken off its meshes, d = -w cos beta. Without
clearance the support is rigid, as in the nominal model. Source: dead-zone supports as in Guo and
Parker (J. Sound Vib. 331, 2012), in the place of the carrier's rigid pin in Eqs. (13), (14).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Effect, Options, Parameter
from herringbone_sim.effects.law import SHIFT, SHIFT_RATE, law, play

MASS, COS_BETA = 1, 2
RATIO = 0.05


def place(model: Model, mask: NDArray[np.float64], options: Options) -> NDArray[np.float64]:
    """Rows mask, mass of a planet's half [kg], cos beta (3, n_mesh)."""
    one = np.ones(mask.shape)
    return np.stack([mask, model.parameters.m_p * one, model.scales.cos_beta * one])


@law
def excite(theta, site, gear, now, own, law):
    """d = -w cos beta on both meshes of the planet's half, and its rate."""
    half = law.shape[1] // 2
    if theta[0] > 0.0:
        for m in range(law.shape[1]):
            if site[0, m] != 0.0:
                planet = m % half
                law[SHIFT, m] -= site[COS_BETA, m] * own[2 * planet]
                law[SHIFT_RATE, m] -= site[COS_BETA, m] * own[2 * planet + 1]


@law
def drive(theta, site, gear, now, own, force, slope):
    """The pin's own equation of motion, planet half by planet half."""
    half = force.size // 2
    slope[:] = 0.0
    damping = 2.0 * RATIO * np.sqrt(theta[1] * site[MASS, 0])
    for m in range(half):
        if theta[0] > 0.0 and (site[0, m] != 0.0 or site[0, half + m] != 0.0):
            w, rate = own[2 * m], own[2 * m + 1]
            g = play(w, 0.5 * theta[0])
            load = site[COS_BETA, m] * (force[m] + force[half + m]) - theta[1] * g
            if g != 0.0:
                load -= damping * rate
            slope[2 * m] = rate
            slope[2 * m + 1] = load / site[MASS, m]


EFFECT = Effect(
    id="bearing_clearance",
    text="dead zone in a planet's support",
    level="mesh",
    parameters=(
        Parameter("clearance", "m", "whole width of the dead zone", 0.0, 2e-4, 1e-5),
        Parameter("stiffness", "N/m", "beyond it", 1e8, 1e12, 1e10, neutral=None),
    ),
    loci=(("all", "*", "all"), ("all", "*", "*")),
    place=place,
    excite=excite,
    drive=drive,
    states=lambda model: model.layout.n_mesh,
)
