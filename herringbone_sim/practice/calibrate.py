"""Fit the weights of the judge to stored evidence of practice campaigns.

The weights maximise the penalised likelihood; the penalty is the one that predicts left-out
campaigns best in five-fold cross-validation. Figures are of campaigns that neither weights nor
penalty were fitted to, averaged over several random divisions into folds: the division alone
moves a calibration error by 0.01.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from herringbone_sim.arrays import Array, Flags, Indices
from herringbone_sim.diagnosis import judge
from herringbone_sim.diagnosis.judge_weights import (
    LabelledCampaign,
    are_true,
    fit_labelled,
    labelled_campaign,
    log_loss,
)
from herringbone_sim.errors import AnalysisError
from herringbone_sim.practice.case_evidence import CaseEvidence
from herringbone_sim.practice.intervals import calibration_error

FOLDS = 5
DRAWS = 4  # random divisions into folds that the figures are averaged over
COVERAGE = 0.9  # wanted fraction of the true sizes inside their 90 % intervals
PENALTIES = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
SERIES = 5_000  # a larger gap between seeds separates two ranges of ``_ranges``


@dataclass(frozen=True)
class Calibration:
    """Fitted weights, penalties, model error of sizes, and figures of cross-validation.

    Attributes:
        weights: (n,) in the order of ``judge.NAMES``, for each of ``judge.LOSSES`` with enough
            campaigns. The prior for ``density`` is centred at the weights for ``squares``.
        penalties: precision of that prior for each loss, chosen from ``PENALTIES``.
        figures: by stratum, see ``by_stratum``.
        relative: standard deviation of the model error of a size, relative to the size.
        covered: fraction of the true sizes inside their 90 % intervals in cross-validation; NaN
            without sizes.
    """

    weights: dict[str, Array]
    penalties: dict[str, float]
    figures: dict[str, dict[str, float]]
    relative: float
    covered: float


def calibrate(campaigns: Sequence[CaseEvidence]) -> Calibration:
    """Fit the weights and penalty for each loss, and the model error of the sizes.

    With too few campaigns judged by density, these are judged by the weights for squares.

    Raises:
        AnalysisError: fewer than ``2 * FOLDS`` campaigns with the first loss that has any, or
            fewer than ``FOLDS`` that are ``counted``.
    """
    sizes = [np.array(c.sizes).reshape(-1, 3) for c in compress(campaigns, counted(campaigns))]
    if len(sizes) < FOLDS:
        raise AnalysisError(
            f"calibration needs {FOLDS} campaigns in its figures, got {len(sizes)}: run more"
        )
    weights: dict[str, Array] = {}
    penalties: dict[str, float] = {}
    draws = [np.zeros((len(campaigns), 4)) for _ in range(DRAWS)]
    for loss, at in by_loss(campaigns).items():
        group = [campaigns[i] for i in at]
        prior_mean = next(iter(weights.values()), None)
        if len(group) < 2 * FOLDS and prior_mean is not None:
            for rows in draws:
                rows[at] = [judged(c, prior_mean) for c in group]
            continue
        if len(group) < 2 * FOLDS:
            raise AnalysisError(
                f"calibration needs {2 * FOLDS} campaigns or more that are judged by {loss}, got "
                f"{len(group)}: run more"
            )
        labelled = [labelled_campaign(c.evidence, c.truth) for c in group]
        penalties[loss] = best_penalty(labelled, prior_mean)
        weights[loss] = fit_labelled(labelled, penalties[loss], None, prior_mean)
        for draw, rows in enumerate(draws):
            rows[at] = left_out(group, labelled, draw, prior_mean)
    fold = np.arange(len(sizes)) % FOLDS
    held = []
    for f in range(FOLDS):
        others, own = (
            np.concatenate([z for z, k in zip(sizes, fold, strict=True) if bool(k == f) == mine])
            for mine in (False, True)
        )
        held.append(_misses(own, model_error(others)) <= 1.0)
    covered = float(np.mean(np.concatenate(held))) if any(map(len, held)) else float("nan")
    return Calibration(
        weights,
        penalties,
        by_stratum(campaigns, draws),
        model_error(np.concatenate(sizes)),
        covered,
    )


def by_loss(campaigns: Sequence[CaseEvidence]) -> dict[str, Indices]:
    """Return the indices of the campaigns judged by each loss of ``judge.LOSSES`` that has any."""
    density = np.array([c.evidence.by_density for c in campaigns], dtype=bool)
    every = {loss: np.flatnonzero(density == on) for on, loss in enumerate(judge.LOSSES)}
    return {loss: at for loss, at in every.items() if len(at)}


def counted(campaigns: Sequence[CaseEvidence]) -> Flags:
    """Return a mask (n,) of the campaigns that enter the figures.

    Excluded are campaigns judged by squares whose channel set is judged by density in others: the
    diagnosis no longer judges it by squares. They only serve to fit weights.
    """
    now = {c.stratum[2] for c in campaigns if c.evidence.by_density}
    return np.array([c.evidence.by_density or c.stratum[2] not in now for c in campaigns])


def model_error(sizes: Array) -> float:
    """Return the relative model error, 0 to 1, with which 90 % of 90 % intervals hold the truth.

    Args:
        sizes: (n, 3) error, standard deviation and true size, see ``CaseEvidence.sizes``.
    """

    def uncovered(relative: float) -> float:
        return float(np.mean(_misses(sizes, relative) <= 1.0)) - COVERAGE

    if not len(sizes) or uncovered(0.0) >= 0.0:
        return 0.0
    if uncovered(1.0) <= 0.0:
        return 1.0
    return float(brentq(uncovered, 0.0, 1.0, xtol=1e-5))


def _misses(sizes: Array, relative: float) -> Array:
    """Return |error| over half of the 90 % interval (n,), which includes the model error."""
    error, sd, size = sizes.T
    half = judge.HALF_90 * np.hypot(sd, relative * size)
    miss = np.where(error == 0.0, 0.0, np.inf)
    return np.asarray(np.divide(np.abs(error), half, out=miss, where=half > 0.0))


def by_stratum(
    campaigns: Sequence[CaseEvidence], draws: Sequence[Array]
) -> dict[str, dict[str, float]]:
    """Return the figures of ``headline`` for groups of the campaigns that ``counted`` selects.

    Args:
        campaigns: n campaigns.
        draws: for each division into folds, the rows (n, 4) of ``judged``.

    Returns:
        Figures averaged over the divisions, by name of the group: all campaigns, those whose
        noise is given or not, those without a cause, with an outside cause or with effects of the
        catalogue, those judged by density (``few sensors``), and those of each channel set.
        Groups without campaigns are omitted.
    """
    current = counted(campaigns)
    campaigns = [c for c, on in zip(campaigns, current.tolist(), strict=True) if on]
    draws = [rows[current] for rows in draws]
    given_noise = np.array([c.evidence.told for c in campaigns])
    healthy = np.array([not c.truth for c in campaigns])
    foreign = np.array([c.truth == ("unknown",) for c in campaigns])
    strata = {
        "all": np.ones(len(campaigns), dtype=bool),
        "noise told": given_noise,
        "noise not told": ~given_noise,
        "healthy": healthy,
        "outside cause": foreign,
        "effects": ~healthy & ~foreign,
        "few sensors": np.array([c.evidence.by_density for c in campaigns]),
    }
    channels = np.array([c.stratum[2] for c in campaigns])
    strata |= {name: channels == name for name in sorted(set(channels.tolist()))}
    averages = {}
    for name, on in strata.items():
        if on.any():
            by_draw = [headline(chances[on]) for chances in draws]
            averages[name] = {
                key: float(np.mean([figures[key] for figures in by_draw])) for key in by_draw[0]
            }
    return averages


def best_penalty(labelled: Sequence[LabelledCampaign], prior_mean: Array | None = None) -> float:
    """Return the one of ``PENALTIES`` with the smallest log loss on left-out campaigns."""
    fold = folds(len(labelled))
    lost = dict.fromkeys(PENALTIES, 0.0)
    for f in range(FOLDS):
        own = [labelled[i] for i in np.flatnonzero(fold == f).tolist()]
        others = [labelled[i] for i in np.flatnonzero(fold != f).tolist()]
        weights = None
        for penalty in sorted(PENALTIES, reverse=True):
            weights = fit_labelled(others, penalty, weights, prior_mean)
            lost[penalty] += log_loss(own, weights)
    return min(PENALTIES, key=lambda penalty: lost[penalty])


def folds(n: int, draw: int = 0) -> Indices:
    """Return the random fold (n,), 0 to ``FOLDS`` - 1, of each campaign; ``draw`` is the seed."""
    return np.random.default_rng(draw).permutation(n) % FOLDS


def left_out(
    campaigns: Sequence[CaseEvidence],
    labelled: Sequence[LabelledCampaign],
    draw: int = 0,
    prior_mean: Array | None = None,
) -> Array:
    """Return ``judged`` (n, 4) of each campaign by weights and a penalty fitted to other folds.

    Args:
        labelled: ``labelled_campaign`` of each campaign, in the same order.
        draw: seed of the division into ``FOLDS`` folds.
        prior_mean: (len(judge.NAMES),) prior mean of the weights; None: zero.
    """
    fold = folds(len(campaigns), draw)
    rows = np.zeros((len(campaigns), 4))
    for f in range(FOLDS):
        others = [campaign for campaign, k in zip(labelled, fold, strict=True) if k != f]
        weights = fit_labelled(others, best_penalty(others, prior_mean), None, prior_mean)
        for i in np.flatnonzero(fold == f).tolist():
            rows[i] = judged(campaigns[i], weights)
    return rows


def judged(case: CaseEvidence, weights: Array | None = None) -> tuple[float, float, float, float]:
    """Judge a campaign by ``weights`` (None: those of the package) and compare with the truth.

    Returns:
        Probability of the true set of effects, and of the most probable set; 1 if both are the
        same set, else 0; probability of the explanations that ``are_true``. The first three ignore
        those with something unknown beside an effect, which ``are_true`` may count.
    """
    chances = judge.chances(case.evidence, weights)
    truth = tuple(sorted(case.truth))
    groups: dict[tuple[str, ...], float] = {}
    for c in chances:
        if c.whole:
            effects = tuple(sorted(c.effects))
            groups[effects] = groups.get(effects, 0.0) + c.probability
    true = np.array([c.probability for c in chances])[are_true(chances, case.truth)].sum()
    first = max(groups, key=lambda e: groups[e])
    return groups.get(truth, 0.0), groups[first], float(first == truth), float(true)


def headline(chances: Array) -> dict[str, float]:
    """Return figures of campaigns, by name, from their ``judged`` rows (n, 4).

    Probabilities are too high where ``probability of the first`` exceeds ``right first``. The log
    loss is that of true explanations, with probabilities of at least 1e-6.
    """
    return {
        "log loss": -float(np.mean(np.log(np.maximum(chances[:, 3], 1e-6)))),
        "probability on the truth": float(chances[:, 0].mean()),
        "probability of the first": float(chances[:, 1].mean()),
        "right first": float(chances[:, 2].mean()),
        "calibration error": calibration_error(chances[:, 1:3]),
        "campaigns": float(len(chances)),
    }


def _ranges(seeds: Sequence[int]) -> list[list[int]]:
    """Return ranges [first, last + 1) of seeds, separated by gaps larger than ``SERIES``."""
    each = np.unique(seeds)
    parts = np.split(each, np.flatnonzero(np.diff(each) > SERIES) + 1)
    return [[int(part[0]), int(part[-1]) + 1] for part in parts]


def write_weights(
    path: Path, calibration: Calibration, campaigns: Sequence[CaseEvidence], sources: str
) -> None:
    """Write the weights file of the judge: weights, seeds, digest of the sources and figures."""
    content = {
        "weights": {
            loss: dict(zip(judge.NAMES, map(float, w), strict=True))
            for loss, w in calibration.weights.items()
        },
        "relative error of a size": calibration.relative,
        "coverage of 90 % intervals, left out": calibration.covered,
        "penalties": calibration.penalties,
        "seeds": _ranges([c.seed for c in campaigns]),
        "sources": sources,
        "figures of campaigns left out": calibration.figures,
    }
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
