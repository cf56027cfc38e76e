"""The torque balance of a run with effects in its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.law import no_react
from herringbone_sim.gap.attribution.hypothesis import Case, added, fine_law_with
from herringbone_sim.gap.data.geometry import bodies_to_coordinates
from herringbone_sim.gap.residuals.balance import (
    UNSURE_AT_ONCE,
    WIDTH,
    Balance,
    measured_force,
    quadrature,
    torque_balance,
)
from herringbone_sim.gap.residuals.balance import window_of as look_of
from herringbone_sim.gap.residuals.recalibrate import Law, force_law

Array = NDArray[np.float64]

UNSURE_PIN = 0.4  # share of the RMS of what a free pin does to the carrier that it may be off


def balance_of(
    one: Case,
    factors: Array,
    force_n: Array | None = None,
    actives: Sequence[Active] = (),
) -> Balance:
    """Torque balance of a run with its measured forces, or others (n, n_mesh) in their place.

    The law with effects says how forces run between samples; torques of effects on the bodies are
    taken off, and of those in the meshes, as of a free pin on the carrier.
    """
    run = one.run if force_n is None else replace(one.run, F=replace(one.run.F, values=force_n))
    correction = quadrature(run, one.fused, fine_law_with(one, factors, actives))
    force = measured_force(run, look_of(run), correction)
    balance = torque_balance(run, one.fused, None, force)
    pins = free_pins(one, actives)
    for a in actives:
        if a.effect.level != "body" and a not in pins:
            continue
        known = response(one, factors, force_law(one.run, one.fused, factors), a)
        balance = replace(balance, measured=balance.measured - known)
        if a in pins:
            balance = replace(
                balance,
                sigma=np.hypot(balance.sigma, UNSURE_PIN * np.sqrt(np.mean(known**2, axis=0))),
                unsure=np.hypot(balance.unsure, UNSURE_AT_ONCE * known),
            )
    return balance


def free_pins(one: Case, actives: Sequence[Active]) -> tuple[Active, ...]:
    """Effects in the meshes that turn bodies as well, by what moves in them."""
    model = one.run.model
    return tuple(
        a
        for a in actives
        if a.effect.level == "mesh" and a.effect.react is not no_react and a.effect.states(model)
    )


def balances_known(cases: Sequence[Case]) -> bool:
    """Whether every coordinate and every force is measured in all runs."""
    return all(
        c.usable.all() and np.isfinite(c.fused.z_rate).all() and np.isfinite(c.fused.z).all()
        for c in cases
    )


def response(one: Case, factors: Array, law: Law, probe: Active, width: float = WIDTH) -> Array:
    """Accelerations (k, m) of the coordinates by an effect's torques, averaged [m/s^2]."""
    torque = added(one, factors, law, (probe,))[1]
    through = bodies_to_coordinates(one.run.model) / masses(one.run.model)
    averaged: Array = look_of(one.run, width).average(torque @ through.T)
    return averaged


def masses(model: Model) -> Array:
    """M (n_bodies,) [kg] of s_L, s_R, c, p1_L, ...: inertia over base radius squared."""
    packed, s = model.packed, model.scales
    return np.concatenate([1.0 / packed.inv_M_s, [s.M_c], 1.0 / packed.inv_M_p.ravel()])
