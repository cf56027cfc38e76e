"""Fit the weights of the judge to campaigns whose truth is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from herringbone_sim.arrays import Array, Flags, Indices
from herringbone_sim.diagnosis.evidence import Evidence
from herringbone_sim.diagnosis.judge import NAMES, Explanation, numbers

GRADIENT = 1e-4  # of the loss, at which a fit ends: Newton's steps square the error


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
    stacked = _Stacked.of(labelled)
    if stacked is None:
        return prior_mean

    def loss(w: Array) -> tuple[float, Array]:
        value, slope = stacked.loss(w)
        off = w - prior_mean
        return value + 0.5 * penalty * float(off @ off), slope + penalty * off

    def hessian(w: Array) -> Array:
        return stacked.hessian(w) + penalty * np.eye(len(w))

    start = prior_mean if start is None else start
    found = minimize(
        loss, start, jac=True, hess=hessian, method="trust-exact", options={"gtol": GRADIENT}
    )
    return np.asarray(found.x)


def log_loss(labelled: Sequence[LabelledCampaign], weights: Array) -> float:
    """Sum of -log(probability on the truth) by ``weights``, of the campaigns that ``fit`` uses."""
    stacked = _Stacked.of(labelled)
    return 0.0 if stacked is None else stacked.loss(weights)[0]


@dataclass(frozen=True)
class _Stacked:
    """Explanations of all campaigns one below another.

    Attributes:
        table: (m, len(NAMES)) numbers of the explanations.
        true: (m,) which of them are true.
        sizes: number of explanations of each campaign.
        starts: index of the first explanation of each campaign.
    """

    table: Array
    true: Flags
    sizes: Indices
    starts: Indices

    @staticmethod
    def of(labelled: Sequence[LabelledCampaign]) -> _Stacked | None:
        """Stack the campaigns with a true explanation; None without any."""
        labelled = [campaign for campaign in labelled if campaign.true.any()]
        if not labelled:
            return None
        sizes = np.array([len(campaign.true) for campaign in labelled])
        return _Stacked(
            np.concatenate([campaign.table for campaign in labelled]),
            np.concatenate([campaign.true for campaign in labelled]),
            sizes,
            np.cumsum(sizes) - sizes,
        )

    def loss(self, w: Array) -> tuple[float, Array]:
        """Sum of -log(probability on the truth), and its gradient (len(NAMES),)."""
        p, p_true, on_truth = self._probabilities(w)
        return -float(np.log(on_truth).sum()), np.asarray((p - p_true) @ self.table)

    def hessian(self, w: Array) -> Array:
        """Second derivatives of ``loss``: covariances of the numbers by ``p`` and ``p_true``."""
        p, p_true, _ = self._probabilities(w)
        mean, mean_true = (
            np.add.reduceat(self.table * q[:, None], self.starts) for q in (p, p_true)
        )
        squares = (self.table * (p - p_true)[:, None]).T @ self.table
        return np.asarray(squares - mean.T @ mean + mean_true.T @ mean_true)

    def _probabilities(self, w: Array) -> tuple[Array, Array, Array]:
        """Return the probabilities (m,), those given the truth, and the sum on the truth."""
        score = self.table @ w
        score -= np.repeat(np.maximum.reduceat(score, self.starts), self.sizes)
        p = np.exp(score)
        p /= np.repeat(np.add.reduceat(p, self.starts), self.sizes)
        on_truth = np.maximum(np.add.reduceat(p * self.true, self.starts), 1e-300)
        return p, p * self.true / np.repeat(on_truth, self.sizes), on_truth
