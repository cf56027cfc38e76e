"""Noise that a campaign does not give: what nothing predicts of the fit without effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.flexible import Predictable
from herringbone_sim.diagnosis.products import Block, residual_without_nuisance
from herringbone_sim.diagnosis.search import MIN_GAIN_PER_VALUE

# Fraction of an observation's rows assumed to contain no more than noise; chosen.
NOISE_QUANTILE = 0.25
OFFSET_SHARE = 0.5  # least part of the predictable chi2 that offsets explain; chosen


def offset_sds(
    blocks: Sequence[Mapping[str, Block]],
    predicted: float,
    noise: Mapping[str, Array] | None = None,
) -> tuple[dict[str, Array], float]:
    """Standard deviation, from run to run, of a constant error of each of R rows, as drift is.

    The mean of the runs is not an offset, as an effect or a bias has it too; what noise gives is
    taken off. The offsets of all rows are kept if together they explain more than
    ``MIN_GAIN_PER_VALUE`` per value, or more than chance does and at least ``OFFSET_SHARE`` of
    ``predicted``.

    Args:
        blocks: of each run, about a fit; by observation.
        predicted: chi2 that the flexible regression predicts in the fit without effects.
        noise: (runs, R) actual over assumed noise, by observation; 1 where none is given.

    Returns:
        (R,) in units of the RMS of the row's assumed noise, by observation, and the chi2 that the
        offsets explain; empty and 0 where they are small.
    """
    sds: dict[str, Array] = {}
    explained = count = by_chance = 0.0
    for o in {o: None for of_run in blocks for o in of_run}:
        at = [r for r, b in enumerate(blocks) if o in b]
        means, variances = np.stack([_means(blocks[r][o]) for r in at], axis=1)
        factor = np.mean(noise[o][at] ** 2, axis=0) if noise and o in noise else 1.0
        values = float(
            np.mean([len(b.residual) * b.independent_share for b in (blocks[r][o] for r in at)])
        )
        recorded = np.isfinite(means)
        runs = np.maximum(recorded.sum(axis=0), 1)
        means, variances = np.where(recorded, means, 0.0), np.where(recorded, variances, 0.0)
        squares = np.sum(means**2, axis=0) - np.sum(means, axis=0) ** 2 / runs
        by_noise = factor * np.sum(variances, axis=0) / runs
        variance = np.maximum(squares / np.maximum(runs - 1, 1) - by_noise, 0.0)
        sds[o] = np.sqrt(variance)
        explained += values * float(((runs - 1) * variance / factor).sum())
        count += values * float(recorded.sum())
        by_chance += float((runs - 1).sum())
    least = min(MIN_GAIN_PER_VALUE * count, max(by_chance, OFFSET_SHARE * predicted))
    return (sds, explained) if explained > least else ({}, 0.0)


def _means(block: Block) -> tuple[Array, Array]:
    """Weighted mean (R,) of each row over a run, and its variance by the assumed noise.

    Without nuisances, in units of the RMS of that noise; NaN in rows that are not recorded.
    """
    whitened = residual_without_nuisance(block)
    weight = np.sum(block.sigma**-2.0, axis=0)
    size = np.sqrt(np.mean(block.sigma**2, axis=0))
    known = np.any(whitened, axis=0)
    mean = np.where(known, np.sum(whitened / block.sigma, axis=0) / weight / size, np.nan)
    return mean, 1.0 / (block.independent_share * weight * size**2)


def noise_factors(predictable: Predictable) -> Array:
    """Factors (runs, R) on the assumed noise of each row (standard deviation), 1 or more.

    The square of a factor is 2 ``left`` - ``chi2`` per value: the part of the row's chi2 that
    can't be predicted, less the part that can. It is at most the quantile ``NOISE_QUANTILE`` of
    this number over the rows of the same run: sensors of a kind are alike, so an excess in few
    rows is not noise.

    Args:
        predictable: predictable part of the residual of one observation.
    """
    share = (2.0 * predictable.left - predictable.chi2) / np.maximum(predictable.count, 1.0)
    limits = np.ones((len(share), 1))
    for of_run, known, limit in zip(share, predictable.count > 0.0, limits, strict=True):
        if known.any():
            limit[0] = np.quantile(of_run[known], NOISE_QUANTILE)
    return np.asarray(np.sqrt(np.clip(share, 1.0, np.maximum(limits, 1.0))))


def less_noise(
    assumed: Mapping[str, Array], remainder: Mapping[str, Predictable]
) -> dict[str, Array] | None:
    """Estimate the noise factors again, from the residual of an effect; at most those assumed.

    The response to some effects, such as a damaged tooth, can't be predicted, so that without the
    effect it was taken for noise.

    Args:
        assumed: (runs, R) factors by observation.
        remainder: predictable part of the residual of the effect, for these factors.

    Returns:
        (runs, R) factors by observation; None where they fall by too little.
    """
    factors = {}
    for o, p in remainder.items():
        of_machine = p.with_noise_scaled(1.0 / assumed[o])
        factors[o] = np.minimum(noise_factors(of_machine), assumed[o])
    fallen = max(float(np.mean(1.0 - (factors[o] / assumed[o]) ** 2)) for o in factors)
    return factors if fallen > MIN_GAIN_PER_VALUE else None
