"""Examine a campaign: score none, single effects and pairs; test what they leave unexplained.

Longer than 300 lines: the stages of the search stand together, in the order in which they run.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.flexible import Predictable, predict_residuals
from herringbone_sim.diagnosis.machine import Hypothesis, Machine
from herringbone_sim.diagnosis.products import residual_without_nuisance
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.diagnosis.search import (
    CHANCE_CHI2,
    MIN_GAIN_PER_VALUE,
    Search,
    amplitudes,
)
from herringbone_sim.diagnosis.threads import parallel_map

# Limits of the search, chosen for run time:
MAX_SCREENED_PER_EFFECT = 6  # places of an effect scored linearly by leave-one-run-out
MAX_FITTED = 6  # single effects fitted exactly
MAX_FITTED_PER_EFFECT = 2  # of them with the same effect
MAX_FITTED_PAIRS = 3  # second effects fitted exactly
MIN_FITTED = 2  # single effects fitted where nothing is worth explaining
# Decisions, chosen, not fitted:
EQUIVALENT_SHARE = 0.01  # share of the gap by which explanations may differ and count as equal
NOISE_QUANTILE = 0.25  # share of an observation's rows assumed to contain no more than noise
# Energy per value (noise: 1) above which a linear fit is not trusted, and a fit lacks an effect.
NONLINEAR_CHI2 = 1.5
BLOCK_CYCLES = 6.0  # mesh cycles of a cross-validation block, longer than the memory of a mesh


@dataclass(frozen=True)
class FittedExplanation:
    """None, a single effect or a pair, with its fit.

    Attributes:
        hypotheses: empty, one or two.
        score: of the fit.
        search: search whose machine has all functions of a pair; None: that of the single effects.
    """

    hypotheses: tuple[Hypothesis, ...]
    score: Score
    search: Search | None = None

    @property
    def loss(self) -> float:
        """What is left of all runs, each predicted from the others, see ``Score.loss``."""
        return self.score.loss


@dataclass(frozen=True)
class Examination:
    """Result of ``examine``.

    Attributes:
        count: number of whitened values.
        counts: the same by observation.
        none: the calibrated machine.
        singles, pairs: fitted explanations, best first.
        screened: least loss of each effect in the linear screen, fitted or not.
        flexible: predictable part of the residual by observation, under the keys ``none``,
            ``single`` (the best) and ``pair`` (the best).
        noise: (runs, R) factor on the assumed noise, by observation; empty if noise was known.
        machine: the given one, or the same with more values if those were used.
    """

    count: float
    counts: dict[str, float]
    none: FittedExplanation
    singles: tuple[FittedExplanation, ...]
    pairs: tuple[FittedExplanation, ...]
    screened: dict[str, float]
    flexible: dict[str, dict[str, Predictable]]
    noise: Mapping[str, Array]
    machine: Machine


def examine(
    machine: Machine, say: Callable[[str], None] = lambda text: None, noise_known: bool = True
) -> Examination:
    """Score every hypothesis on the runs of a machine.

    Args:
        machine: with its runs.
        say: called with the name of each stage.
        noise_known: whether the noise of the blocks is right; otherwise the unpredictable part of
            the calibrated machine's residual is counted as noise too.
    """
    say("calibration")
    search, none, left = _calibrated(machine, noise_known)
    if none.loss < NONLINEAR_CHI2 * none.score.count:
        larger = machine.with_more_values()
        if larger is not None:
            say("calibration by more values")
            machine = larger
            search, none, left = _calibrated(machine, noise_known, none.score.mean)
    catalogue = machine.hypotheses()
    say(f"{len(catalogue)} hypotheses")
    search, ranked = _rank(search, catalogue, None)
    counts = {
        o: float(sum(r[o].count[_recorded_rows(r[o].energy)].sum() for r in search.campaign.runs))
        for o in search.campaign.observations
    }
    count = sum(counts.values())
    say("fits")
    gain = none.loss - min((r[0] for r in ranked), default=none.loss)
    worth = CHANCE_CHI2 if machine.estimates_states else MIN_GAIN_PER_VALUE * count
    idle = gain < worth and _predicted_energy(left) < MIN_GAIN_PER_VALUE * count
    singles = _fit_best(search, ranked, MIN_FITTED if idle else MAX_FITTED, MAX_FITTED_PER_EFFECT)
    if machine.estimates_states:
        if not idle:
            singles = _with_unscreened(search, ranked, singles)
        again, *fitted = (_fit_again(search, f) for f in (none, *singles))
        singles = tuple(sorted(fitted, key=lambda f: f.loss))
        if again is not none:
            none, left = again, _predictable_remainder(search, again)
    say("what is left")
    flexible = {"none": left}
    pairs: tuple[FittedExplanation, ...] = ()
    if singles:
        first = _simplest_equivalent(none, singles)
        flexible["single"] = _predictable_remainder(search, singles[0], left)
        # Brief events such as a tooth contact are not predictable: judge by the fit, too.
        in_sample = first.score.in_sample
        lacks_one = (
            in_sample > NONLINEAR_CHI2 * count
            or _predicted_energy(flexible["single"]) > MIN_GAIN_PER_VALUE * count
        )
        more_than_noise = in_sample > (1.0 + MIN_GAIN_PER_VALUE) * count and not idle
        if lacks_one or more_than_noise:
            say("pairs")
            least = 0.0 if lacks_one else MIN_GAIN_PER_VALUE * count
            pairs = _fit_pairs(search, catalogue, first, least)
            if pairs:
                flexible["pair"] = _predictable_remainder(search, pairs[0], left)
                better = _refit_first_alone(search, first, pairs[0])
                if better.loss < first.loss:
                    others = [f for f in singles if f is not first]
                    first = better
                    singles = tuple(sorted((first, *others), key=lambda f: f.loss))
                    flexible["single"] = _predictable_remainder(search, singles[0], left)
            second = _refit_second_alone(search, singles, pairs)
            if second is not None and second.loss < singles[0].loss:
                singles = (second, *singles)
                flexible["single"] = _predictable_remainder(search, second, left)
            elif not (pairs and _first_was_misfitted(first, pairs[0], flexible)):
                second = None
            if (
                second is not None
                and _predicted_energy(flexible["pair"]) > MIN_GAIN_PER_VALUE * count
            ):
                more = _fit_pairs(search, catalogue, second, 0.0)
                pairs = tuple(sorted((*pairs, *more), key=lambda f: f.loss))
                flexible["pair"] = _predictable_remainder(search, pairs[0], left)
    screened: dict[str, float] = {}
    for value, one, _ in ranked:
        screened.setdefault(one.effect, value)
    return Examination(
        count, counts, none, singles, pairs, screened, flexible, search.noise, machine
    )


def _calibrated(
    machine: Machine, noise_known: bool, start: Array | None = None
) -> tuple[Search, FittedExplanation, dict[str, Predictable]]:
    """The fit without effects, and the predictable part of its residual, by observation.

    Args:
        noise_known: as in ``examine``.
        start: (p,) start values of the tolerances; None: zero.
    """
    search = Search(machine, start=start)
    none = FittedExplanation((), search.settled(search.null))
    left = _predictable_remainder(search, none)
    if not noise_known:
        noise = {o: _noise_factors(p) for o, p in left.items()}
        left = {o: p.with_noise_scaled(noise[o]) for o, p in left.items()}
        search = Search(machine, noise, none.score.mean)
        none = FittedExplanation((), search.settled(search.null))
    return search, none, left


def _noise_factors(found: Predictable) -> Array:
    """(runs, R) factor on the assumed noise, from unpredictable minus predictable energy.

    1 where half of the energy or more is predictable. Limited to the ``NOISE_QUANTILE`` of the
    observation's rows: sensors of a kind are alike, so an excess in few rows is not noise.
    """
    share = (2.0 * found.left - found.energy) / np.maximum(found.count, 1.0)
    most = np.ones((len(share), 1))
    for of_run, known, limit in zip(share, found.count > 0.0, most, strict=True):
        if known.any():
            limit[0] = np.quantile(of_run[known], NOISE_QUANTILE)
    return np.asarray(np.sqrt(np.clip(share, 1.0, np.maximum(most, 1.0))))


def _recorded_rows(energy: Array) -> NDArray[np.bool_]:
    """Rows (R,) that are formed: their energy is not exactly zero."""
    recorded: NDArray[np.bool_] = energy != 0.0
    return recorded


Ranking = list[tuple[float, Hypothesis, Array]]  # loss, hypothesis, start of its fit


def _simplest_equivalent(
    none: FittedExplanation, singles: Sequence[FittedExplanation]
) -> FittedExplanation:
    """Of the singles as good as the best (``EQUIVALENT_SHARE``), that of fewest coefficients."""
    best = singles[0].loss
    near = [f for f in singles if f.loss - best < EQUIVALENT_SHARE * (none.loss - best)]
    return min(near, key=lambda f: len(f.score.coefficients), default=singles[0])


def _predicted_energy(left: Mapping[str, Predictable]) -> float:
    """Predictable energy of all observations."""
    return sum(p.predicted for p in left.values())


def _rank(
    search: Search, catalogue: Sequence[Hypothesis], taken: Score | None
) -> tuple[Search, Ranking]:
    """Rank the catalogue and the machine's proposals by linear scores on top of a fit.

    Where even the best linear fit leaves too much, nonlinear trials come first.

    Args:
        taken: fit that is kept as the base; None: the calibrated machine.

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
        if per.get(one.effect, 0) < MAX_SCREENED_PER_EFFECT:
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


