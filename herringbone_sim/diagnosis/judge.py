"""From evidence to probabilities of none, every effect, every pair, and unknown.

A conditional logit (McFadden 1974): each explanation has a few numbers that say how well it does,
and its probability goes with the exponential of their weighted sum. The weights are fitted on
practice campaigns by ``calibrate`` and kept in ``calibration.json`` with the seeds; none is
chosen.

With E the loss (``Score.loss``: whitened squares left on runs predicted by the others, or what
their predictive density is worth in squares), N the count of values, and R what a
flexible regression still predicts of them: the gap is what can be predicted beside the calibrated
machine, (E_none - E_best + R_best) / N; an explanation h leaves the share
(E_h - E_best + R_best) / (E_none - E_best + R_best) of it. The strain says how far a learned curve
departs from the catalogue's beside the effect's size; the excess is the largest mean square that
is left of an observation, above the noise's one and what chance adds to it. The second effect of a
pair may follow what the curve of the first one misses, which is little of all that the pair takes,
where the data are fitted. Shares are of values, and models miss some of each; what noise leaves
does not go with their number, so an explanation has both: (E_h - E_best) / N with ``LEAST`` beside
it, and E_h - E_best with ``CHANCE_CHI2``, which chance alone gives.
What a share of a value says changes with N, from thousands of windows to half a million.

A second effect is tried for the best single ones alone, and need not be among those tried. So each
single effect also competes as one with something unknown beside it, which is what a pair is of
which only that effect was tried. How probable that is goes with N, with the share of the squares
that the effect leaves, and with its excess.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.stats import norm

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.diagnosis.evidence import Candidate, Evidence
from herringbone_sim.diagnosis.search import CHANCE_CHI2
from herringbone_sim.errors import AnalysisError

HALF_90 = float(norm.ppf(0.95))  # standard deviations of half a 90 % interval
FILE = Path(__file__).with_name("calibration.json")
UNKNOWN = "unknown"
NAMES = (
    "log share left",
    "none",
    "none: log gap",
    "unknown",
    "unknown: log share left",
    "log excess left",
    "unknown: log gap",
    "pair",
    "pair: log second share",
    "pair: log second share in sample",
    "log strain",
    "unknown: log unevenness",
    "log squares left",
    "none: log count",
    "unknown: log count",
    "pair: log count",
    "beside",
    "beside: log count",
    "beside: log squares left",
    "beside: log excess left",
)
# Where states are estimated a difference of losses is what probabilities say it is, elsewhere laws
# that are not the catalogue's leave much of it: weights are fitted for both apart.
LOSSES = ("squares", "density")
FULL, FEWEST = 1e5, 5e3  # values of a campaign: with all channels, about; no fewer were practised
LEAST = 1e-3  # squares a value, beside the noise's one: a gap below it is none
CHANCE_SD = 2.0  # standard deviations of the mean square of noise that are no excess
LEAST_SHARE = 1e-4  # of the squares that a pair takes, by its second effect: below it is nothing


@dataclass(frozen=True)
class Explanation:
    """What may be there.

    Attributes:
        effects: ids; empty for none, ``("unknown",)``, or an effect and ``"unknown"`` for that
            effect with something beside it that was not found.
        candidate: its fit; None for unknown, that of the effect alone with something beside it.
    """

    effects: tuple[str, ...]
    candidate: Candidate | None

    @property
    def whole(self) -> bool:
        """Whether nothing unknown is beside an effect."""
        return UNKNOWN not in self.effects[1:]


@dataclass(frozen=True)
class Chance(Explanation):
    """An explanation with its probability."""

    probability: float


@dataclass(frozen=True)
class LabelledCampaign:
    """A practice campaign as the fit of weights sees it.

    Attributes:
        table: (k, len(NAMES)) numbers of its explanations.
        true: (k,) which of them are true.
    """

    table: Array
    true: Flags


def numbers(evidence: Evidence) -> tuple[list[Explanation], Array]:
    """Explanations, unknown and those with something beside them last, and their numbers.

    Returns:
        k explanations, (k, len(NAMES)).
    """
    none, *others = evidence.candidates
    singles = [c for c in others if len(c.effects) == 1]
    pairs = [c for c in others if len(c.effects) == 2]
    least = {"none": none, "single": singles[0] if singles else none}
    if pairs:
        least["pair"] = pairs[0]
    best = min(least, key=lambda k: least[k].loss + evidence.remains.get(k, 0.0))
    floor = least[best].loss - evidence.remains.get(best, 0.0)
    gap = max(none.loss - floor - CHANCE_CHI2, 0.0) / evidence.count + LEAST

    def share(left: float) -> float:
        return float(np.log((max(left - floor, 0.0) / evidence.count + LEAST) / gap))

    fewest = min(c.loss for c in evidence.candidates) - CHANCE_CHI2
    log_count = float(np.log(max(evidence.count, FEWEST) / FULL))
    log_gap = float(np.log(gap))
    chance = CHANCE_SD * float(np.sqrt(2.0 / evidence.count))

    def fit_numbers(c: Candidate) -> dict[str, float]:
        return {
            "log share left": share(c.loss),
            "log squares left": float(np.log((c.loss - fewest) / (none.loss - fewest))),
            "log strain": float(np.log1p(c.strain)),
            "log excess left": float(np.log(max(c.worst - 1.0 - chance, LEAST))),
        }

    def pair_numbers(c: Candidate) -> dict[str, float]:
        first = singles[0].loss
        taken = (first - c.loss) / (max(first - floor, 0.0) + LEAST * evidence.count)
        second = float(np.log(np.clip(taken, LEAST, 1.0)))
        own = {
            "pair": 1.0,
            "pair: log second share": second,
            "pair: log second share in sample": second_in_sample(c),
            "pair: log count": log_count,
        }
        return {**fit_numbers(c), **own}

    def second_in_sample(c: Candidate) -> float:
        either = [one.in_sample for one in singles if one.effects[0] in c.effects]
        added = min(either, default=singles[0].in_sample) - c.in_sample
        whole = max(none.in_sample - c.in_sample, CHANCE_CHI2)
        return float(np.log(np.clip(added / whole, LEAST_SHARE, 1.0)))

    def beside_numbers(c: Candidate) -> dict[str, float]:
        alone = fit_numbers(c)
        also = {f"beside: {name}": alone[name] for name in ("log squares left", "log excess left")}
        return {**alone, "beside": 1.0, "beside: log count": log_count, **also}

    none_numbers = {"none": 1.0, "none: log gap": log_gap, "none: log count": log_count}
    unknown_numbers = {
        "unknown": 1.0,
        "unknown: log share left": share(least[best].loss),
        "unknown: log gap": log_gap,
        "unknown: log unevenness": float(np.log(evidence.uneven)),
        "unknown: log count": log_count,
    }
    rows = [
        (Explanation((), none), {**fit_numbers(none), **none_numbers}),
        *((Explanation(c.effects, c), fit_numbers(c)) for c in singles),
        *((Explanation(c.effects, c), pair_numbers(c)) for c in pairs),
        (Explanation((UNKNOWN,), None), unknown_numbers),
        *((Explanation((*c.effects, UNKNOWN), c), beside_numbers(c)) for c in singles),
    ]
    table = np.array([[row.get(name, 0.0) for name in NAMES] for _, row in rows])
    return [one for one, _ in rows], table


def chances(evidence: Evidence, weights: Array | None = None) -> list[Chance]:
    """Explanations with probabilities, most probable first; they sum to 1.

    Raises:
        AnalysisError: evidence that is not finite.
    """
    w = frozen_weights(evidence.by_density) if weights is None else weights
    explanations, table = numbers(evidence)
    score = table @ w
    if not np.isfinite(score).all():
        raise AnalysisError(
            f"evidence must be finite, got {float(score[~np.isfinite(score)][0])} as "
            "the score of an explanation: report the campaign as a fault of the diagnosis"
        )
    p = np.exp(score - score.max())
    found = [
        Chance(e.effects, e.candidate, float(q))
        for e, q in zip(explanations, p / p.sum(), strict=True)
    ]
    return sorted(found, key=lambda f: -f.probability)


def are_true(explanations: Sequence[Explanation], truth: Sequence[str]) -> Flags:
    """Which explanations are true (k,), by what was tried.

    A pair that was not tried is either of its effects with something unknown beside it; nothing
    that was tried may be true.

    Args:
        truth: effects; empty for none, ``("unknown",)``.
    """
    exact = np.array([sorted(one.effects) == sorted(truth) for one in explanations])
    if exact.any() or len(truth) != 2:
        return exact
    return np.array([not one.whole and one.effects[0] in truth for one in explanations])


def labelled_campaign(evidence: Evidence, truth: Sequence[str]) -> LabelledCampaign:
    """A campaign and its truth (as of ``are_true``) as the fit sees it."""
    explanations, table = numbers(evidence)
    return LabelledCampaign(table, are_true(explanations, truth))


def fit(evidence: Sequence[Evidence], truths: Sequence[tuple[str, ...]], penalty: float) -> Array:
    """Weights (len(NAMES),) with the largest penalised likelihood of the truths.

    A truth no effect of which was tried tells nothing and is passed over.

    Args:
        truths: effects of each campaign; empty for none, ``("unknown",)``.
        penalty: precision of the prior of the weights about zero.
    """
    return fit_labelled(
        [labelled_campaign(e, t) for e, t in zip(evidence, truths, strict=True)], penalty
    )


def fit_labelled(
    labelled: Sequence[LabelledCampaign],
    penalty: float,
    start: Array | None = None,
    prior_mean: Array | None = None,
) -> Array:
    """Weights by labelled campaigns, as ``fit``.

    Args:
        start: of the search, which saves time alone.
        prior_mean: None: zero.
    """
    prior_mean = np.zeros(len(NAMES)) if prior_mean is None else prior_mean
    labelled = [one for one in labelled if one.true.any()]
    if not labelled:
        return prior_mean
    table = np.concatenate([one.table for one in labelled])
    true = np.concatenate([one.true for one in labelled])
    sizes = np.array([len(one.true) for one in labelled])
    starts = np.cumsum(sizes) - sizes

    def loss(w: Array) -> tuple[float, Array]:
        score = table @ w
        score -= np.repeat(np.maximum.reduceat(score, starts), sizes)
        p = np.exp(score)
        p /= np.repeat(np.add.reduceat(p, starts), sizes)
        inside = np.maximum(np.add.reduceat(p * true, starts), 1e-300)
        slope = (p - p * true / np.repeat(inside, sizes)) @ table
        off = w - prior_mean
        value = 0.5 * penalty * float(off @ off) - float(np.log(inside).sum())
        return value, slope + penalty * off

    start = prior_mean if start is None else start
    return np.asarray(minimize(loss, start, jac=True, method="L-BFGS-B").x)


@cache
def _frozen() -> Mapping[str, Any]:
    data: Mapping[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return data


def frozen_weights(by_density: bool) -> Array:
    """Those of the package for evidence by either of ``LOSSES``; of the other if it has none."""
    every = _frozen()["weights"]
    kept = every.get(LOSSES[by_density]) or every[LOSSES[not by_density]]
    return np.array([kept[name] for name in NAMES])


def relative_error() -> float:
    """What models miss of a size, as a share of it: by the same practice campaigns."""
    return float(_frozen()["relative error of a size"])
