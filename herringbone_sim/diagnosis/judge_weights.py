"""Fit the weights of the judge to campaigns whose truth is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.diagnosis.evidence import Evidence
from herringbone_sim.diagnosis.judge import NAMES, Explanation, numbers


@dataclass(frozen=True)
class LabelledCampaign:
    """A practice campaign as input of the fit of the weights.

    Attributes:
        table: (k, len(NAMES)) numbers of its explanations.
        true: (k,) which of the explanations are true.
    """

    table: Array
    true: Flags


def are_true(explanations: Sequence[Explanation], truth: Sequence[str]) -> Flags:
    """Mask (k,) of the explanations that name exactly the true effects; possibly all False.

    If the truth is a pair that is not among them, both "one of its effects with something unknown
    beside it" are true.

    Args:
        truth: ids of the true effects; empty for none; ``("unknown",)``.
    """
    exact = np.array(
        [sorted(explanation.effects) == sorted(truth) for explanation in explanations]
    )
    if exact.any() or len(truth) != 2:
        return exact
    return np.array(
        [not explanation.whole and explanation.effects[0] in truth for explanation in explanations]
    )


def labelled_campaign(evidence: Evidence, truth: Sequence[str]) -> LabelledCampaign:
    """Label the explanations of a campaign by its truth (as in ``are_true``)."""
    explanations, table = numbers(evidence)
    return LabelledCampaign(table, are_true(explanations, truth))


def fit(evidence: Sequence[Evidence], truths: Sequence[tuple[str, ...]], penalty: float) -> Array:
    """Weights (len(NAMES),) with the largest penalised likelihood of the truths.

    Campaigns none of whose explanations is true are ignored.

    Args:
        truths: true effects of each campaign, as in ``are_true``.
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
    """``fit`` for labelled campaigns; without any that counts, the prior mean.

    Args:
        start: (len(NAMES),) weights to start the search from, to save time; None: prior mean.
        prior_mean: (len(NAMES),) prior mean of the weights; None: zero.
    """
    prior_mean = np.zeros(len(NAMES)) if prior_mean is None else prior_mean
    labelled = [campaign for campaign in labelled if campaign.true.any()]
    if not labelled:
        return prior_mean
    table = np.concatenate([campaign.table for campaign in labelled])
    true = np.concatenate([campaign.true for campaign in labelled])
    sizes = np.array([len(campaign.true) for campaign in labelled])
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
