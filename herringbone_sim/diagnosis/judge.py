"""From evidence to probabilities of none, every effect, every pair, and unknown.

A conditional logit (McFadden 1974): the probability of an explanation is proportional to the
exponential of a weighted sum of a few numbers (``NAMES``) that say how well it fits. The weights
are fitted to practice campaigns (``diagnosis.judge_weights``) by ``gap calibrate`` and stored in
``calibration.json``.

E is the loss of an explanation (``Score.loss``), R the chi2 that the flexible regression still
predicts in its residual, N the number of values; "best" is the explanation with least E + R.
- gap: chi2 per value that can be predicted beyond the calibrated machine,
  (E_none - E_best + R_best) / N.
- share left: part of the gap that explanation h leaves, (E_h - E_best + R_best) over
  (E_none - E_best + R_best), each per value and with ``LEAST`` added, as models miss a little of
  every value.
- squares left: the same of the losses alone, not per value, with ``CHANCE_CHI2`` added: what
  chance leaves does not grow with N.
- strain: departure of a learned curve from the catalogue's, over the effect's size.
- excess left: largest mean square left in an observation, beyond 1 for noise and its chance.
- second share: part of what the best single effect leaves that the second effect removes; in
  sample, part of all that the pair removes: little if it only mends the first effect's curve.
- lost share: chi2 that is lost where each run is predicted from the others, over the chi2 that the
  explanation removes in sample, ``CHANCE_CHI2`` added to both: a true law holds for every run.
- count: N, which runs from thousands (windows) to half a million and changes what shares mean.

Only a few pairs are fitted. So each single effect competes also as a pair of it and something
unknown (``beside``): the true pair if it was not tried.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from herringbone_sim.arrays import Array
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
    "log lost share",
)
# Kinds of loss, each with weights of its own: log densities, where states are estimated, are
# nearly calibrated; squares are not, as laws that differ from the catalogue's leave some.
LOSSES = ("squares", "density")
FULL, FEWEST = 1e5, 5e3  # number of values: usual with all channels; fewest of a practice campaign
LEAST = 1e-3  # chi2 per value beyond the 1 of noise: a smaller gap counts as none
CHANCE_SD = 2.0  # standard deviations of the mean square of noise that count as no excess
LEAST_SHARE = 1e-4  # least part, by the second effect, of the chi2 that a pair removes


@dataclass(frozen=True)
class Explanation:
    """A possible explanation of a campaign.

    Attributes:
        effects: ids; empty for none; ``("unknown",)``; or an effect and ``"unknown"``: that effect
            with something unknown beside it.
        candidate: fit of ``effects`` without ``"unknown"``; None for ``("unknown",)``.
    """

    effects: tuple[str, ...]
    candidate: Candidate | None

    @property
    def whole(self) -> bool:
        """False for an effect with something unknown beside it, else true."""
        return UNKNOWN not in self.effects[1:]


@dataclass(frozen=True)
class Chance(Explanation):
    """An explanation with its probability."""

    probability: float


def numbers(evidence: Evidence) -> tuple[list[Explanation], Array]:
    """Return the k explanations of a campaign, and their numbers for the logit (k, len(NAMES)).

    Explanations are none, single effects, pairs, unknown, then each single effect with something
    unknown beside it. Numbers are in the order of ``NAMES``, 0 where one does not apply.
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

    def share(loss: float) -> float:
        return float(np.log((max(loss - floor, 0.0) / evidence.count + LEAST) / gap))

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
            "log lost share": lost_share(c) if c.effects else 0.0,
        }

    def lost_share(c: Candidate) -> float:
        lost = max(c.chi2 - c.in_sample, 0.0) + CHANCE_CHI2
        return float(np.log(lost / (max(none.in_sample - c.in_sample, 0.0) + CHANCE_CHI2)))

    def pair_numbers(c: Candidate) -> dict[str, float]:
        first = singles[0].loss
        second_share = (first - c.loss) / (max(first - floor, 0.0) + LEAST * evidence.count)
        second = float(np.log(np.clip(second_share, LEAST, 1.0)))
        pair_only = {
            "pair": 1.0,
            "pair: log second share": second,
            "pair: log second share in sample": second_in_sample(c),
            "pair: log count": log_count,
        }
        return {**fit_numbers(c), **pair_only}

    def second_in_sample(c: Candidate) -> float:
        either = [single.in_sample for single in singles if single.effects[0] in c.effects]
        added = min(either, default=singles[0].in_sample) - c.in_sample
        pair_gain = max(none.in_sample - c.in_sample, CHANCE_CHI2)
        return float(np.log(np.clip(added / pair_gain, LEAST_SHARE, 1.0)))

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
    return [explanation for explanation, _ in rows], table


def chances(evidence: Evidence, weights: Array | None = None) -> list[Chance]:
    """Explanations with probabilities that sum to 1, most probable first.

    ``weights``: (len(NAMES),); None: those of ``frozen_weights``.

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
    by_explanation = [
        Chance(e.effects, e.candidate, float(q))
        for e, q in zip(explanations, p / p.sum(), strict=True)
    ]
    return sorted(by_explanation, key=lambda f: -f.probability)


@cache
def _frozen() -> Mapping[str, Any]:
    data: Mapping[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return data


def frozen_weights(by_density: bool) -> Array:
    """Weights (len(NAMES),) in ``calibration.json`` for a loss, or the other's if it has none.

    ``by_density``: the loss is by ``Score.log_density``, not by chi2.
    """
    by_loss = _frozen()["weights"]
    weights = by_loss.get(LOSSES[by_density]) or by_loss[LOSSES[not by_density]]
    return np.array([weights[name] for name in NAMES])


def relative_error() -> float:
    """Standard deviation of the model error of a fitted size, relative to the size."""
    return float(_frozen()["relative error of a size"])
