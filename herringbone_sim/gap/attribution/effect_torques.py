"""Torque balance of a run with effects of the catalogue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.law import no_react
from herringbone_sim.gap.attribution.effect_forces import (
    FusedRun,
    effect_contributions,
    force_function_with_effects,
)
from herringbone_sim.gap.data.kinematics import forces_to_coordinates
from herringbone_sim.gap.residuals.recalibrate import ForceLaw, force_law
from herringbone_sim.gap.residuals.torque_balance import (
    WIDTH,
    Balance,
    averaged_measured_force,
    quadrature_correction,
    torque_balance,
    window_of,
)

FREE_PIN_UNCERTAINTY = 0.4  # sigma of the reaction of a free pin on the carrier, over its RMS


def balance_with_effects(
    case: FusedRun,
    factors: Array,
    force_n: Array | None = None,
    actives: Sequence[Active] = (),
) -> Balance:
    """Torque balance of a run after subtraction of the torques that effects exert on the bodies.

    Torques of moving parts, such as free pins, are uncertain and add to ``sigma``.

    Args:
        case: run with its fused motion.
        factors: (6,) on k, c and e.
        force_n: (n, n_mesh) mesh forces [N]; None: the measured ones.
        actives: effects; those in the meshes enter the quadrature correction of the forces.
    """
    run = case.run if force_n is None else replace(case.run, F=replace(case.run.F, values=force_n))
    law = force_function_with_effects(case, factors, actives)
    correction = quadrature_correction(run, case.fused, law)
    force = averaged_measured_force(run, window_of(run), correction)
    balance = torque_balance(run, case.fused, None, force)
    pins = mesh_effects_on_bodies(case, actives)
    for a in actives:
        if a.effect.level != "body" and a not in pins:
            continue
        known = effect_accelerations(case, factors, force_law(case.run, case.fused, factors), a)
        balance = replace(balance, measured=balance.measured - known)
        if a in pins:
            balance = replace(
                balance,
                sigma=np.hypot(
                    balance.sigma, FREE_PIN_UNCERTAINTY * np.sqrt(np.mean(known**2, axis=0))
                ),
            )
    return balance


def mesh_effects_on_bodies(case: FusedRun, actives: Sequence[Active]) -> tuple[Active, ...]:
    """Mesh effects with moving parts that exert torques on the bodies, as free pins do."""
    model = case.run.model
    return tuple(
        a
        for a in actives
        if a.effect.level == "mesh" and a.effect.react is not no_react and a.effect.states(model)
    )


def balance_measured(cases: Sequence[FusedRun]) -> bool:
    """Whether every coordinate, rate and mesh force is measured in all runs."""
    return all(c.usable.all() and c.fused.complete for c in cases)


def effect_accelerations(
    case: FusedRun, factors: Array, law: ForceLaw, probe: Active, width: float = WIDTH
) -> Array:
    """Window averages (k, m) of the accelerations of m coordinates by an effect's torques [m/s^2].

    Args:
        case: run with its fused motion.
        factors: (6,) on k, c and e.
        law: force law with these factors.
        probe: the effect.
        width: standard deviation of the window [mesh cycles].
    """
    torque = effect_contributions(case, factors, law, (probe,))[1]
    through = forces_to_coordinates(case.run.model)
    averaged: Array = window_of(case.run, width).average(torque @ through.T)
    return averaged
