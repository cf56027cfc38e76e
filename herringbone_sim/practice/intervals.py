"""Confidence intervals of figures: Wilson's for fractions, bootstrap for the rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.basins import wilson

REPEATS = 1000


@dataclass(frozen=True)
class IntervalEstimate:
    """A number with its 95 % interval.

    Attributes:
        value, low, high: NaN if there are no cases.
        n: number of cases.
    """

    value: float
    low: float
    high: float
    n: int


NOTHING = IntervalEstimate(float("nan"), float("nan"), float("nan"), 0)


def share(hits: Sequence[bool]) -> IntervalEstimate:
    """Return the fraction of True with its 95 % Wilson interval."""
    n = len(hits)
    if n == 0:
        return NOTHING
    return IntervalEstimate(sum(hits) / n, *wilson(sum(hits), n), n)


def bootstrap(rows: Array, statistic: Callable[[Array], Any]) -> IntervalEstimate:
    """Return a statistic of rows (n, ...) with its 95 % interval from 1000 bootstrap resamples.

    Resamples without a finite statistic (such as an AUROC of one class) are ignored.
    """
    n = len(rows)
    if n == 0:
        return NOTHING
    rng = np.random.default_rng(0)
    drawn = [float(statistic(rows[rng.integers(0, n, n)])) for _ in range(REPEATS)]
    finite = [value for value in drawn if np.isfinite(value)]
    low, high = np.percentile(finite, [2.5, 97.5]) if finite else (float("nan"), float("nan"))
    return IntervalEstimate(float(statistic(rows)), float(low), float(high), n)


def auroc(rows: Array) -> float:
    """Return the area under the ROC curve; NaN if one class is missing.

    Args:
        rows: (n, 2) score, and 1 for a positive case or 0 for a negative one.
    """
    positive, negative = rows[rows[:, 1] > 0.5, 0], rows[rows[:, 1] <= 0.5, 0]
    if not len(positive) or not len(negative):
        return float("nan")
    above = np.sign(positive[:, None] - negative[None, :])
    return float(np.mean(0.5 + 0.5 * above))


def calibration_error(rows: Array) -> float:
    """Return the expected calibration error, in ten bins, of probabilities.

    Args:
        rows: (n, 2) stated probability, and 1 if the statement is true or 0 if not.
    """
    where = np.minimum((rows[:, 0] * 10).astype(int), 9)
    gaps = [abs(np.sum(rows[where == b, 0] - rows[where == b, 1])) for b in range(10)]
    return float(np.sum(gaps) / len(rows))
