"""Growth of perturbations: its mean over many periods is an exponent, batches give the error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.errors import AnalysisError

Array = NDArray[np.float64]

BATCHES = 20


@dataclass(frozen=True)
class Growth:
    """Logarithmic growth of k perturbations along one motion.

    Attributes:
        logarithms: (periods, k) logarithm of the growth in each period, in the order of growth.
        period: time that one of them took.
        end: (n,) state after the last period.
    """

    logarithms: Array
    period: float
    end: Array

    @property
    def exponents(self) -> Array:
        """(k,) exponents per unit of time, descending."""
        mean: Array = self.logarithms.mean(axis=0) / self.period
        return mean

    @property
    def errors(self) -> Array:
        """(k,) standard errors of the exponents, from batches of the motion.

        Successive periods depend on each other; means over 20 batches hardly do, as long as a
        batch is longer than the memory of the motion.
        """
        return batch_error(self.logarithms) / self.period

    @property
    def running(self) -> Array:
        """(periods, k) exponents as they stood after 1, 2, ... periods: their convergence."""
        count = np.arange(1, len(self.logarithms) + 1)[:, None]
        means: Array = np.cumsum(self.logarithms, axis=0) / (count * self.period)
        return means

    def finite_time(self, periods: int) -> Array:
        """(m, k) exponents over consecutive stretches of so many periods."""
        m = len(self.logarithms) // periods
        whole = self.logarithms[: m * periods].reshape(m, periods, -1)
        means: Array = whole.mean(axis=1) / self.period
        return means


def batch_error(values: Array, batches: int = BATCHES) -> Array:
    """Standard error (k,) of the mean of dependent values (m, k), from means over batches.

    Raises:
        AnalysisError: fewer values than batches.
    """
    if len(values) < batches:
        raise AnalysisError(
            f"an error needs at least {batches} periods, got {len(values)}: take more"
        )
    means = np.array([part.mean(axis=0) for part in np.array_split(values, batches)])
    error: Array = means.std(axis=0, ddof=1) / np.sqrt(batches)
    return error


def descending(logarithms: Array, period: float, end: Array) -> Growth:
    """Growth with its columns in descending order of their means."""
    order = np.argsort(-logarithms.mean(axis=0), kind="stable")
    return Growth(logarithms[:, order], period, end)
