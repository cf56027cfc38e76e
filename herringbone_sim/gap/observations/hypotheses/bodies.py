"""Hypotheses: effects of the catalogue that act on bodies rather than in meshes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.data.kinematics import forces_to_coordinates
from herringbone_sim.gap.observations import torque_balance
from herringbone_sim.gap.observations.basis import TURNS
from herringbone_sim.gap.observations.friction import (
    ELASTIC,
    FRICTION,
    NEAR,
    OF_COULOMB,
    friction_directions,
)
from herringbone_sim.gap.observations.hypotheses.coefficients import (
    DEPARTURE_SHARE,
    CoefficientBuilder,
    Weights,
)


def friction(builder: CoefficientBuilder) -> Iterator[Hypothesis]:
    """Yield tooth friction at every place: forces mu |F| along the flanks.

    Coulomb's law is the effect; departures let the force vary freely over the mesh cycle.
    """
    gear = builder.gear
    effect = known_effects()["tooth_friction"]
    layout = gear.model.layout
    to_rows = forces_to_coordinates(gear.model)
    for locus in effect.candidates(layout):
        directions = friction_directions(gear.model, locus.mask(layout))
        of = {g: direction @ to_rows.T for g, direction in directions.items()}
        weights: Weights = {
            (torque_balance.NAME, f"friction {g} of {j}"): of[g][j]
            for j in range(layout.n_mesh)
            for g in OF_COULOMB
            if np.any(of[g][j])
        }
        at = np.flatnonzero(locus.mask(layout))
        for o in builder.window_observation:
            weights |= {(o, f"friction {g} of {j}"): 1.0 for j in at for g in OF_COULOMB}
        terms = [builder.coefficient("mu", weights, 0.05)]
        for g in FRICTION[len(OF_COULOMB) :]:
            bend: Weights = {
                (torque_balance.NAME, f"friction {g} of {j}"): of["sign"][j]
                for j in range(layout.n_mesh)
                if np.any(of["sign"][j])
            }
            for o in builder.window_observation:
                bend |= {(o, f"friction {g} of {j}"): 1.0 for j in at}
            # Sliding may reverse earlier or later, and friction may follow the spring force.
            share = 1.0 if g in (*NEAR, ELASTIC) else DEPARTURE_SHARE
            terms.append(builder.coefficient(g, bend, 0.05 * share))
        yield Hypothesis("tooth_friction", (), locus, tuple(terms), 1)


def ripple(builder: CoefficientBuilder) -> Iterator[Hypothesis]:
    """Yield torque ripple of every order of the input shaft, with its harmonics.

    Coefficients are amplitudes of the ripple over T_1.
    """
    gear = builder.gear
    push = np.zeros(len(gear.model.layout.bodies))
    push[:2] = 0.5 / gear.model.scales.r_bs
    rows = gear.T_1[:, None] * (forces_to_coordinates(gear.model) @ push)
    for order in torque_balance.RIPPLES:
        terms = []
        for times in TURNS:
            sd = 1.0 if times == 1 else DEPARTURE_SHARE
            if times * order in torque_balance.RIPPLES:
                for trig in ("cos", "sin"):
                    of: Weights = {(torque_balance.NAME, f"ripple {times * order} {trig}"): rows}
                    for o in builder.window_observation:
                        of[o, f"ripple {times * order} {trig}"] = gear.T_1[:, None]
                    terms.append(builder.coefficient(f"{times} {trig}", of, 0.2 * sd))
        yield Hypothesis("torque_ripple", (("order", order),), Locus(), tuple(terms), 2)
