"""Separation of two explanations by runs: their difference after a fit of one to the other.

The prediction of one explanation minus that of the other, after a fit of the parameters of the
other and of the tolerances of the nominal gear; in the mesh forces, or in the accelerations of the
coordinates. The predictions are linearised at the best fit of each explanation; parameters stay
within their bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Active
from herringbone_sim.gap.attribution.effect_forces import (
    FusedRun,
    effect_contributions,
    expected_forces,
    step_of,
    with_law_forces,
)
from herringbone_sim.gap.data.kinematics import forces_to_coordinates
from herringbone_sim.gap.residuals.balance_without_forces import WIDTH as MOTION_WIDTH
from herringbone_sim.gap.residuals.balance_without_forces import fused_noise, motion_balance
from herringbone_sim.gap.residuals.recalibrate import (
    BOUNDS,
    HEAVIEST,
    ForceLaw,
    bounded_step,
    calibration_columns,
    force_law,
)
from herringbone_sim.gap.residuals.torque_balance import WIDTH as BALANCE_WIDTH
from herringbone_sim.gap.residuals.torque_balance import (
    Balance,
    inertia_parts,
    torque_balance,
    window_of,
)
from herringbone_sim.gap.verdict.effect_texts import effect_names

SEED = 21  # of the noise realisation from which the noise of accelerations is estimated
SUMMED = ("A", "b", "chi2", "count")  # what separations of several runs add up
FORCES, BALANCE, MOTION = "forces", "balance", "motion"  # quantities, see ``linear_predictions``


@dataclass(frozen=True)
class ExplanationAtFit:
    """An explanation at its best fit.

    Attributes:
        actives: effects; none for the calibrated nominal gear.
        factors: (6,) on k, c and e.
        inverse: (3,) factors on 1/M_s, 1/M_p, 1/M_c.
    """

    actives: tuple[Active, ...]
    factors: Array
    inverse: Array

    @property
    def name(self) -> str:
        """Ids of the effects as text, ``a with b``."""
        return effect_names(self.actives)


@dataclass(frozen=True)
class LinearPrediction:
    """Prediction of an explanation in a run, linear in its parameters, in units of the noise.

    Attributes:
        values: (k,) predicted values.
        columns: (q, k) derivatives with respect to tolerances and parameters of effects.
        gram: (q, q) inner products of the columns.
        low, high: (q,) bounds of the changes of tolerances and parameters.
    """

    values: Array
    columns: Array
    gram: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class Separation:
    """Normal equations of the fit of one explanation to another, summed over runs.

    Attributes:
        A: (q, q) normal matrix.
        b: (q,) right side.
        chi2: sum of squares of the difference before the fit, in units of the noise.
        count: number of values.
        low, high: (q,) bounds of the changes of tolerances and parameters.
    """

    A: Array
    b: Array
    chi2: float
    count: float
    low: Array
    high: Array

    def __add__(self, other: Separation) -> Separation:
        return replace(self, **{n: getattr(self, n) + getattr(other, n) for n in SUMMED})

    def times(self, weight: float) -> Separation:
        """Copy for ``weight`` times as many values."""
        return replace(self, **{n: weight * getattr(self, n) for n in SUMMED})

    @property
    def finite(self) -> bool:
        """Whether ``A`` and ``b`` are finite; not so where the motion of a prediction diverges."""
        return bool(np.isfinite(self.A).all() and np.isfinite(self.b).all())

    @property
    def least(self) -> float:
        """Sum of squares of the difference after the fit, with parameters inside their bounds."""
        scale = 1.0 / np.sqrt(np.maximum(np.diag(self.A), 1e-300))
        scaled = self.A * np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
        low, high = self.low / scale, self.high / scale
        beta = scale * bounded_step(scaled, scale * self.b, low, high)
        return max(float(self.chi2 - 2.0 * self.b @ beta + beta @ self.A @ beta), 0.0)


def separation(target: LinearPrediction, fitted: LinearPrediction) -> Separation:
    """Normal equations of the fit of ``fitted`` to ``target`` in one run, in units of the noise.

    Unknowns are the changes (q,) of the tolerances and parameters of ``fitted``; those of
    ``target`` are held. Both must predict the same k values.
    """
    d, J = target.values - fitted.values, fitted.columns
    return Separation(
        A=fitted.gram,
        b=np.einsum("qk,k->q", J, d),
        chi2=float(d @ d),
        count=float(d.size),
        low=fitted.low,
        high=fitted.high,
    )


def linear_predictions(
    case: FusedRun, explanations: Sequence[ExplanationAtFit], quantity: str
) -> list[LinearPrediction]:
    """Linearise the prediction of each explanation in a run, at its best fit, over the noise.

    Args:
        case: run with its fused motion.
        explanations: of the same calibrated gear; ``MOTION`` takes that of the first.
        quantity: ``FORCES``: forces of the usable meshes; ``BALANCE``: accelerations by the
            torques of effects on bodies, without mesh forces; ``MOTION``: accelerations by these
            torques and by the mesh forces of the law, even where forces are measured.
    """
    if quantity == FORCES:
        predictor: _Forces | _Bodies = _Forces(case)
    else:
        predictor = _bodies(case, explanations[0], quantity == MOTION)
    return [_linear_prediction(predictor, case, explanation) for explanation in explanations]


def _linear_prediction(
    predictor: _Forces | _Bodies, case: FusedRun, explanation: ExplanationAtFit
) -> LinearPrediction:
    """Prediction of one explanation, with derivatives by finite differences for its effects.

    Parameters that bend the law of an effect (``Parameter.bends``) are not varied.
    """
    law = force_law(case.run, case.fused, explanation.factors)
    values = predictor.values(explanation, law, explanation.actives)
    columns = [*predictor.tolerances(explanation, law)]
    low, high = (list(bound) for bound in predictor.bounds(explanation))
    for i, active in enumerate(explanation.actives):
        for k, p in enumerate(active.effect.parameters):
            if p.bends:
                continue
            low.append(p.low - active.theta[k])
            high.append(p.high - active.theta[k])
            moved, h = _with_step(active, k)
            changed = (*explanation.actives[:i], moved, *explanation.actives[i + 1 :])
            columns.append((predictor.values(explanation, law, changed) - values) / h)
    # bounded_step needs a non-empty interval, also for a fit on a bound.
    below, above = np.minimum(low, -1e-9), np.maximum(high, 1e-9)
    J = np.stack(columns)
    # einsum, as a threaded matrix product of this size is much slower on shared cores.
    gram = np.einsum("qk,pk->qp", J, J)
    return LinearPrediction(values, J, gram, below, above)


def _with_step(active: Active, k: int) -> tuple[Active, float]:
    """The effect with parameter ``k`` changed by a small step inside its bounds, and the step."""
    p, theta = active.effect.parameters[k], np.array(active.theta)
    h = 1e-2 * abs(theta[k]) if p.unit == "N/m" and theta[k] else step_of(p)
    h = -h if theta[k] + h > p.high else h
    theta[k] += h
    return active.with_theta(theta), h


@dataclass(frozen=True)
class _Forces:
    """Predicts mesh forces of a run, in units of their noise."""

    case: FusedRun

    def values(
        self, explanation: ExplanationAtFit, law: ForceLaw, actives: Sequence[Active]
    ) -> Array:
        """Forces (k,) of the usable meshes with effects."""
        return self._white(expected_forces(self.case, explanation.factors, actives, law))

    def tolerances(self, explanation: ExplanationAtFit, law: ForceLaw) -> list[Array]:
        """Derivatives (k,) with respect to the six factors on k, c and e."""
        columns = calibration_columns(self.case.run, law, explanation.factors)
        return [self._white(part) for column in columns for part in _of_kinds(column)]

    def bounds(self, explanation: ExplanationAtFit) -> tuple[Array, Array]:
        """Bounds (6,) of the changes of the six factors."""
        return 1.0 - BOUNDS - explanation.factors, 1.0 + BOUNDS - explanation.factors

    def _white(self, force: Array) -> Array:
        c = self.case
        return np.where(c.usable, np.nan_to_num(force / c.floor), 0.0)[:, c.usable].ravel()


@dataclass(frozen=True)
class _Bodies:
    """Predicts accelerations of the m coordinates of a run, in units of their noise.

    Attributes:
        case: the run.
        balance: its torque balance.
        through: (m, n_bodies) accelerations per body torque (over base radius) [1/kg].
        of_force: (m, n_mesh) accelerations per mesh force [1/kg].
        width: standard deviation of the window [mesh cycles].
        motion: whether forces are not measured, so that those of the law are used.
    """

    case: FusedRun
    balance: Balance
    through: Array
    of_force: Array
    width: float
    motion: bool

    def values(
        self, explanation: ExplanationAtFit, law: ForceLaw, actives: Sequence[Active]
    ) -> Array:
        """Accelerations (k,) by effects, and by the forces of the law where none are measured."""
        force, torque = effect_contributions(self.case, explanation.factors, law, actives)
        acceleration = torque @ self.through.T
        if self.motion:
            acceleration = acceleration + (law.modelled_n + force) @ self.of_force.T
        return self._white(self._average(acceleration))

    def tolerances(self, explanation: ExplanationAtFit, law: ForceLaw) -> list[Array]:
        """Derivatives (k,) with respect to the factors on inertias and, by ``motion``, the law."""
        columns = [self._white(part) for part in self.balance.parts]
        if self.motion:
            for column in calibration_columns(self.case.run, law, explanation.factors):
                parts = [part @ self.of_force.T for part in _of_kinds(column)]
                columns += [self._white(self._average(part)) for part in parts]
        return columns

    def bounds(self, explanation: ExplanationAtFit) -> tuple[Array, Array]:
        """Bounds of the changes of the factors of ``tolerances``."""
        of_law = 1.0 - explanation.factors if self.motion else np.zeros(0)
        middle = np.concatenate([1.0 - explanation.inverse, of_law])
        half = np.concatenate([np.full(3, HEAVIEST - 1.0), BOUNDS[: len(of_law)]])
        return middle - half, middle + half

    def _average(self, values: Array) -> Array:
        return np.asarray(window_of(self.case.run, self.width).average(values))

    def _white(self, values: Array) -> Array:
        return np.asarray(values / self.balance.sigma).ravel()


def _bodies(case: FusedRun, explanation: ExplanationAtFit, motion: bool) -> _Bodies:
    """Predictor of accelerations for a run, linearised at the calibration of an explanation."""
    run, model = case.run, case.run.model
    through = forces_to_coordinates(model)
    of_force = np.tensordot(explanation.inverse, inertia_parts(model), axes=1)
    if not motion:
        balance = torque_balance(run, case.fused)
        return _Bodies(case, balance, through, of_force, BALANCE_WIDTH, False)
    noise = fused_noise(run, np.random.default_rng(SEED))
    balance = motion_balance(run, case.fused, noise, explanation.factors, explanation.inverse)
    law = force_law(run, case.fused, explanation.factors)
    return _Bodies(with_law_forces(case, law), balance, through, of_force, MOTION_WIDTH, True)


def _of_kinds(column: Array) -> tuple[Array, Array]:
    """Two copies of a column (n, n_mesh): zero but on sun meshes, zero but on ring meshes."""
    first = np.arange(column.shape[1]) < column.shape[1] // 2
    return np.where(first, column, 0.0), np.where(first, 0.0, column)