def _fit_best(
    search: Search, ranked: Ranking, most: int, per_effect: int
) -> tuple[FittedExplanation, ...]:
    """Fit the best hypotheses exactly, ``most`` in all and ``per_effect`` of an effect."""
    fits: list[FittedExplanation] = []
    per: dict[str, int] = {}
    for _, one, start in ranked:
        if len(fits) == most:
            break
        if per.get(one.effect, 0) < per_effect:
            per[one.effect] = per.get(one.effect, 0) + 1
            fits.append(_fitted(search, one, start))
    return tuple(sorted(fits, key=lambda f: f.loss))


def _fitted(search: Search, one: Hypothesis, start: Array) -> FittedExplanation:
    """Fit one effect exactly from ``start`` (p,)."""
    score = search.refined(one.coefficients, start)
    return FittedExplanation((one,), search.settled(score))


def _with_unscreened(
    search: Search, ranked: Ranking, singles: Sequence[FittedExplanation]
) -> tuple[FittedExplanation, ...]:
    """Add fits that the linear screen can't rank, best first.

    These are the best place of each effect that is not linear, and other laws (options) of the
    best effect at its place, from its tolerances.
    """
    fitted = {(f.hypotheses[0].effect, f.hypotheses[0].locus) for f in singles}
    effects = {effect for effect, _ in fitted}
    found = list(singles)
    for _, one, start in ranked:
        if one.effect not in effects and not one.is_linear:
            effects.add(one.effect)
            found.append(_fitted(search, one, start))
    best = min(found, key=lambda f: f.loss)
    own, n = best.hypotheses[0], len(search.base)
    for _, one, start in ranked:
        alike = (one.effect, one.locus) == (own.effect, own.locus)
        if alike and one.is_linear and one.options != own.options:
            from_best = np.concatenate([best.score.mean[:n], start[n:]])
            found.append(_fitted(search, one, from_best))
    return tuple(sorted(found, key=lambda f: f.loss))


