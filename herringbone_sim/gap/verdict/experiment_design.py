"""Design of the next experiment: the operating point that best separates the explanations.

Two explanations that fit the same runs equally well may differ at another operating point. For
candidate points the motion of the calibrated gear is simulated; there the forces of one
explanation are compared with those of the other after its best fit to the fit runs and the new
run together. The point with the largest remaining difference, in units of the noise, is chosen.
The fit runs have to be included: two effects that differ only in their dependence on temperature
can't be separated by one run at a single temperature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import permutations
from operator import add

import numpy as np

from herringbone_sim.errors import ParameterError
from herringbone_sim.gap.attribution.effect_forces import FusedRun
from herringbone_sim.gap.attribution.effect_torques import balance_measured
from herringbone_sim.gap.calibrated_fit import Calibrated
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.verdict.augmented import Augmented, parameters_of
from herringbone_sim.gap.verdict.candidate_points import (
    PredictedRun,
    candidate_points,
    predict_run,
)
from herringbone_sim.gap.verdict.decide import NamedExplanation, Verdict
from herringbone_sim.gap.verdict.discrimination import (
    BALANCE,
    FORCES,
    MOTION,
    ExplanationAtFit,
    Separation,
    linear_predictions,
    separation,
)

MOST_FORCE = 2.0  # limit of the largest mesh force at a designed point over that in the fit runs


@dataclass(frozen=True)
class Design:
    """The operating point at which the explanations differ most.

    Attributes:
        names: of the explanations, as texts.
        point: delta_T [K], K, T_1 [N m], Omega.
        separation_at_point, separation_so_far: RMS difference over the noise, at the point and in
            the fit runs, of the two explanations that the point separates least.
        separated_so_far: whether the fit runs alone separate all explanations.
        separated_with_point: whether the fit runs and a run at the point separate all.
        force_ratio: largest mesh force at the point over that in the fit runs.
    """

    names: tuple[str, ...]
    point: dict[str, float]
    separation_at_point: float
    separation_so_far: float
    separated_so_far: bool = False
    separated_with_point: bool = False
    force_ratio: float = 1.0


def leading_explanations(verdict: Verdict) -> tuple[NamedExplanation, ...]:
    """Explanations to separate: an ambiguous class, or the chosen one and the runner-up.

    Empty where no effect is chosen, or there is no other to separate it from.
    """
    if verdict.verdict in ("none", "unknown") or verdict.chosen is None:
        return ()
    if verdict.ambiguous_with:
        return tuple(verdict.best[n][0] for n in verdict.ambiguous_with if n in verdict.best)
    return () if verdict.runner_up is None else (verdict.chosen, verdict.runner_up)


def design(
    campaign: PreparedCampaign, calibrated: Calibrated, verdict: Verdict, model: Augmented
) -> Design | None:
    """Choose the candidate point that best separates the leading explanations of a verdict.

    Args:
        campaign: whose fit runs the verdict rests on.
        calibrated: fit runs and calibration.
        verdict: of the campaign.
        model: augmented model, of which only the calibration is used.

    Returns:
        The design; None with fewer than two explanations, where they can't be predicted, or where
        no candidate can be simulated with mesh forces below ``MOST_FORCE``.
    """
    explanations = leading_explanations(verdict)
    quantity = _predictable_quantity(calibrated, verdict, explanations)
    if len(explanations) < 2 or quantity is None:
        return None
    model = replace(model, actives=())
    try:
        gear = parameters_of(campaign.nominal, model)
    except ParameterError:
        return None
    fitted = [ExplanationAtFit(e.actives, model.factors, model.inverse) for e in explanations]
    cases = [c for c in calibrated.cases if quantity != BALANCE or balance_measured((c,))]
    points = candidate_points([run.point for run in campaign.of_role("fit")])
    runs = (predict_run(cases, campaign.nominal, gear, model.factors, point) for point in points)
    most = max(_largest_force(c) for c in cases)
    safe = [run for run in runs if run is not None and run.peak_n < MOST_FORCE * most]
    if not safe:
        return None
    by_run = [_separations(c, fitted, quantity) for c in cases]
    so_far = [reduce(add, of_pair) for of_pair in zip(*by_run, strict=True)]
    tested = [(run, _separations(run.case, fitted, quantity)) for run in safe]
    designed = [
        _designed(fitted, so_far, run, at_point, len(cases), most)
        for run, at_point in tested
        if all(s.finite and s.count > 0 for s in (*so_far, *at_point))
    ]
    return max(designed, key=lambda d: d.separation_at_point, default=None)


def _predictable_quantity(
    calibrated: Calibrated, verdict: Verdict, explanations: Sequence[NamedExplanation]
) -> str | None:
    """``FORCES``, ``BALANCE`` or ``MOTION``: how to predict the explanations; None: impossible."""
    actives = [a for e in explanations for a in e.actives]
    no_sensor = all(a.effect.level != "sensor" for a in actives)
    forces = all(bool(np.isfinite(c.run.F.values).all()) for c in calibrated.cases)
    if not forces:
        return MOTION if no_sensor and verdict.metric == "torque_balance" else None
    if verdict.metric == "force_law":
        channels = [n for a in actives for n in dict(a.options).get("channels", ())]
        return FORCES if all(n.startswith("F") for n in channels) else None
    whole = any(balance_measured((c,)) for c in calibrated.cases)
    return BALANCE if no_sensor and whole and verdict.metric == "torque_balance" else None


def _separations(
    case: FusedRun, explanations: Sequence[ExplanationAtFit], quantity: str
) -> list[Separation]:
    """Separation by one run, for each ordered pair of explanations (target, fitted)."""
    predictions = linear_predictions(case, explanations, quantity)
    return [separation(target, fitted) for target, fitted in permutations(predictions, 2)]


def _designed(
    explanations: Sequence[ExplanationAtFit],
    so_far: Sequence[Separation],
    run: PredictedRun,
    at_point: Sequence[Separation],
    n_runs: int,
    most: float,
) -> Design:
    """The design with one candidate point, for a new run as long as the mean of the fit runs.

    Args:
        explanations: to separate.
        so_far: separation of each pair by the fit runs.
        run: predicted run at the point.
        at_point: separation of each pair by the predicted run.
        n_runs: number of fit runs.
        most: largest mesh force in the fit runs [N].
    """
    pairs = []
    for before, new in zip(so_far, at_point, strict=True):
        new = new.times(before.count / n_runs / new.count)
        both = before + new
        old, least = before.least, both.least
        by_point = np.sqrt(max(least - old, 0.0) / new.count)
        by_runs = np.sqrt(old / before.count)
        separated = least / both.count > _chance(both.count)
        pairs.append((float(by_point), float(by_runs), separated))
    by_point, by_runs, _ = min(pairs)
    return Design(
        names=tuple(explanation.name for explanation in explanations),
        point=run.point,
        separation_at_point=by_point,
        separation_so_far=by_runs,
        separated_so_far=all(s**2 > _chance(so_far[0].count) for _, s, _ in pairs),
        separated_with_point=all(separated for _, _, separated in pairs),
        force_ratio=run.peak_n / most,
    )


def _chance(count: float) -> float:
    """Excess over 1 of the mean square of ``count`` noise values; exceeded once in a thousand."""
    return float(3.1 * np.sqrt(2.0 / count))


def _largest_force(case: FusedRun) -> float:
    """Largest absolute mesh force [N] of a run; that of the force law where none is measured."""
    force = case.run.F.values
    if not np.isfinite(force).any():
        force = force_law(case.run, case.fused, np.ones(6)).modelled_n
    return float(np.nanmax(np.abs(force)))
