"""Rank hypotheses by a linear screen, and fit the best: single effects, and pairs of effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.diagnosis.search import CHANCE_CHI2, MIN_GAIN_PER_VALUE, Search, amplitudes

# Limits of the search, chosen for run time:
MAX_SCREENED_PER_EFFECT = 6  # places of an effect scored linearly by leave-one-run-out
MAX_FITTED = 6  # single effects fitted exactly
MAX_FITTED_PER_EFFECT = 2  # single effects fitted exactly with the same id
MAX_FITTED_PAIRS = 3  # second effects fitted exactly
MAX_PAIRS_OF_SINGLES = 2  # second effects fitted from their values in the fit of them alone
MIN_FITTED = 2  # single effects fitted where the gap is too small to explain
# Decisions, chosen, not fitted:
EQUIVALENT_SHARE = 0.01  # fraction of the gap by which explanations may differ and count as equal
# Chi2 per value (noise: 1) above which a linear fit is not trusted, and a fit lacks an effect.
NONLINEAR_CHI2 = 1.5

Ranking = list[tuple[float, Hypothesis, Array]]  # loss, hypothesis, start of its fit


@dataclass(frozen=True)
class FittedExplanation:
    """An explanation (no effect, a single effect or a pair) with its fit.

    Attributes:
        hypotheses: none, one or two.
        score: of the fit.
        search: search whose machine has the functions of a pair; None: that of single effects.
    """

    hypotheses: tuple[Hypothesis, ...]
    score: Score
    search: Search | None = None

    @property
    def effects(self) -> tuple[str, ...]:
        """Ids of the effects."""
        return tuple(h.effect for h in self.hypotheses)

    @property
    def loss(self) -> float:
        """Leave-one-run-out loss, see ``Score.loss``."""
        return self.score.loss


def simplest_equivalent(
    none: FittedExplanation, singles: Sequence[FittedExplanation]
) -> FittedExplanation:
    """Of the single effects about as good as the best, return that with fewest coefficients."""
    best = singles[0].loss
    near = [f for f in singles if f.loss - best < EQUIVALENT_SHARE * (none.loss - best)]
    return min(near, key=lambda f: len(f.score.coefficients), default=singles[0])


def rank(
    search: Search, catalogue: Sequence[Hypothesis], taken: Score | None
) -> tuple[Search, Ranking]:
    """Rank the catalogue and the machine's proposals by linear scores, added to a fit.

    Of each effect only the best places (``MAX_SCREENED_PER_EFFECT``) are ranked, but all that are
    present or absent, whose response may be far from linear. Where even the best linear fit leaves
    too much, nonlinear trials come first.

    Args:
        taken: fit to which a hypothesis is added, as the base; None: the fit of ``search.null``.

    Returns:
        Search with the functions of the proposals, and the ranking, best first.
    """
    known = search.null if taken is None else taken
    made = amplitudes(known.coefficients, known.mean, search.runs, search.rows)
    machine, proposed = search.machine.proposals(made, known)
    search = search.onwards(machine, taken)
    quick = sorted(((search.quick(one.coefficients), i) for i, one in enumerate(catalogue)))
    chosen: list[Hypothesis] = []
    per: dict[str, int] = {}
    for _, i in quick:
        one = catalogue[i]
        if per.get(one.effect, 0) < MAX_SCREENED_PER_EFFECT or not one.vanishes_at_zero:
            per[one.effect] = per.get(one.effect, 0) + 1
            chosen.append(one)
    found: Ranking = []
    for one in (*chosen, *proposed):
        score = search.screened(one.coefficients, 0.3)
        left, start = score.loss, score.mean
        if one.measured_gain is not None:
            left = search.null.loss - one.measured_gain
            start = np.array([*one.base_mean, *(c.center for c in one.coefficients)])
        found.append((left, one, start))
    found.sort(key=lambda f: f[0])
    if found and found[0][0] > NONLINEAR_CHI2 * search.null.count:
        tried = search.machine.nonlinear_trials(
            [(one, start) for _, one, start in found], search.null
        )
        known_better = {id(one) for _, one, _ in tried}
        rest = [f for f in found if id(f[1]) not in known_better]
        found = [*tried, *(rest[:MIN_FITTED] if tried else rest)]
    return search, found


def fit_best(
    search: Search, ranked: Ranking, most: int, per_effect: int
) -> tuple[FittedExplanation, ...]:
    """Fit the best ranked hypotheses exactly, best first: ``most`` in all, ``per_effect`` of each.

    Partly screened hypotheses of an effect are counted apart, as the part that the screen misses
    may be why they are ranked behind its others.
    """
    fits: list[FittedExplanation] = []
    per: dict[tuple[str, bool], int] = {}
    for _, one, start in ranked:
        if len(fits) == most:
            break
        family = (one.effect, one.partly_screened)
        if per.get(family, 0) < per_effect:
            per[family] = per.get(family, 0) + 1
            fits.append(_fitted(search, one, start))
    return tuple(sorted(fits, key=lambda f: f.loss))


def _fitted(search: Search, one: Hypothesis, start: Array) -> FittedExplanation:
    """Fit one effect exactly from ``start`` (p,).

    A fit that leaves more chi2 than ``search.null`` is in a wrong minimum: it is made again from
    zero size, except for effects that are present or absent (``vanishes_at_zero``).
    """
    score = search.settled(search.refined(one.coefficients, start))
    astray = score.in_sample > search.null.in_sample + CHANCE_CHI2
    if astray and one.vanishes_at_zero:
        base = np.concatenate([search.null.mean, np.zeros(len(one.coefficients))])
        again = search.settled(search.refined(one.coefficients, base))
        score = min(score, again, key=lambda s: s.in_sample)
    return FittedExplanation((one,), score)


def with_unscreened(
    search: Search, ranked: Ranking, singles: Sequence[FittedExplanation]
) -> tuple[FittedExplanation, ...]:
    """Add fits of hypotheses that the linear screen can't rank; return all, best first.

    These are the best place of each nonlinear effect that has no fit yet, and the other law of the
    best effect at its place, from the tolerances of that fit, unless its present fit is better.
    """
    effects = {f.hypotheses[0].effect for f in singles}
    found = list(singles)
    for _, one, start in ranked:
        if one.effect not in effects and not one.is_linear:
            effects.add(one.effect)
            found.append(_fitted(search, one, start))
    if not found:
        return ()
    best = min(found, key=lambda f: f.loss)
    own, n = best.hypotheses[0], len(search.base)
    for _, one, start in ranked:
        alike = (one.effect, one.locus) == (own.effect, own.locus)
        if alike and one.law != own.law:
            again = _fitted(search, one, np.concatenate([best.score.mean[:n], start[n:]]))
            before = next((f for f in found if f.hypotheses[0] is one), again)
            found = [f for f in found if f is not before]
            found.append(min(before, again, key=lambda f: f.loss))
    return tuple(sorted(found, key=lambda f: f.loss))


def fit_again(search: Search, found: FittedExplanation) -> FittedExplanation:
    """Fit an explanation again from its solution; return the fit with the smaller loss.

    States of motion found since, under another explanation, may lead out of a wrong minimum.
    """
    again = replace(found, score=search.settled(found.score))
    return min(found, again, key=lambda f: f.loss)


def fit_pairs(
    search: Search,
    catalogue: Sequence[Hypothesis],
    first: FittedExplanation,
    least: float,
    singles: Sequence[FittedExplanation],
) -> tuple[FittedExplanation, ...]:
    """Fit pairs: a single effect with each of the effects that best explain its residual.

    Where all of these leave more than noise, the first effect may have absorbed the response of
    the second: then it is paired also with effects of ``singles``, from their values there.

    Args:
        first: fit of the first effect alone.
        least: loss by which the linear screen must improve for a pair to be fitted; 0: no limit.
        singles: effects fitted alone, best first.

    Returns:
        Fitted pairs, best first.
    """
    own = first.hypotheses[0]
    others = [h for h in catalogue if (h.effect, h.locus) != (own.effect, own.locus)]
    then, ranked = rank(search, others, first.score)
    most = first.loss - least if least else np.inf
    different = [r for r in ranked if r[1].effect != own.effect and r[0] < most]
    fits = fit_best(then, different, MAX_FITTED_PAIRS, 1)
    enough = (1.0 + MIN_GAIN_PER_VALUE) * first.score.count
    if fits and all(f.score.in_sample > enough for f in fits):
        fits = (*fits, *_beside_singles(then, own, singles, fits))
    found = (FittedExplanation((own, *f.hypotheses), f.score, then) for f in fits)
    return tuple(sorted(found, key=lambda f: f.loss))


def _beside_singles(
    search: Search,
    own: Hypothesis,
    singles: Sequence[FittedExplanation],
    tried: Sequence[FittedExplanation],
) -> list[FittedExplanation]:
    """Fit at most ``MAX_PAIRS_OF_SINGLES`` untried singles beside ``own``, the search's base."""
    seen = {_key(f.hypotheses[0]) for f in tried}
    effects = {own.effect}
    found: list[FittedExplanation] = []
    for f in singles:
        one = f.hypotheses[0]
        if one.effect in effects or one.source is not None or _key(one) in seen:
            continue
        effects.add(one.effect)
        alone = f.score.mean[-len(one.coefficients) :]
        found.append(_fitted(search, one, np.concatenate([search.null.mean, alone])))
        if len(found) == MAX_PAIRS_OF_SINGLES:
            break
    return found


