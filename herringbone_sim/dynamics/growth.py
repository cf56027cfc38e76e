"""Logarithmic growth of perturbations: its mean over time is a Lyapunov exponent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.errors import AnalysisError

BATCHES = 20


@dataclass(frozen=True)
class Growth:
    """Logarithmic growth of k perturbations along one motion.

    Attributes:
        logarithms: (periods, k) log of the growth factor in each period, columns by descending
            mean.
        period: duration of one period, in the time unit of the flow.
        end: (n,) state after the last period.
    """

    logarithms: Array
    period: float
    end: Array

    @property
    def exponents(self) -> Array:
        """(k,) Lyapunov exponents per unit of time, descending."""
        mean: Array = self.logarithms.mean(axis=0) / self.period
        return mean

    @property
    def errors(self) -> Array:
        """(k,) standard errors of the exponents, from 20 batch means.

        Successive periods are correlated; batch means are not, if a batch is longer than the
        correlation time of the motion.
        """
        return batch_error(self.logarithms) / self.period

    @property
    def running(self) -> Array:
        """(periods, k) exponents averaged over the first 1, 2, ... periods: their convergence."""
        count = np.arange(1, len(self.logarithms) + 1)[:, None]
        means: Array = np.cumsum(self.logarithms, axis=0) / (count * self.period)
        return means

    def finite_time(self, periods: int) -> Array:
        """(m, k) finite-time exponents over m consecutive blocks of ``periods`` periods."""
        m = len(self.logarithms) // periods
        whole = self.logarithms[: m * periods].reshape(m, periods, -1)
        means: Array = whole.mean(axis=1) / self.period
        return means


def batch_error(values: Array) -> Array:
    """Standard error (k,) of the mean of correlated values (m, k), from batch means.

    Raises:
        AnalysisError: fewer values than ``BATCHES``.
    """
    if len(values) < BATCHES:
        raise AnalysisError(
            f"an error needs at least {BATCHES} periods, got {len(values)}: take more"
        )
    means = np.array([part.mean(axis=0) for part in np.array_split(values, BATCHES)])
    error: Array = means.std(axis=0, ddof=1) / np.sqrt(BATCHES)
    return error


def descending(logarithms: Array, period: float, end: Array) -> Growth:
    """Growth from unsorted columns (periods, k), sorted by descending mean; see ``Growth``."""
    order = np.argsort(-logarithms.mean(axis=0), kind="stable")
    return Growth(logarithms[:, order], period, end)
