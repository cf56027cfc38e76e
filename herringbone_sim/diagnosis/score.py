"""Leave-one-run-out prediction error of a linearised fit, at the prior scale that predicts best.

chi2 is a whitened sum of squares: noise alone contributes 1 per value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import CampaignProducts, Coefficient
from herringbone_sim.diagnosis.regression import LeftOut, leave_one_out

# Chosen, not fitted: bound of a departure from the catalogue's curve, in its prior standard
# deviations.
MAX_DEPARTURE_SD = 3.0
# Iterations between the size of an effect and the prior of its departures; chosen.
DEPARTURE_ROUNDS = 2
# Factors tried on the prior of an effect's size (1: moderate effect), half a decade apart; chosen.
PRIOR_SCALES = (0.03, 0.1, 0.3, 1.0, 3.0)

ROUNDED = 1e-3  # largest rounding error of the chi2 of a run whose linear prediction is used


@dataclass(frozen=True)
class Score:
    """Fit of p coefficients and its leave-one-run-out prediction error.

    Attributes:
        coefficients: tolerances first.
        mean: (p,) posterior mean from all runs.
        covariance: (p, p) posterior covariance for the assumed noise.
        leave_one_out_means: (runs, p) posterior means, each without one run.
        chi2: (runs,) chi2 left of each run when predicted from the others.
        in_sample: chi2 left when all runs are fitted.
        log_density: sum of log predictive densities of the left-out runs, up to a constant.
        prior_scale: factor on the priors that predicted best, see ``PRIOR_SCALES``.
        chi2_by_row: (runs, R) chi2 left in sample, by observation.
        count: number of whitened values.
        by_density: whether ``loss`` is by ``log_density``, as where states are estimated.
    """

    coefficients: tuple[Coefficient, ...]
    mean: Array
    covariance: Array
    leave_one_out_means: Array
    chi2: Array
    in_sample: float
    log_density: float
    prior_scale: float
    chi2_by_row: Mapping[str, Array]
    count: float = 0.0
    by_density: bool = False

    @property
    def loss(self) -> float:
        """Prediction error of the left-out runs: their chi2, or -2 times ``log_density``.

        The density accounts for the uncertainty of coefficients fitted to few values; where they
        are certain, both losses are equal.
        """
        return -2.0 * self.log_density if self.by_density else float(self.chi2.sum())

    def covariance_with_jackknife(self) -> Array:
        """(p, p) posterior covariance plus the jackknife covariance over runs.

        The posterior assumes white noise; the jackknife also contains model error that differs
        between runs. It is widened by the squared ratio of Student's to normal 95 % quantiles. Of
        a single run, the posterior covariance alone.
        """
        runs = len(self.leave_one_out_means)
        if runs < 2:
            return self.covariance
        off = self.leave_one_out_means - self.leave_one_out_means.mean(axis=0)
        wide = float(student.ppf(0.95, runs - 1) / norm.ppf(0.95)) ** 2
        jackknife: Array = wide * (runs - 1) / runs * off.T @ off
        return self.covariance + jackknife


def compute_score(
    campaign: CampaignProducts,
    coefficients: Sequence[Coefficient],
    mean: Array | None = None,
    sizes: Sequence[float] = PRIOR_SCALES,
    by_density: bool = False,
) -> Score:
    """Score a linearised campaign, at the prior scale with the best predictive density.

    The scale multiplies the priors of ``coefficients`` with ``scales_with_effect``; those of
    departures then follow the fitted size of their effect. A run with columns so large that
    rounding errors decide its chi2 at the centre of the prior (``ROUNDED``) counts with its chi2
    at the point of linearisation.

    Args:
        campaign: products formed about ``mean``.
        coefficients: of a hypothesis, beyond those of ``campaign.base``.
        mean: (p,) point of linearisation, coefficients of the base first; None: zero.
        sizes: prior scales to try.
        by_density: as in ``Score``.

    Returns:
        Score without ``chi2_by_row`` and ``count``.
    """
    with_base = (*campaign.base, *coefficients)
    A, b = campaign.normal_equations(coefficients)
    n = len(campaign.base)
    center = np.array([c.center for c in with_base])
    # Shift the origin from ``mean`` to the centre of the prior.
    off = center - (np.zeros(len(with_base)) if mean is None else mean)
    chi2 = campaign.chi2 - chi2_reduction(A, b, off)
    b = b - A @ off
    resolved = np.finfo(float).eps * chi2 < ROUNDED
    prior, bound = np.array([c.sd for c in with_base]), np.array([c.bound for c in with_base])
    best: tuple[float, LeftOut, float, Array] | None = None
    sized = np.array([i >= n and c.scales_with_effect for i, c in enumerate(with_base)])
    reach = trust_region(with_base)
    for size in sizes if sized.any() else (1.0,):
        sd = prior * np.where(sized, size, 1.0)
        left_out = leave_one_out(A, b, sd, bound, reach)
        density = float(left_out.log_density[resolved].sum())
        if best is None or density > best[0]:
            best = density, left_out, size, sd
    assert best is not None
    density, left_out, size, sd = best
    bent = np.array([c.departs_from > 0 for c in with_base])
    for _ in range(DEPARTURE_ROUNDS if bent.any() else 0):
        sd = np.where(bent, prior * _effect_sizes(with_base, center + left_out.whole.mean), sd)
        left_out = leave_one_out(A, b, sd, np.where(bent, MAX_DEPARTURE_SD * sd, bound), reach)
        density = float(left_out.log_density[resolved].sum())
    fit = left_out.whole
    left_out_chi2 = np.where(resolved, chi2 - left_out.fall, campaign.chi2)
    in_sample = np.where(resolved, chi2 - chi2_reduction(A, b, fit.mean), campaign.chi2)
    at_zero = np.where(resolved, chi2, campaign.chi2)
    return Score(
        with_base,
        center + fit.mean,
        fit.covariance,
        center + left_out.means,
        left_out_chi2,
        float(in_sample.sum()),
        density - 0.5 * float(at_zero.sum()),
        size,
        {},
        by_density=by_density,
    )


def trust_region(coefficients: Sequence[Coefficient]) -> Array:
    """Return the largest step (p,) of each coefficient for which a linearisation is trusted.

    The prior standard deviation where columns change with the amplitudes, else inf.
    """
    return np.array([np.inf if c.scales_with_effect else c.sd for c in coefficients])


def _effect_sizes(coefficients: Sequence[Coefficient], mean: Array) -> Array:
    """(p,) for each departure, the fitted size of its effect over a moderate one; elsewhere 1."""
    sizes, size = np.ones(len(mean)), 1.0
    for i, c in enumerate(coefficients):
        if c.departs_from and not coefficients[i - 1].departs_from:
            effect_indices = range(i - c.departs_from, i)
            size = max(abs(mean[j]) / coefficients[j].sd for j in effect_indices)
        if c.departs_from:
            sizes[i] = size
    return np.maximum(sizes, PRIOR_SCALES[0] ** 2)


def chi2_reduction(A: Array, b: Array, step: Array) -> Array:
    """(runs,) decrease of the chi2 by a step (p,) of the coefficients, in the linear model."""
    fall: Array = 2.0 * b @ step - np.einsum("i,rij,j->r", step, A, step)
    return fall