def _fit_again(search: Search, found: FittedExplanation) -> FittedExplanation:
    """Fit an explanation again from where it settled, if that leaves less.

    States that were found under another one since may suit it too; without them it would seem to
    leave what a wrong minimum does.
    """
    again = replace(found, score=search.settled(found.score))
    return min(found, again, key=lambda f: f.loss)


def _fit_pairs(
    search: Search, catalogue: Sequence[Hypothesis], first: FittedExplanation, least: float
) -> tuple[FittedExplanation, ...]:
    """Fit pairs: a single effect with each of the best other effects on its residual.

    Args:
        least: loss by which the linear screen must improve for a pair to be fitted; 0: no limit.
    """
    own = first.hypotheses[0]
    others = [h for h in catalogue if (h.effect, h.locus) != (own.effect, own.locus)]
    then, ranked = _rank(search, others, first.score)
    most = first.loss - least if least else np.inf
    different = [r for r in ranked if r[1].effect != own.effect and r[0] < most]
    fits = _fit_best(then, different, MAX_FITTED_PAIRS, 1)
    return tuple(FittedExplanation((own, *f.hypotheses), f.score, then) for f in fits)


def _refit_first_alone(
    search: Search, first: FittedExplanation, pair: FittedExplanation
) -> FittedExplanation:
    """Fit the first effect of a pair on its own again, from its values in the pair.

    Alone it may have settled in a wrong minimum, and the pair got what that left.
    """
    every = first.score.coefficients
    score = search.refined(every[len(search.base) :], pair.score.mean[: len(every)])
    return FittedExplanation(first.hypotheses, search.settled(score))


