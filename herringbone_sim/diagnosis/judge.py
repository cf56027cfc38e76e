"""From evidence to probabilities of none, every effect, every pair, and unknown.

A conditional logit (McFadden 1974): each explanation has a few numbers that say how well it does,
and its probability goes with the exponential of their weighted sum. The weights are fitted on
practice campaigns by ``calibrate`` and kept in ``calibration.json`` with the seeds; none is
chosen.

With E the whitened squares left on runs predicted by the others, N their count, and R what a
flexible regression still predicts of them: the gap is what can be predicted beside the calibrated
machine, (E_none - E_best + R_best) / N; an explanation h leaves the share
(E_h - E_best + R_best) / (E_none - E_best + R_best) of it. The strain says how far a learned curve
departs from the catalogue's beside the effect's size; the excess is the largest mean square that
is left of an observation, above the noise's one. Shares are of values, and models miss some of
each; what noise leaves does not go with their number, so an explanation has both: (E_h - E_best) /
N with ``LEAST`` beside it, and E_h - E_best with ``CHANCE_CHI2``, which chance alone gives.
What a share of a value says changes with N, from thousands of windows to half a million.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from herringbone_sim.diagnosis.evidence import Candidate, Evidence
from herringbone_sim.diagnosis.search import CHANCE_CHI2

Array = NDArray[np.float64]

HALF_90 = 1.645  # standard deviations of half a 90 % interval
FILE = Path(__file__).with_name("calibration.json")
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
    "log strain",
    "unknown, noise told",
    "noise told: log excess left",
    "unknown: log unevenness",
    "log squares left",
    "none: log count",
    "unknown: log count",
    "pair: log count",
)
FULL, FEWEST = 1e5, 5e3  # values of a campaign: with all channels, about; no fewer were practised
LEAST = 1e-3  # squares a value, beside the noise's one: a gap below it is none


@dataclass(frozen=True)
class Chance:
    """An explanation with its probability; ``unknown`` has the effect ``unknown`` alone."""

    effects: tuple[str, ...]
    candidate: Candidate | None
    probability: float


def numbers(evidence: Evidence) -> tuple[list[Candidate | None], Array]:
    """Explanations, the last one unknown (None), and their numbers (k, len(NAMES))."""
    none, *others = evidence.candidates
    singles = [c for c in others if len(c.effects) == 1]
    pairs = [c for c in others if len(c.effects) == 2]
    least = {"none": none, "single": singles[0] if singles else none}
    if pairs:
        least["pair"] = pairs[0]
    best = min(least, key=lambda k: least[k].energy + evidence.remains.get(k, 0.0))
    floor = least[best].energy - evidence.remains.get(best, 0.0)
    gap = max(none.energy - floor - CHANCE_CHI2, 0.0) / evidence.count + LEAST
    rows: list[Array] = []
    every: list[Candidate | None] = []

    def share(energy: float) -> float:
        return float(np.log((max(energy - floor, 0.0) / evidence.count + LEAST) / gap))

    fewest = min(c.energy for c in evidence.candidates) - CHANCE_CHI2
    log_count = float(np.log(max(evidence.count, FEWEST) / FULL))
    for c in (none, *singles, *pairs):
        row = np.zeros(len(NAMES))
        row[0] = share(c.energy)
        row[13] = np.log((c.energy - fewest) / (none.energy - fewest))
        if not c.effects:
            row[1:3] = 1.0, np.log(gap)
            row[14] = log_count
        if len(c.effects) == 2:
            first = singles[0].energy
            taken = (first - c.energy) / (max(first - floor, 0.0) + LEAST * evidence.count)
            row[7:9] = 1.0, np.log(np.clip(taken, LEAST, 1.0))
            row[16] = log_count
        row[9] = np.log1p(c.strain)
        row[5] = np.log(max(c.worst - 1.0, LEAST))
        row[11] = row[5] * evidence.told
        every.append(c)
        rows.append(row)
    row = np.zeros(len(NAMES))
    row[3:5] = 1.0, share(least[best].energy)
    row[6], row[10], row[12] = np.log(gap), evidence.told, np.log(evidence.uneven)
    row[15] = log_count
    return [*every, None], np.array([*rows, row])


def chances(evidence: Evidence, weights: Array | None = None) -> list[Chance]:
    """Explanations with probabilities, most probable first; they sum to 1."""
    w = frozen_weights() if weights is None else weights
    every, table = numbers(evidence)
    p = _softmax(table @ w)
    found = [
        Chance(("unknown",) if c is None else c.effects, c, float(q))
        for c, q in zip(every, p, strict=True)
    ]
    return sorted(found, key=lambda f: -f.probability)


def _softmax(score: Array) -> Array:
    e = np.exp(score - score.max())
    return np.asarray(e / e.sum())


def fit(evidence: Sequence[Evidence], truths: Sequence[tuple[str, ...]], penalty: float) -> Array:
    """Weights with the largest penalised likelihood of the truths.

    A truth that is not among the explanations tried tells nothing and is passed over.

    Args:
        truths: effects of each campaign; empty for none, ``("unknown",)``.
        penalty: precision of the prior of the weights about zero.
    """
    tables, masks = [], []
    for one, truth in zip(evidence, truths, strict=True):
        every, table = numbers(one)
        is_true = np.array([_matches(c, truth) for c in every])
        if is_true.any():
            tables.append(table)
            masks.append(is_true)

    def loss(w: Array) -> tuple[float, Array]:
        value, slope = 0.5 * penalty * float(w @ w), penalty * w
        for table, is_true in zip(tables, masks, strict=True):
            p = _softmax(table @ w)
            inside = max(float(p[is_true].sum()), 1e-300)
            value -= float(np.log(inside))
            slope = slope + (p - np.where(is_true, p / inside, 0.0)) @ table
        return value, slope

    found = minimize(loss, np.zeros(len(NAMES)), jac=True, method="L-BFGS-B")
    return np.asarray(found.x)


def _matches(c: Candidate | None, truth: tuple[str, ...]) -> bool:
    if c is None:
        return truth == ("unknown",)
    return sorted(c.effects) == sorted(truth)


@cache
def _frozen() -> Mapping[str, Any]:
    data: Mapping[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return data


def frozen_weights() -> Array:
    """Those of the package."""
    return np.array([_frozen()["weights"][name] for name in NAMES])


def relative_error() -> float:
    """What models miss of a size, as a share of it: by the same practice campaigns."""
    return float(_frozen()["relative error of a size"])
