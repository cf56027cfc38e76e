"""Effects on the bodies: what friction and torque ripple do to the torque balance.

They leave no trace in the force law. Each is regressed, with the three inertias inside their
tolerance, on the balance averaged over half a mesh cycle; runs that were left out score.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Active, Effect
from herringbone_sim.effects.law import no_react
from herringbone_sim.gap.attribution.features import Feature, of_level
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
from herringbone_sim.gap.residuals.recalibrate import HEAVIEST, Law, force_law

Array = NDArray[np.float64]

NORMAL_90 = 1.645
FEWEST_WHOLE = 2  # runs with every force and rate that a balance is left out from
UNSURE_PIN = 0.4  # share of the RMS of what a free pin does to the carrier that it may be off


@dataclass(frozen=True)
class BodyFit:
    """An effect on the bodies, or none.

    Attributes:
        actives: the effect with its parameters; none for the nominal balance.
        sigma: (p,) of its parameters.
        inverse: (3,) factors on 1/M_s, 1/M_p, 1/M_c.
        chi2: mean square of residual over floor.
        left_out: the same of runs predicted by the others.
    """

    actives: tuple[Active, ...]
    sigma: Array
    inverse: Array
    chi2: float
    left_out: float


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


def body_fits(
    cases: Sequence[Case], factors: Array, balances: Sequence[Balance], effects: Sequence[Effect]
) -> list[BodyFit]:
    """The nominal balance first, then every effect on the bodies at every locus."""
    systems = [_system(b, []) for b in balances]
    found = [_fit(systems, None)]
    model = cases[0].run.model
    laws = [force_law(c.run, c.fused, factors) for c in cases]
    for feature in of_level(effects, "body"):
        for locus in feature.start.effect.candidates(model.layout):
            probes = [(replace(p, locus=locus), step) for p, step in feature.probes]
            systems = [
                _system(b, [response(c, factors, law, p) / step for p, step in probes])
                for c, law, b in zip(cases, laws, balances, strict=True)
            ]
            start = replace(feature, start=replace(feature.start, locus=locus))
            found.append(_fit(systems, start))
    return found


def peak(balances: Sequence[Balance], nominal: BodyFit) -> float:
    """Largest residual over its floor: a short event that a mean over all samples hides."""
    left = [b.measured - np.tensordot(nominal.inverse, b.parts, axes=1) for b in balances]
    floors = [np.sqrt(b.sigma**2 + b.unsure**2) for b in balances]
    return max(float(np.abs(r / floor).max()) for r, floor in zip(left, floors, strict=True))


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


@dataclass(frozen=True)
class _System:
    A: Array
    b: Array
    energy: float
    count: int
    overlap: float


def _system(balance: Balance, columns: Sequence[Array]) -> _System:
    white = [part / balance.sigma for part in (*balance.parts, *columns)]
    J = np.stack([w.ravel() for w in white], axis=1)
    r = ((balance.measured - balance.parts.sum(0)) / balance.sigma).ravel()
    return _System(J.T @ J, J.T @ r, float(r @ r), r.size, balance.overlap)


def _fit(systems: Sequence[_System], feature: Feature | None) -> BodyFit:
    beta, sigma, left = _solve(systems)
    count = sum(s.count for s in systems)
    out = 0.0
    for i, one in enumerate(systems):
        rest = [s for j, s in enumerate(systems) if j != i] or [one]
        other = _solve(rest)[0]
        out += _left(one, other)
    actives: tuple[Active, ...] = ()
    spread = np.zeros(0)
    if feature is not None:
        theta = feature.theta(beta[3:])
        actives = (feature.start.with_theta(theta),)
        size = max(float(np.hypot(*beta[3:])) if feature.kind == "wave" else 1.0, 1e-12)
        spread = sigma[3:] / (np.array([1.0, size]) if feature.kind == "wave" else 1.0)
    return BodyFit(actives, spread, 1.0 + beta[:3], left / count, out / count)


def _left(one: _System, beta: Array) -> float:
    return float(one.energy - 2.0 * one.b @ beta + beta @ one.A @ beta)


def _solve(systems: Sequence[_System]) -> tuple[Array, Array, float]:
    """Coefficients with inertias in bounds, their sigma, and the squares left."""
    A = np.sum([s.A for s in systems], axis=0)
    b = np.sum([s.b for s in systems], axis=0)
    overlap = float(np.mean([s.overlap for s in systems]))
    bound = HEAVIEST - 1.0
    weight = np.zeros(len(b))
    weight[:3] = overlap * 3.0 / bound**2
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A) + weight, 1e-300))
    whole = (A + np.diag(weight)) * np.outer(scale, scale) + 1e-10 * np.eye(len(b))
    beta = scale * np.linalg.solve(whole, scale * b)
    held = np.clip(beta[:3], -bound, bound)
    if len(b) > 3 and not np.array_equal(held, beta[:3]):
        rest = A[3:, 3:] + 1e-10 * np.diag(np.diag(A)[3:] + 1e-300)
        beta[3:] = np.linalg.solve(rest, b[3:] - A[3:, :3] @ held)
    beta[:3] = held
    left = sum(_left(s, beta) for s in systems)
    excess = max(left / sum(s.count for s in systems), 1.0)
    sigma = scale * np.sqrt(np.diag(np.linalg.inv(whole)) * overlap * excess)
    return beta, sigma, left
