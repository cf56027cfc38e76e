"""Fit pairs of effects: screened together, or the best on the residual of a first one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.fits import (
    FittedExplanation,
    Ranking,
    fit_best,
    fit_effects,
    rank,
    scores_in_parallel,
    screen_all,
)
from herringbone_sim.diagnosis.machine import Hypothesis, with_slices
from herringbone_sim.diagnosis.parallel import forked_map
from herringbone_sim.diagnosis.search import MIN_GAIN_PER_VALUE, Search

# Limits of the search, chosen for run time:
MAX_FITTED_PAIRS = 3  # second effects fitted exactly
MAX_BESIDE_PART = 3  # effects fitted beside a moving part
MAX_PAIRS_OF_SINGLES = 2  # second effects fitted from their values in the fit of them alone
# Pairs scored by leave-one-run-out in the joint screen, and those of them fitted exactly.
MAX_SCREENED_JOINTLY, MAX_FITTED_JOINTLY = 300, 3

PairRanking = list[tuple[float, tuple[Hypothesis, Hypothesis], Array]]  # as ``Ranking``


def rank_jointly(search: Search, ranked: Ranking) -> PairRanking:
    """Rank pairs of different effects of a ranking by linear scores, best first.

    The best single effect need be in none of them: alone, it may absorb the responses of two
    others. Moving parts, which no linear score can rank, are left out.
    """
    linear = [hypothesis for _, hypothesis, _ in ranked if hypothesis.measured_gain is None]
    every = [(a, b) for a, b in combinations(linear, 2) if a.effect != b.effect]
    gains = forked_map(lambda ab: search.quick((*ab[0].coefficients, *ab[1].coefficients)), every)
    best = [every[i] for i in np.argsort(gains, kind="stable")[:MAX_SCREENED_JOINTLY]]
    scores = screen_all(search, [(*a.coefficients, *b.coefficients) for a, b in best])
    ranking = [(loss, pair, mean) for pair, (loss, mean) in zip(best, scores, strict=True)]
    return sorted(ranking, key=lambda f: f[0])


def fit_jointly(
    search: Search, ranked: PairRanking, limit: float
) -> tuple[FittedExplanation, ...]:
    """Fit the best pairs whose linear loss is below a limit, each set of effects once.

    Fits that leave more than ``search.null`` are in a wrong minimum and left out.
    """
    best: dict[frozenset[str], tuple[tuple[Hypothesis, Hypothesis], Array]] = {}
    for loss, (a, b), start in ranked:
        if loss < limit:
            best.setdefault(frozenset((a.effect, b.effect)), ((a, b), start))
    chosen = [
        ((a, b), (*a.coefficients, *b.coefficients), start)
        for (a, b), start in list(best.values())[:MAX_FITTED_JOINTLY]
    ]
    scores = scores_in_parallel(
        search, lambda own, given: own.settled(own.refined(given[1], given[2])), chosen
    )
    fits = [
        FittedExplanation(pair, replace(score, coefficients=(*search.base, *coefficients)))
        for (pair, coefficients, _), score in zip(chosen, scores, strict=True)
    ]
    usable = [f for f in fits if f.score.in_sample <= search.null.in_sample]
    return tuple(sorted(usable, key=lambda f: f.loss))


def fit_pairs(
    search: Search,
    catalogue: Sequence[Hypothesis],
    first: FittedExplanation,
    least: float,
    singles: Sequence[FittedExplanation],
) -> tuple[FittedExplanation, ...]:
    """Fit pairs: ``first`` with each of the other effects that best explain its residual.

    Both are fitted together. If all of these pairs leave more than noise, the first effect may
    have absorbed the response of the second: then it is paired with effects of ``singles`` too,
    each from its values when fitted alone.

    Args:
        first: fit of the first effect alone.
        least: how far below the loss of ``first`` the linear screen must put a pair that is to be
            fitted; 0: no limit.
        singles: effects fitted alone, best first.

    Returns:
        Fitted pairs, best first.
    """
    first_hypothesis = first.hypotheses[0]
    others = [
        h
        for h in catalogue
        if (h.effect, h.locus) != (first_hypothesis.effect, first_hypothesis.locus)
    ]
    search_with_first, ranked = rank(search, others, first.score)
    loss_limit = first.loss - least if least else np.inf
    different = [r for r in ranked if r[1].effect != first_hypothesis.effect and r[0] < loss_limit]
    fits = fit_best(search_with_first, different, MAX_FITTED_PAIRS, 1)
    enough = (1.0 + MIN_GAIN_PER_VALUE) * first.score.count
    if fits and all(f.score.in_sample > enough for f in fits):
        fits = (*fits, *_beside_singles(search_with_first, first_hypothesis, singles, fits))
    pairs = (
        FittedExplanation((first_hypothesis, *f.hypotheses), f.score, search_with_first)
        for f in fits
    )
    return tuple(sorted(pairs, key=lambda f: f.loss))


def _beside_singles(
    search: Search,
    base_hypothesis: Hypothesis,
    singles: Sequence[FittedExplanation],
    tried: Sequence[FittedExplanation],
) -> list[FittedExplanation]:
    """Fit at most ``MAX_PAIRS_OF_SINGLES`` untried singles beside the hypothesis of the base."""
    seen = {_key(f.hypotheses[0]) for f in tried}
    effects = {base_hypothesis.effect}
    starts: list[tuple[Hypothesis, Array]] = []
    for f in singles:
        hypothesis = f.hypotheses[0]
        if (
            hypothesis.effect in effects
            or hypothesis.source is not None
            or _key(hypothesis) in seen
        ):
            continue
        effects.add(hypothesis.effect)
        alone = f.score.mean[-len(hypothesis.coefficients) :]
        starts.append((hypothesis, np.concatenate([search.null.mean, alone])))
        if len(starts) == MAX_PAIRS_OF_SINGLES:
            break
    return fit_effects(search, starts)


def without_duplicates(fits: Sequence[FittedExplanation]) -> tuple[FittedExplanation, ...]:
    """Keep, of fits with the same hypotheses, that with the least loss; return fits best first."""
    unique: dict[frozenset[Any], FittedExplanation] = {}
    for f in sorted(fits, key=lambda f: f.loss):
        unique.setdefault(frozenset(map(_key, f.hypotheses)), f)
    return tuple(unique.values())


def _key(hypothesis: Hypothesis) -> tuple[str, Any, Any]:
    """Effect, options and locus, which identify a hypothesis."""
    return hypothesis.effect, hypothesis.options, hypothesis.locus


def refit_first_alone(
    search: Search, first: FittedExplanation, pair: FittedExplanation
) -> FittedExplanation:
    """Fit the first effect of a pair alone again, from its values in the pair.

    Its earlier fit alone may have ended in a wrong minimum, which made the pair look better.
    """
    every = first.score.coefficients
    score = search.refined(every[len(search.base) :], pair.score.mean[: len(every)])
    return FittedExplanation(first.hypotheses, search.settled(score))


def refit_second_alone(
    search: Search, singles: Sequence[FittedExplanation], pairs: Sequence[FittedExplanation]
) -> FittedExplanation | None:
    """Fit the second effect of the best pair alone: the screen for single effects may miss it.

    Pairs whose second effect was proposed from the residual of the first, on which its functions
    depend, are passed over; None if there is no other. A fit among ``singles`` is returned as is.
    """
    pair = next((f for f in pairs if f.hypotheses[1].source is None), None)
    if pair is None:
        return None
    second = pair.hypotheses[1]
    for f in singles:
        if _key(f.hypotheses[0]) == _key(second):
            return f
    start = np.concatenate([search.null.mean, pair.score.mean[-len(second.coefficients) :]])
    return FittedExplanation((second,), search.settled(search.refined(second.coefficients, start)))


def with_each_alone(
    search: Search, pairs: Sequence[FittedExplanation], singles: Sequence[FittedExplanation]
) -> tuple[FittedExplanation, ...]:
    """Fit each effect of pairs alone, from its values in the pair.

    Effects that ``singles`` has with the same options and place are not fitted again.

    Returns:
        ``singles`` and the new fits of single effects, best first, without the pairs.
    """
    starts: list[tuple[Hypothesis, Array]] = []
    known = {_key(f.hypotheses[0]) for f in singles}
    for pair in pairs:
        for hypothesis, own in with_slices(pair.hypotheses, len(pair.score.mean)):
            if _key(hypothesis) not in known:
                known.add(_key(hypothesis))
                start = np.concatenate([search.null.mean, pair.score.mean[own]])
                starts.append((hypothesis, start))
    return tuple(sorted((*singles, *fit_effects(search, starts)), key=lambda f: f.loss))


def fit_rivals_of_first(
    search: Search,
    second: FittedExplanation,
    singles: Sequence[FittedExplanation],
    pairs: Sequence[FittedExplanation],
) -> tuple[FittedExplanation, ...]:
    """Fit pairs of the second effect of a pair with single effects it was not yet paired with.

    The first effect of the pair was the best one only as long as the second was not in the model.
    """
    second_hypothesis = second.hypotheses[0]
    tried = {
        h.effect for f in pairs for h in f.hypotheses if second_hypothesis.effect in f.effects
    }
    others = [f for f in singles if f.hypotheses[0].effect not in tried]
    search_with_second = search.onwards(search.machine, second.score)
    fits = _beside_singles(search_with_second, second_hypothesis, others, ())
    return tuple(
        FittedExplanation((second_hypothesis, *f.hypotheses), f.score, search_with_second)
        for f in fits
    )


def fit_beside_part(
    search: Search,
    part: FittedExplanation,
    pairs: Sequence[FittedExplanation],
    singles: Sequence[FittedExplanation],
) -> tuple[FittedExplanation, ...]:
    """Fit a moving part with one effect of each of some pairs: that which alone removes less.

    The part may cause what the other effect of a pair explains: no linear score ranks a moving
    part with a second effect.

    Args:
        part: fit of the moving part alone.
        pairs: fitted pairs, best first; ``MAX_BESIDE_PART`` different effects are taken.
        singles: fits of single effects, with those of the pairs.
    """
    alone = {_key(f.hypotheses[0]): f.loss for f in singles}
    search_with_part = search.onwards(search.machine, part.score)
    starts: dict[object, tuple[Hypothesis, Array]] = {}
    for pair in pairs:
        both = with_slices(pair.hypotheses, len(pair.score.mean))
        second, own = max(both, key=lambda one: alone.get(_key(one[0]), np.inf))
        if len(starts) < MAX_BESIDE_PART:
            start = np.concatenate([search_with_part.null.mean, pair.score.mean[own]])
            starts.setdefault(_key(second), (second, start))
    return tuple(
        FittedExplanation((*part.hypotheses, *f.hypotheses), f.score, search_with_part)
        for f in fit_effects(search_with_part, list(starts.values()))
    )
