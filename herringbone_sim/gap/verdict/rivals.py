"""How well two explanations can be told apart: what one shows that the other can't take over.

The rest of one rival's prediction after the best fit of the other, with the tolerances of the
nominal parameters, over any set of runs: in the forces where they are measured, else in the
accelerations of the bodies. Linear about the best fit of each, inside the bounds of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from herringbone_sim.effects.effect import Active
from herringbone_sim.gap.attribution.bodies import masses
from herringbone_sim.gap.attribution.hypothesis import (
    Case,
    calibration_columns,
    effect_contributions,
    expected_forces,
    step_of,
    with_law_forces,
)
from herringbone_sim.gap.data.geometry import bodies_to_coordinates
from herringbone_sim.gap.residuals.balance import WIDTH as BALANCE_WIDTH
from herringbone_sim.gap.residuals.balance import Balance, inertia_parts, torque_balance, window_of
from herringbone_sim.gap.residuals.motion import WIDTH as MOTION_WIDTH
from herringbone_sim.gap.residuals.motion import fused_noise, motion_balance
from herringbone_sim.gap.residuals.recalibrate import BOUNDS, HEAVIEST, ForceLaw, force_law

Array = NDArray[np.float64]

SEED = 21  # of the noise that gives the floor of the accelerations
FORCES, BALANCE, MOTION = "forces", "balance", "motion"


@dataclass(frozen=True)
class Rival:
    """An explanation at its best fit.

    Attributes:
        actives: effects; none for the calibrated nominal gear.
        factors, inverse: (6,) and (3,) calibration that goes with them.
    """

    actives: tuple[Active, ...]
    factors: Array
    inverse: Array

    @property
    def name(self) -> str:
        return named(self.actives)


@dataclass(frozen=True)
class Shown:
    """What a rival shows in a run, over the floor.

    Attributes:
        values: (k,) expected_forces.
        columns: (q, k) change of it by tolerances and parameters.
        gram: (q, q) their products.
        low, high: (q,) what is left of their bounds.
    """

    values: Array
    columns: Array
    gram: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class Rest:
    """Normal equations of what one rival leaves of another: A (q, q), b (q,), squares, values."""

    A: Array
    b: Array
    energy: float
    count: float
    low: Array
    high: Array

    def __add__(self, other: Rest) -> Rest:
        return replace(
            self,
            A=self.A + other.A,
            b=self.b + other.b,
            energy=self.energy + other.energy,
            count=self.count + other.count,
        )

    def times(self, weight: float) -> Rest:
        """As if there were so many of the run."""
        return replace(
            self,
            A=weight * self.A,
            b=weight * self.b,
            energy=weight * self.energy,
            count=weight * self.count,
        )

    @property
    def finite(self) -> bool:
        """Whether the laws of both rivals held on to the motion."""
        return bool(np.isfinite(self.A).all() and np.isfinite(self.b).all())

    @property
    def least(self) -> float:
        """Sum of squares that the best parameters leave."""
        scale = 1.0 / np.sqrt(np.maximum(np.diag(self.A), 1e-300))
        whole = self.A * np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
        root = np.linalg.cholesky(whole).T
        right = np.linalg.solve(root.T, scale * self.b)
        found = lsq_linear(root, right, bounds=(self.low / scale, self.high / scale))
        beta = scale * found.x
        return max(float(self.energy - 2.0 * self.b @ beta + beta @ self.A @ beta), 0.0)


def named(actives: Sequence[Active]) -> str:
    """Ids of effects that act together."""
    return " with ".join(a.effect.id for a in actives) or "none"


def rest(of: Shown, after: Shown) -> Rest:
    """What is left of one rival after the best fit of another, in one run."""
    d, J = of.values - after.values, after.columns
    return Rest(
        after.gram, np.einsum("qk,k->q", J, d), float(d @ d), float(d.size), after.low, after.high
    )


def shown(one: Case, rivals: Sequence[Rival], where: str) -> list[Shown]:
    """What each rival shows in a run, in ``FORCES``, ``BALANCE`` or ``MOTION``."""
    look = _Forces(one) if where == FORCES else _bodies(one, rivals[0], where == MOTION)
    return [_shown(look, one, rival) for rival in rivals]


def _shown(look: _Forces | _Bodies, one: Case, rival: Rival) -> Shown:
    law = force_law(one.run, one.fused, rival.factors)
    here = look.of(rival, law, rival.actives)
    columns = [*look.tolerances(rival, law)]
    low, high = (list(bound) for bound in look.bounds(rival))
    for i, active in enumerate(rival.actives):
        lowest, highest = active.effect.bounds
        low += list(lowest - active.theta)
        high += list(highest - active.theta)
        for k in range(len(active.theta)):
            moved, h = _moved(active, k)
            changed = (*rival.actives[:i], moved, *rival.actives[i + 1 :])
            columns.append((look.of(rival, law, changed) - here) / h)
    # A fit that lies on a bound still needs an interval that is not empty.
    below, above = np.minimum(low, -1e-9), np.maximum(high, 1e-9)
    J = np.stack(columns)
    # Sums this small are slower by far where a threaded product has to share its cores.
    gram = np.einsum("qk,pk->qp", J, J)
    return Shown(here, J, gram, below, above)


def _moved(active: Active, k: int) -> tuple[Active, float]:
    """An effect with one parameter a small step further, and the step."""
    p, theta = active.effect.parameters[k], np.array(active.theta)
    h = 1e-2 * abs(theta[k]) if p.unit == "N/m" and theta[k] else step_of(p)
    h = -h if theta[k] + h > p.high else h
    theta[k] += h
    return active.with_theta(theta), h


@dataclass(frozen=True)
class _Forces:
    case: Case

    def of(self, rival: Rival, law: ForceLaw, actives: Sequence[Active]) -> Array:
        return self._white(expected_forces(self.case, rival.factors, actives, law))

    def tolerances(self, rival: Rival, law: ForceLaw) -> list[Array]:
        columns = calibration_columns(self.case, law, rival.factors)
        return [self._white(part) for column in columns for part in _of_kinds(column)]

    def bounds(self, rival: Rival) -> tuple[Array, Array]:
        return 1.0 - BOUNDS - rival.factors, 1.0 + BOUNDS - rival.factors

    def _white(self, force: Array) -> Array:
        c = self.case
        white: Array = np.where(c.usable, np.nan_to_num(force / c.floor), 0.0)[:, c.usable]
        return white.ravel()


@dataclass(frozen=True)
class _Bodies:
    """Accelerations by torques and, without force sensors, by the law's forces."""

    case: Case
    balance: Balance
    through: Array
    of_force: Array
    width: float
    motion: bool

    def of(self, rival: Rival, law: ForceLaw, actives: Sequence[Active]) -> Array:
        force, torque = effect_contributions(self.case, rival.factors, law, actives)
        made = torque @ self.through.T
        if self.motion:
            made = made + (law.modelled_n + force) @ self.of_force.T
        return self._white(self._average(made))

    def tolerances(self, rival: Rival, law: ForceLaw) -> list[Array]:
        columns = [self._white(part) for part in self.balance.parts]
        if self.motion:
            for column in calibration_columns(self.case, law, rival.factors):
                made = [part @ self.of_force.T for part in _of_kinds(column)]
                columns += [self._white(self._average(one)) for one in made]
        return columns

    def bounds(self, rival: Rival) -> tuple[Array, Array]:
        of_law = 1.0 - rival.factors if self.motion else np.zeros(0)
        middle = np.concatenate([1.0 - rival.inverse, of_law])
        half = np.concatenate([np.full(3, HEAVIEST - 1.0), BOUNDS[: len(of_law)]])
        return middle - half, middle + half

    def _average(self, values: Array) -> Array:
        averaged: Array = window_of(self.case.run, self.width).average(values)
        return averaged

    def _white(self, values: Array) -> Array:
        white: Array = (values / self.balance.sigma).ravel()
        return white


def _bodies(one: Case, rival: Rival, motion: bool) -> _Bodies:
    """Floor and inertias by the calibration of one rival; that of another is close by."""
    run, model = one.run, one.run.model
    through = bodies_to_coordinates(model) / masses(model)
    of_force = np.tensordot(rival.inverse, inertia_parts(model), axes=1)
    if not motion:
        balance = torque_balance(run, one.fused)
        return _Bodies(one, balance, through, of_force, BALANCE_WIDTH, False)
    noise = fused_noise(run, np.random.default_rng(SEED))
    balance = motion_balance(run, one.fused, noise, rival.factors, rival.inverse)
    law = force_law(run, one.fused, rival.factors)
    return _Bodies(with_law_forces(one, law), balance, through, of_force, MOTION_WIDTH, True)


def _of_kinds(column: Array) -> tuple[Array, Array]:
    """The part of sun meshes and that of ring meshes of a column (n, n_mesh)."""
    first = np.arange(column.shape[1]) < column.shape[1] // 2
    return np.where(first, column, 0.0), np.where(first, 0.0, column)
