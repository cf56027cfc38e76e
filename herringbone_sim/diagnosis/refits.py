"""Fit explanations again: moving parts with better parameters, others from better states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.diagnosis.coefficients import amplitudes
from herringbone_sim.diagnosis.fits import (
    NEAR_SHARE,
    NONLINEAR_CHI2,
    FittedExplanation,
    fit_effect,
    fit_effects,
    near_best,
    scores_in_parallel,
)
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.diagnosis.search import CHANCE_CHI2, Search

# Limits of the search, chosen for run time:
MAX_EFFECTS_ANEW = 2  # effects that are fitted from trials with new states
MAX_ANEW = 2  # fits of an effect from trials with new states
MAX_PART_SEARCHES = 3  # searches for better parameters of a moving part


def with_better_part(
    search: Search, singles: Sequence[FittedExplanation], most: float
) -> tuple[Search, tuple[FittedExplanation, ...]]:
    """Search better parameters of the best single effect if it is a moving part; fit it again.

    Repeated while that gains and the fit leaves more than ``most``: each search is linear in the
    states of the fit before it.

    Returns:
        Search with the functions of the better part, and the single effects, best first.
    """
    best, others = singles[0], singles[1:]
    for _ in range(MAX_PART_SEARCHES):
        (hypothesis,), score = best.hypotheses, best.score
        at = amplitudes(score.coefficients, score.mean, search.runs, search.rows)
        machine, better = search.machine.improved(hypothesis, at, score)
        if not better:
            break
        extended = search.with_machine(machine)
        starts = [
            (other, np.array([*other.base_mean, *(c.center for c in other.coefficients)]))
            for other in better
        ]
        fit = min(fit_effects(extended, starts), key=lambda f: f.loss)
        gained = best.loss - fit.loss
        if gained > CHANCE_CHI2:
            search, best = extended, fit
        too_much = best.score.in_sample - most
        if too_much <= 0.0 or gained < max(CHANCE_CHI2, NEAR_SHARE * too_much):
            break
    return search, tuple(sorted((best, *others), key=lambda f: f.loss))


def with_fits_anew(
    search: Search, singles: Sequence[FittedExplanation], most: float
) -> tuple[FittedExplanation, ...]:
    """Fit the best ``MAX_EFFECTS_ANEW`` effects anew, until one leaves at most ``most`` chi2."""
    fits = list(singles)
    effects: set[str] = set()
    for i, f in enumerate(singles):
        effect = f.hypotheses[0].effect
        if effect in effects or f.hypotheses[0].source is not None:
            continue
        effects.add(effect)
        fits[i] = fit_anew(search, f)
        if fits[i].score.in_sample <= most or len(effects) == MAX_EFFECTS_ANEW:
            break
    return tuple(sorted(fits, key=lambda f: f.loss))


def fit_anew(search: Search, explanation: FittedExplanation) -> FittedExplanation:
    """Fit a single effect again from the best of trials with new states, while that gains."""
    (hypothesis,) = explanation.hypotheses
    for _ in range(MAX_ANEW):
        start = search.machine.restarted_from_other_sizes(hypothesis, explanation.score)
        if start is None:
            break
        again = fit_effect(search, hypothesis, start)
        if explanation.loss - again.loss < CHANCE_CHI2:
            break
        explanation = again
    return explanation


def fit_again(
    search: Search, none: FittedExplanation, singles: Sequence[FittedExplanation]
) -> tuple[FittedExplanation, tuple[FittedExplanation, ...]]:
    """Fit explanations again, as states of motion found since may lead out of a wrong minimum.

    These are the fit without effects, effects that leave much, and those that are near the best,
    or would be with what others gain by it; but those whose states do not improve stay.

    Returns:
        The fit without effects and the single effects, best first; of each the better fit.
    """
    near = {id(f) for f in (*singles[:1], *near_best(none, singles, NEAR_SHARE))}
    much = [f.score.in_sample > NONLINEAR_CHI2 * f.score.count for f in singles]
    chosen = [none, *(f for f, far in zip(singles, much, strict=True) if far or id(f) in near)]
    fits = dict(zip(map(id, chosen), better_fits(search, chosen), strict=True))
    gained = max(f.loss - fits[id(f)].loss for f in chosen)
    least = min((fits.get(id(f), f).loss for f in singles), default=np.inf)
    late = [f for f in singles if id(f) not in fits and f.loss - gained < least + CHANCE_CHI2]
    fits |= dict(zip(map(id, late), better_fits(search, late), strict=True))
    again = (fits.get(id(f), f) for f in singles)
    return fits[id(none)], tuple(sorted(again, key=lambda f: f.loss))


def better_fits(
    search: Search, explanations: Sequence[FittedExplanation]
) -> list[FittedExplanation]:
    """Of each explanation, the better one of its fit and a fit from its solution.

    Explanations whose states do not improve are not fitted.
    """

    def again(own: Search, explanation: FittedExplanation) -> Score:
        known = explanation.score
        at = amplitudes(known.coefficients, known.mean, own.runs, own.rows)
        return own.refitted(known) if own.machine.states_improve(at) else known

    better = []
    scores = scores_in_parallel(search, again, explanations)
    for f, score in zip(explanations, scores, strict=True):
        fit = replace(f, score=replace(score, coefficients=f.score.coefficients))
        better.append(min(f, fit, key=lambda f: f.loss))
    return better