def _refit_second_alone(
    search: Search, singles: Sequence[FittedExplanation], pairs: Sequence[FittedExplanation]
) -> FittedExplanation | None:
    """Fit the second effect of the best pair on its own.

    It may have been missed by the screen while the first effect was not in the model. None if
    there is no pair, or if the effect was proposed from the residual of the first one, on which
    its functions depend.
    """
    if not pairs:
        return None
    one = pairs[0].hypotheses[1]
    if one.source is not None:
        return None
    key = one.effect, one.options, one.locus
    for f in singles:
        if (f.hypotheses[0].effect, f.hypotheses[0].options, f.hypotheses[0].locus) == key:
            return f
    start = np.concatenate([search.null.mean, pairs[0].score.mean[-len(one.coefficients) :]])
    return FittedExplanation((one,), search.settled(search.refined(one.coefficients, start)))


def _first_was_misfitted(
    first: FittedExplanation,
    pair: FittedExplanation,
    left: Mapping[str, Mapping[str, Predictable]],
) -> bool:
    """Whether the second effect removes much and half of the residual is predictable still.

    Then the first effect, fitted alone, is probably the wrong partner of the second.
    """
    half = 0.5 * _predicted_energy(left["single"])
    return first.loss - pair.loss > half and _predicted_energy(left["pair"]) > half


def _predictable_remainder(
    search: Search, found: FittedExplanation, of_none: Mapping[str, Predictable] | None = None
) -> dict[str, Predictable]:
    """Predictable part of the residual of an explanation, by observation.

    Args:
        of_none: the same of the calibrated machine, reused for observations that the explanation
            does not change.
    """
    search = found.search or search
    machine = search.machine.without_linearisation()
    fine = copy.copy(search)
    fine.machine = machine
    every = found.score.coefficients
    made = amplitudes(every, found.score.mean, search.runs, search.rows)
    result = {}
    for o in machine.functions:
        if of_none is not None and o in of_none and o not in made:
            result[o] = of_none[o]
            continue
        blocks = fine.blocks(made, {}, (o,))
        if not all(o in b for b in blocks):
            continue
        own = [b[o] for b in blocks]
        numbers = []
        for r, b in enumerate(own):
            at = b.sample_index if b.sample_index is not None else np.arange(len(b.residual))
            numbers.append((machine.cycles(o, r)[at] // BLOCK_CYCLES).astype(int))
        result[o] = predict_residuals(
            parallel_map(residual_without_nuisance, own),
            [machine.regression_inputs(o, r, b) for r, b in enumerate(own)],
            numbers,
            own[0].independent_share,
        )
    return result
