"""Rank hypotheses by a linear screen, and fit the best single effects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import Coefficient, amplitudes
from herringbone_sim.diagnosis.machine import Hypothesis, Machine
from herringbone_sim.diagnosis.parallel import forked_map
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.diagnosis.search import CHANCE_CHI2, Search

# Limits of the search, chosen for run time:
MAX_SCREENED_PER_EFFECT = 6  # places of an effect scored linearly by leave-one-run-out
MAX_FITTED = 6  # single effects fitted exactly
MAX_FITTED_PER_EFFECT = 2  # single effects fitted exactly with the same id
# The same where even the best linear fit leaves too much, so that its order is a poor guide.
MAX_FITTED_FAR, MAX_FITTED_PER_EFFECT_FAR = 10, 4
MIN_FITTED = 2  # single effects fitted where the gap is too small to explain
# Decisions, chosen, not fitted:
# Fractions of the gap by which explanations may differ and count as equal, and within which the
# better one may come out worse until more is tried.
EQUIVALENT_SHARE, NEAR_SHARE = 0.01, 0.1
# Chi2 per value (noise: 1) above which a linear fit is not trusted, and a fit lacks an effect.
NONLINEAR_CHI2 = 1.5
SURE_SHARE = 0.5  # fraction of chi2 left below which an exchange of channels is no coincidence

A = TypeVar("A")
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
    near = near_best(none, singles, EQUIVALENT_SHARE)
    return min(near, key=lambda f: len(f.score.coefficients), default=singles[0])


def near_best(
    none: FittedExplanation, fits: Sequence[FittedExplanation], share: float
) -> list[FittedExplanation]:
    """Return the fits, best first, whose loss is near the least: by a fraction of the gap."""
    best = min((f.loss for f in fits), default=np.inf)
    near = [f for f in fits if f.loss - best < share * (none.loss - best)]
    return sorted(near, key=lambda f: f.loss)


def rank(
    search: Search, catalogue: Sequence[Hypothesis], base_fit: Score | None
) -> tuple[Search, Ranking]:
    """Rank hypotheses, each added to a fit, by the leave-one-run-out loss of a linear fit.

    Ranked are, of each effect, the ``MAX_SCREENED_PER_EFFECT`` hypotheses that remove most chi2 in
    a linear fit, all that are present or absent (swapped channels, moving parts), whose response
    may be far from linear, and all proposals of the machine. If the least loss exceeds
    ``NONLINEAR_CHI2`` per value, the hypotheses that nonlinear trials find are moved to the head,
    with the chi2 that the trial leaves in place of the loss.

    Args:
        base_fit: fit to which a hypothesis is added, as the base; None: that of ``search.null``.

    Returns:
        Search with the functions of the proposals, and the ranking, best first: loss, hypothesis
        and start values (p,), those of the base first.
    """
    known = search.null if base_fit is None else base_fit
    fitted_amplitudes = amplitudes(known.coefficients, known.mean, search.runs, search.rows)
    machine, proposed = search.machine.proposals(fitted_amplitudes, known)
    search = search.onwards(machine, base_fit)
    gains = forked_map(lambda hypothesis: search.quick(hypothesis.coefficients), catalogue)
    chosen: list[Hypothesis] = []
    per: dict[str, int] = {}
    for i in np.argsort(gains, kind="stable"):
        hypothesis = catalogue[i]
        few = per.get(hypothesis.effect, 0) < MAX_SCREENED_PER_EFFECT
        if few or not hypothesis.vanishes_at_zero:
            per[hypothesis.effect] = per.get(hypothesis.effect, 0) + 1
            chosen.append(hypothesis)
    ranking: Ranking = []
    every = (*chosen, *proposed)
    scores = screen_all(search, [hypothesis.coefficients for hypothesis in every])
    for hypothesis, (loss, start) in zip(every, scores, strict=True):
        if hypothesis.measured_gain is not None:
            loss = search.null.loss - hypothesis.measured_gain
            start = np.array([*hypothesis.base_mean, *(c.center for c in hypothesis.coefficients)])
        ranking.append((loss, hypothesis, start))
    ranking.sort(key=lambda f: f[0])
    if ranking and ranking[0][0] > NONLINEAR_CHI2 * search.null.count:
        given = [(hypothesis, start) for _, hypothesis, start in ranking]
        tried = search.machine.nonlinear_trials(given, search.null)
        known_better = {id(hypothesis) for _, hypothesis, _ in tried}
        ranking = [*tried, *(f for f in ranking if id(f[1]) not in known_better)]
    return search, ranking


def screen_all(search: Search, sets: Sequence[Sequence[Coefficient]]) -> list[tuple[float, Array]]:
    """Loss and mean (p,) of linear fits of sets of coefficients, see ``Search.screened``."""

    def of_set(coefficients: Sequence[Coefficient]) -> tuple[float, Array]:
        score = search.screened(coefficients, 0.3)
        return score.loss, score.mean

    return forked_map(of_set, sets)


def fit_best(
    search: Search,
    ranked: Ranking,
    max_fits: int,
    per_effect: int,
    fitted: Sequence[FittedExplanation] = (),
    nonlinear_too: bool = False,
) -> tuple[FittedExplanation, ...]:
    """Fit the best ranked hypotheses exactly: ``max_fits`` in all, ``per_effect`` of each effect.

    The fits are best first. Those of hypotheses in ``fitted`` are not made again.

    Partly screened hypotheses of an effect are counted apart, as the part that the screen misses
    may be why they are ranked behind its others.

    Args:
        nonlinear_too: whether to fit the best place of every other nonlinear effect, too, as the
            linear screen can't rank it.
    """
    made = {id(f.hypotheses[0]): f for f in fitted}
    chosen: list[tuple[Hypothesis, Array]] = []
    per: dict[tuple[str, bool], int] = {}
    for _, hypothesis, start in ranked:
        if len(chosen) == max_fits:
            break
        family = (hypothesis.effect, hypothesis.partly_screened)
        if per.get(family, 0) < per_effect:
            per[family] = per.get(family, 0) + 1
            chosen.append((hypothesis, start))
    effects = {hypothesis.effect for hypothesis, _ in chosen}
    for _, hypothesis, start in ranked if nonlinear_too else ():
        if hypothesis.effect not in effects and not hypothesis.is_linear:
            effects.add(hypothesis.effect)
            chosen.insert(0, (hypothesis, start))  # these fits are the longest
    known = [made[id(h)] for h, _ in chosen if id(h) in made]
    fits = fit_effects(search, [(h, start) for h, start in chosen if id(h) not in made])
    return tuple(sorted((*known, *fits), key=lambda f: f.loss))


def fit_effects(
    search: Search, starts: Sequence[tuple[Hypothesis, Array]]
) -> list[FittedExplanation]:
    """Fit effects exactly, side by side, each alone from its start (p,); see ``fit_effect``."""
    fits = scores_in_parallel(search, lambda own, given: fit_effect(own, *given).score, starts)
    return [
        FittedExplanation((h,), replace(score, coefficients=(*search.base, *h.coefficients)))
        for (h, _), score in zip(starts, fits, strict=True)
    ]


def scores_in_parallel(
    search: Search, score: Callable[[Search, A], Score], items: Sequence[A]
) -> list[Score]:
    """Scores of items, fitted in parallel processes, in their order.

    ``coefficients`` of the scores are empty, as they are slow to transfer between processes: the
    caller, who has them, puts them back. States fitted for one item are no starts for the others;
    see ``Machine.fitted_in_parallel``.

    Args:
        score: score of an item, by a search.
    """

    def by_machine(machine: Machine, item: A) -> Score:
        return replace(score(search.with_machine(machine), item), coefficients=())

    return search.machine.fitted_in_parallel(by_machine, items)


def fit_effect(search: Search, hypothesis: Hypothesis, start: Array) -> FittedExplanation:
    """Fit one effect exactly from ``start`` (p,).

    A fit that leaves more chi2 than ``search.null`` is in a wrong minimum: it is made again from
    zero size, except for effects that are present or absent (``vanishes_at_zero``).
    """
    score = search.settled(search.refined(hypothesis.coefficients, start))
    astray = score.in_sample > search.null.in_sample + CHANCE_CHI2
    if astray and hypothesis.vanishes_at_zero:
        base = np.concatenate([search.null.mean, np.zeros(len(hypothesis.coefficients))])
        again = search.settled(search.refined(hypothesis.coefficients, base))
        score = min(score, again, key=lambda s: s.in_sample)
    return FittedExplanation((hypothesis,), score)


def with_other_law(
    search: Search, ranked: Ranking, singles: Sequence[FittedExplanation]
) -> tuple[FittedExplanation, ...]:
    """Add the fit of the other law of the best effect at its place; return all, best first.

    It starts from the tolerances of the best effect; its present fit is kept if that is better.
    """
    if not singles:
        return ()
    fits = list(singles)
    best = min(fits, key=lambda f: f.loss)
    of_best, n = best.hypotheses[0], len(search.base)
    for _, hypothesis, start in ranked:
        alike = (hypothesis.effect, hypothesis.locus) == (of_best.effect, of_best.locus)
        if alike and hypothesis.law != of_best.law:
            start = np.concatenate([best.score.mean[:n], start[n:]])
            again = fit_effect(search, hypothesis, start)
            before = next((f for f in fits if f.hypotheses[0] is hypothesis), again)
            fits = [f for f in fits if f is not before]
            fits.append(min(before, again, key=lambda f: f.loss))
    return tuple(sorted(fits, key=lambda f: f.loss))
