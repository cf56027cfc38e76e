"""Examine a campaign: score none, single effects and pairs; test what they leave unexplained.

Over 300 lines: the order of the search stands in one function, with the helpers of it alone.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import amplitudes
from herringbone_sim.diagnosis.fits import (
    MAX_FITTED,
    MAX_FITTED_FAR,
    MAX_FITTED_PER_EFFECT,
    MAX_FITTED_PER_EFFECT_FAR,
    MIN_FITTED,
    NEAR_SHARE,
    NONLINEAR_CHI2,
    SURE_SHARE,
    FittedExplanation,
    Ranking,
    fit_best,
    fit_effect,
    near_best,
    rank,
    simplest_equivalent,
    with_other_law,
)
from herringbone_sim.diagnosis.flexible import Predictable, predict_residuals, predicted_chi2
from herringbone_sim.diagnosis.machine import Machine
from herringbone_sim.diagnosis.noise import OFFSET_SHARE, less_noise, noise_factors, offset_sds
from herringbone_sim.diagnosis.orders import in_best_orders
from herringbone_sim.diagnosis.pairs import (
    fit_beside_part,
    fit_jointly,
    fit_pairs,
    fit_rivals_of_first,
    rank_jointly,
    refit_first_alone,
    refit_second_alone,
    with_each_alone,
    without_duplicates,
)
from herringbone_sim.diagnosis.parallel import parallel_map
from herringbone_sim.diagnosis.products import Block, residual_without_nuisance
from herringbone_sim.diagnosis.refits import fit_again, with_better_part, with_fits_anew
from herringbone_sim.diagnosis.search import (
    MIN_GAIN_PER_VALUE,
    Search,
)

# Fraction of the gap that an effect must explain to be sought further; chosen for run time, below
# what the best single effect explains in any pair of the stored evidence.
WORTH_SEEKING = 0.25
BLOCK_CYCLES = 6.0  # mesh cycles of a cross-validation block, longer than the memory of a mesh


@dataclass(frozen=True)
class Examination:
    """Result of ``examine``.

    Attributes:
        count: number of whitened values.
        counts: number of whitened values, by observation.
        none: fit of the tolerances alone, without effects.
        singles, pairs: fitted explanations, best first; empty where none was fitted.
        screened: least loss of each ranked effect, by its id, whether it was fitted or not.
        flexible: predictable part of the residual of ``none``, of the best ``single`` and of the
            best ``pair``, by these keys and by observation.
        noise: (runs, R) factor on the assumed noise, by observation; empty if noise was known.
        offsets: (R,) standard deviation, from run to run, of a constant error of a row over the
            assumed noise, by observation; empty if there are none.
        machine: the given one, or its copy with more values if those were used.
    """

    count: float
    counts: dict[str, float]
    none: FittedExplanation
    singles: tuple[FittedExplanation, ...]
    pairs: tuple[FittedExplanation, ...]
    screened: dict[str, float]
    flexible: dict[str, dict[str, Predictable]]
    noise: Mapping[str, Array]
    offsets: Mapping[str, Array]
    machine: Machine


def examine(
    machine: Machine, say: Callable[[str], None] = lambda text: None, noise_known: bool = True
) -> Examination:
    """Score every hypothesis on the runs of a machine, and pairs of them.

    Args:
        machine: with its runs.
        say: called with the name of each stage.
        noise_known: whether the noise of the blocks is known. If not, the unpredictable part of
            the residual of the fit without effects counts as noise; where states are estimated,
            at most as much as the best single effect leaves.
    """
    say("calibration")
    machine, search, none, remainder = _calibrated_by_enough(machine, noise_known)
    catalogue = machine.hypotheses()
    say(f"{len(catalogue)} hypotheses")
    machine = in_best_orders(search, catalogue)
    search = search.with_machine(machine)
    search, ranked = rank(search, catalogue, None)
    fitted: Sequence[FittedExplanation] = ()
    if not machine.estimates_states:
        offsets, fitted = _offsets_by_drift(search, none, ranked, predicted_chi2(remainder))
        if offsets:
            fitted = ()
            say("drift")
            search = Search(machine, start=none.score.mean, offsets=offsets)
            search, none, remainder = _calibrated(search, noise_known)
            search, ranked = rank(search, catalogue, None)
    counts = search.campaign.counts
    count = sum(counts.values())
    most = (1.0 + MIN_GAIN_PER_VALUE) * count  # an explanation that leaves more lacks something
    say("fits")
    lowest = min((loss for loss, *_ in ranked), default=none.loss)
    gain = none.loss - lowest
    worth = search.worth
    idle = gain < worth and predicted_chi2(remainder) < MIN_GAIN_PER_VALUE * count
    limits = MAX_FITTED, MAX_FITTED_PER_EFFECT
    if machine.estimates_states and lowest > NONLINEAR_CHI2 * count:
        limits = MAX_FITTED_FAR, MAX_FITTED_PER_EFFECT_FAR
    if idle:  # fits of moving parts are long, and none of them explains a gap
        quick = [entry for entry in ranked if entry[1].measured_gain is None]
        singles = fit_best(search, quick or ranked, MIN_FITTED, limits[1], fitted)
    else:
        singles = fit_best(search, ranked, *limits, fitted, machine.estimates_states)
    if machine.estimates_states:
        if not idle:
            singles = with_other_law(search, ranked, singles)
        again, singles = fit_again(search, none, singles)
        if singles and _is_worth_seeking(none, singles[0], most):
            search, singles = with_better_part(search, singles, most)
            singles = with_fits_anew(search, singles, most)
        if again is not none:
            none, remainder = again, _predictable_remainder(search, again)
    say("what is left")
    flexible = {"none": remainder}
    pairs: tuple[FittedExplanation, ...] = ()
    if singles:
        first = _first_of_pairs(none, singles, most)
        flexible["single"] = _predictable_remainder(search, singles[0], remainder)
        if machine.estimates_states and not noise_known:
            noise = less_noise(search.noise, flexible["single"])
            if noise is not None:
                say("less noise")
                before, idle = none.loss, False
                search, none, singles = _with_noise(search, noise, none, singles)
                search = search.onwards(search.machine)
                ranked = [(v * none.loss / before, h, start) for v, h, start in ranked]
                first = _first_of_pairs(none, singles, most)
                remainder = flexible["none"] = _predictable_remainder(search, none)
                flexible["single"] = _predictable_remainder(search, singles[0], remainder)
        if machine.estimates_states and not idle:
            joint = rank_jointly(search, ranked)
            pairs = fit_jointly(search, joint, singles[0].loss - 2.0 * worth)
        if pairs:
            before_pairs = singles[0]
            singles = with_each_alone(search, pairs, singles)
            first = _first_of_pairs(none, singles, most)
            if singles[0] is not before_pairs:
                flexible["single"] = _predictable_remainder(search, singles[0], remainder)
            flexible["pair"] = _predictable_remainder(search, pairs[0], remainder)
        # Brief events such as a tooth contact are not predictable: judge by the fit, too.
        in_sample = first.score.in_sample
        lacks_one = in_sample > NONLINEAR_CHI2 * count or (
            predicted_chi2(flexible["single"]) > worth and not idle
        )
        more_than_noise = in_sample > most and not idle
        explained = bool(pairs) and pairs[0].score.in_sample <= most
        if (lacks_one or more_than_noise) and not explained:
            say("pairs")
            least = 0.0 if lacks_one else worth
            added_pairs = fit_pairs(search, catalogue, first, least, singles)
            pairs = without_duplicates((*pairs, *added_pairs))
            if added_pairs:
                flexible["pair"] = _predictable_remainder(search, pairs[0], remainder)
                better = refit_first_alone(search, first, added_pairs[0])
                if better.loss < first.loss:
                    others = [f for f in singles if f is not first]
                    first = better
                    singles = tuple(sorted((first, *others), key=lambda f: f.loss))
                    flexible["single"] = _predictable_remainder(search, singles[0], remainder)
            second = refit_second_alone(search, singles, added_pairs)
            if second is not None and not machine.estimates_states:  # for run time
                added_pairs = fit_rivals_of_first(search, second, singles, pairs)
                pairs = without_duplicates((*pairs, *added_pairs))
                flexible["pair"] = _predictable_remainder(search, pairs[0], remainder)
            if second is not None and second.loss < singles[0].loss:
                singles = (second, *singles)
                flexible["single"] = _predictable_remainder(search, second, remainder)
            elif not (added_pairs and _first_was_misfitted(first, added_pairs[0], flexible)):
                second = None
            firsts = {first.effects[0]}
            if (
                second is not None
                and predicted_chi2(flexible["pair"]) > MIN_GAIN_PER_VALUE * count
            ):
                firsts.add(second.effects[0])
                added_pairs = fit_pairs(search, catalogue, second, 0.0, singles)
                pairs = without_duplicates((*pairs, *added_pairs))
                flexible["pair"] = _predictable_remainder(search, pairs[0], remainder)
            if not machine.estimates_states:  # for run time
                other = _other_first(search, singles, pairs, most, firsts)
                added_pairs = fit_pairs(search, catalogue, other, 0.0, singles) if other else ()
                if added_pairs:
                    pairs = without_duplicates((*pairs, *added_pairs))
                    flexible["pair"] = _predictable_remainder(search, pairs[0], remainder)
        parts = [f for f in near_best(none, singles, NEAR_SHARE) if not _is_ranked(f)]
        linear_pairs = [f for f in pairs if _is_ranked(f)]
        if machine.estimates_states and parts and linear_pairs:
            beside_part = fit_beside_part(search, parts[0], linear_pairs, singles)
            pairs = without_duplicates((*pairs, *beside_part))
            flexible["pair"] = _predictable_remainder(search, pairs[0], remainder)
    screened: dict[str, float] = {}
    for value, hypothesis, _ in ranked:
        screened.setdefault(hypothesis.effect, value)
    return Examination(
        count,
        counts,
        none,
        singles,
        pairs,
        screened,
        flexible,
        search.noise,
        search.offsets,
        machine,
    )


def _other_first(
    search: Search,
    singles: Sequence[FittedExplanation],
    pairs: Sequence[FittedExplanation],
    most: float,
    firsts: Container[str],
) -> FittedExplanation | None:
    """Fit alone the second effect of the pair that leaves least; None if that is at most ``most``.

    The first effect, the best alone, may take the place of both: the second one is then in a pair
    with another, or with the first at another place. Of the ``firsts``, to which second effects
    have been sought, none is taken again; None if there is no other. A fit of the effect among
    ``singles``, at any place, is returned as it is.
    """
    if not pairs or min(f.score.in_sample for f in pairs) <= most:
        return None
    untried = [f for f in pairs if f.hypotheses[1].effect not in firsts]
    untried.sort(key=lambda f: f.score.in_sample)
    second = next((f.hypotheses[1] for f in untried if f.hypotheses[1].source is None), None)
    best = (f for f in singles if second and f.hypotheses[0].effect == second.effect)
    return next(best, None) or refit_second_alone(search, singles, untried)


def _calibrated_by_enough(
    machine: Machine, noise_known: bool
) -> tuple[Machine, Search, FittedExplanation, dict[str, Predictable]]:
    """Fit the tolerances; use more values of each run if chi2 says that little is unexplained.

    Little is a chi2 per value below ``NONLINEAR_CHI2``. ``Machine.with_more_values`` gives the
    larger machine; where it gives none, or chi2 is larger, the given machine is kept.

    Args:
        machine: with its runs.
        noise_known: as in ``examine``.

    Returns:
        The machine whose values were used, and what ``_calibrated`` returns.
    """
    search = Search(machine)
    calibration = None
    if search.null.loss >= NONLINEAR_CHI2 * search.null.count:  # noise may turn out to be larger
        calibration = _calibrated(search, noise_known)
        search, none, _ = calibration
        if none.loss >= NONLINEAR_CHI2 * none.score.count:
            return machine, *calibration
    larger = machine.with_more_values()
    if larger is None:
        return machine, *(calibration or _calibrated(search, noise_known))
    return larger, *_calibrated(Search(larger, start=search.null.mean), noise_known)


def _calibrated(
    search: Search, noise_known: bool
) -> tuple[Search, FittedExplanation, dict[str, Predictable]]:
    """Fit the tolerances exactly; where the noise is unknown, estimate it and fit again.

    Returns:
        The search, the fit, and the predictable part of its residual by observation.
    """
    none = FittedExplanation((), search.settled(search.null))
    remainder = _predictable_remainder(search, none)
    if not noise_known:
        exchange = _exchange_of_channels(search, none)
        left = remainder if exchange is None else _predictable_remainder(search, exchange)
        noise = {o: noise_factors(p) for o, p in left.items()}
        remainder = {o: p.with_noise_scaled(noise[o]) for o, p in remainder.items()}
        search = Search(search.machine, noise, none.score.mean, search.offsets)
        none = FittedExplanation((), search.settled(search.null))
    return search, none, remainder


def _offsets_by_drift(
    search: Search, none: FittedExplanation, ranked: Ranking, predicted: float
) -> tuple[dict[str, Array], tuple[FittedExplanation, ...]]:
    """Estimate offsets by drift as ``offset_sds``, from the fit that leaves least of them.

    A bias is the same in all runs, but neither the same multiple of their noise nor as visible in
    all patterns of contact, so that without it, it would be taken for drift. So would other
    effects: the best ranked ones are fitted that may remove most of what offsets explain.

    Args:
        none: fit without effects.
        ranked: as from ``rank``, without offsets.
        predicted: as in ``offset_sds``.

    Returns:
        The offsets, and the fits made of single effects.
    """
    assumed = copy.copy(search)
    assumed.noise = {}
    observations = tuple(search.machine.functions)

    def left_by(fit: FittedExplanation) -> tuple[dict[str, Array], float]:
        return offset_sds(_blocks_about(assumed, fit, observations), predicted, search.noise)

    offsets, explained = left_by(none)
    if not offsets:
        return {}, ()
    able = [
        (loss, hypothesis, start)
        for loss, hypothesis, start in ranked
        if none.loss - loss > OFFSET_SHARE * explained or hypothesis.partly_screened
    ]
    singles = fit_best(search, able, MIN_FITTED, MAX_FITTED_PER_EFFECT)
    for single in singles:
        found, by_found = left_by(single)
        if by_found < explained:
            offsets, explained = found, by_found
    return offsets, singles


def _exchange_of_channels(search: Search, none: FittedExplanation) -> FittedExplanation | None:
    """Fit the best exchange of channels; None unless it leaves less than ``SURE_SHARE`` of chi2.

    The residual of exchanged channels can't be predicted from the motion, so that it would be
    taken for noise. Sought where states are estimated and chi2 is at least ``NONLINEAR_CHI2`` a
    value; other observations show an exchange without this.

    Args:
        none: fit without effects, for the noise that the machine assumes.
    """
    machine = search.machine
    if not machine.estimates_states or none.loss < NONLINEAR_CHI2 * none.score.count:
        return None
    start = np.append(none.score.mean, 1.0)
    swaps = [(h, start) for h in machine.hypotheses() if not h.vanishes_at_zero]
    tried = machine.nonlinear_trials(swaps, none.score) if swaps else []
    if not tried:
        return None
    _, hypothesis, start = tried[0]
    fit = fit_effect(search, hypothesis, start)
    return fit if fit.score.in_sample < SURE_SHARE * none.score.in_sample else None


def _with_noise(
    search: Search,
    noise: Mapping[str, Array],
    none: FittedExplanation,
    singles: Sequence[FittedExplanation],
) -> tuple[Search, FittedExplanation, tuple[FittedExplanation, ...]]:
    """Search and fits made again with other noise factors; the single effects best first."""
    search = Search(search.machine, noise, none.score.mean, search.offsets)
    none = FittedExplanation((), search.settled(search.null))
    again = [replace(f, score=search.refitted(f.score)) for f in singles]
    return search, none, tuple(sorted(again, key=lambda f: f.loss))


def _is_worth_seeking(none: FittedExplanation, best: FittedExplanation, most: float) -> bool:
    """Whether the best effect leaves too much, and explains ``WORTH_SEEKING`` of the gap."""
    gained = none.loss - best.loss
    return best.score.in_sample > most and gained > WORTH_SEEKING * (none.loss - most)


def _first_of_pairs(
    none: FittedExplanation, singles: Sequence[FittedExplanation], most: float
) -> FittedExplanation:
    """Return the simplest of about the best single effects, beside which others are fitted.

    A moving part is passed over where it is not worth seeking further: fits beside it are long.
    """
    first = simplest_equivalent(none, singles)
    ranked = [f for f in singles if _is_ranked(f)]
    if _is_ranked(first) or not ranked or _is_worth_seeking(none, first, most):
        return first
    return simplest_equivalent(none, ranked)


def _is_ranked(explanation: FittedExplanation) -> bool:
    """Whether the linear screen ranks all hypotheses of an explanation: no moving part."""
    return all(h.measured_gain is None for h in explanation.hypotheses)


def _first_was_misfitted(
    first: FittedExplanation,
    pair: FittedExplanation,
    remainder: Mapping[str, Mapping[str, Predictable]],
) -> bool:
    """Whether a pair removes much, and yet leaves much that is predictable.

    Much is half of the chi2 predictable under the best single effect. Then the first effect,
    which was chosen alone, is probably the wrong partner of the second.
    """
    half = 0.5 * predicted_chi2(remainder["single"])
    return first.loss - pair.loss > half and predicted_chi2(remainder["pair"]) > half


def _predictable_remainder(
    search: Search,
    explanation: FittedExplanation,
    of_none: Mapping[str, Predictable] | None = None,
) -> dict[str, Predictable]:
    """Predictable part of the residual of an explanation, by observation.

    Args:
        of_none: that of the fit without effects, reused for observations on which no coefficient
            of the explanation acts.
    """
    search = explanation.search or search
    machine = search.machine.without_linearisation()
    result = {}
    for o in machine.functions:
        if of_none is not None and o in of_none and not _acts_on(explanation, o):
            result[o] = of_none[o]
            continue
        blocks = _blocks_about(search, explanation, (o,))
        if not all(o in b for b in blocks):
            continue
        by_run = [b[o] for b in blocks]
        numbers = []
        for r, b in enumerate(by_run):
            at = b.sample_index if b.sample_index is not None else np.arange(len(b.residual))
            numbers.append((machine.cycles(o, r)[at] // BLOCK_CYCLES).astype(int))
        result[o] = predict_residuals(
            parallel_map(residual_without_nuisance, by_run),
            [machine.regression_inputs(o, r, b) for r, b in enumerate(by_run)],
            numbers,
            np.array([b.independent_share for b in by_run]),
        )
    return result


def _acts_on(explanation: FittedExplanation, observation: str) -> bool:
    """Whether a coefficient of an explanation acts on an observation."""
    return any(observation in c.placements for c in explanation.score.coefficients)


def _blocks_about(
    search: Search, explanation: FittedExplanation, observations: Sequence[str]
) -> list[dict[str, Block]]:
    """Blocks of all runs about an explanation, exact and without columns; by observation."""
    fine = copy.copy(search)
    fine.machine = search.machine.without_linearisation()
    score = explanation.score
    fitted = amplitudes(score.coefficients, score.mean, search.runs, search.rows)
    return fine.blocks(fitted, {}, observations)