def without_duplicates(fits: Sequence[FittedExplanation]) -> tuple[FittedExplanation, ...]:
    """Keep, of fits with the same hypotheses, that with the least loss; return fits best first."""
    found: dict[frozenset[Any], FittedExplanation] = {}
    for f in sorted(fits, key=lambda f: f.loss):
        found.setdefault(frozenset(map(_key, f.hypotheses)), f)
    return tuple(found.values())


def _key(one: Hypothesis) -> tuple[str, Any, Any]:
    """Effect, options and locus, which identify a hypothesis."""
    return one.effect, one.options, one.locus


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
    one = pair.hypotheses[1]
    for f in singles:
        if _key(f.hypotheses[0]) == _key(one):
            return f
    start = np.concatenate([search.null.mean, pair.score.mean[-len(one.coefficients) :]])
    return FittedExplanation((one,), search.settled(search.refined(one.coefficients, start)))


def fit_rivals_of_first(
    search: Search,
    second: FittedExplanation,
    singles: Sequence[FittedExplanation],
    pairs: Sequence[FittedExplanation],
) -> tuple[FittedExplanation, ...]:
    """Fit pairs of the second effect of a pair with single effects it was not yet paired with.

    The first effect of the pair was the best one only as long as the second was not in the model.
    """
    own = second.hypotheses[0]
    tried = {h.effect for f in pairs for h in f.hypotheses if own.effect in f.effects}
    others = [f for f in singles if f.hypotheses[0].effect not in tried]
    then = search.onwards(search.machine, second.score)
    fits = _beside_singles(then, own, others, ())
    return tuple(FittedExplanation((own, *f.hypotheses), f.score, then) for f in fits)
