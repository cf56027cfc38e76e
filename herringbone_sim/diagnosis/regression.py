"""Bounded Gaussian regression from normal equations stored run by run.

A model is y_r = Phi_r theta + noise for every run r, whitened so that the noise has unit variance,
with theta_i ~ N(0, sd_i^2) and ``|theta_i| <= bound_i``. The data enter by
A_r = Phi_r' Phi_r and b_r = Phi_r' y_r alone, so that leaving a run out is a subtraction
(MacKay, Neural Computation 4, 415, 1992; leave-one-out as in Rasmussen and Williams 2006, 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from herringbone_sim.arrays import Array, Flags


@dataclass(frozen=True)
class Solution:
    """Posterior of the coefficients.

    Attributes:
        mean: (p,) posterior mean inside the bounds.
        covariance: (p, p); zero for coefficients at a bound.
    """

    mean: Array
    covariance: Array


def solve(A: Array, b: Array, sd: Array, bound: Array, near: Array | None = None) -> Solution:
    """Solve for the posterior mean inside the bounds, and its covariance.

    Block principal pivoting: coefficients outside their bounds are fixed there, fixed ones whose
    gradient points inwards are released, and the free ones are solved again; one exchange at a
    time where block exchanges cycle (Judice and Pires, Computers & Operations Research 21, 587,
    1994).

    Args:
        A, b: (p, p), (p,) normal equations, summed over runs.
        sd, bound: (p,) prior standard deviations, and largest magnitudes (inf: unbounded).
        near: (p,) mean of a similar problem, whose coefficients at a bound are fixed there first,
            to save time; None: none is.

    Returns:
        The posterior, with coefficients at a bound treated as certain. For a singular matrix, or
        where exchanges don't end: mean zero and the covariance of the prior.
    """
    found = _within_bounds(A, b, sd, bound, near)
    if found is None:
        return Solution(np.zeros(len(b)), np.diag(sd**2))
    mean, free, factor, scale = found
    covariance = np.zeros(A.shape)
    covariance[np.ix_(free, free)] = _solved(factor, np.eye(len(scale))) * np.outer(scale, scale)
    return Solution(mean, covariance)


def posterior_mean(
    A: Array, b: Array, sd: Array, bound: Array, near: Array | None = None
) -> Array:
    """Posterior mean (p,) inside the bounds alone, as of ``solve``, in less time."""
    found = _within_bounds(A, b, sd, bound, near)
    return np.zeros(len(b)) if found is None else found[0]


def _within_bounds(
    A: Array, b: Array, sd: Array, bound: Array, near: Array | None
) -> tuple[Array, Flags, Array, Array] | None:
    """Mean (p,), which coefficients are free (p,), and the factor of their scaled matrix.

    Returns:
        Mean, free coefficients, Cholesky factor (f, f) of the scaled matrix of the free ones, and
        the scale (f,); None for a singular matrix, or where exchanges don't end. See ``solve``.
    """
    p = len(b)
    mean, held = np.zeros(p), np.zeros(p, dtype=bool)
    if near is not None:
        held = np.abs(near) >= bound
        mean[held] = np.copysign(bound, near)[held]
    precision = 1.0 / sd**2
    fewest, patience = p + 1, 3
    for _ in range(10 * (p + 1)):  # a few in practice; rounding may make ties cycle
        free, any_held = ~held, held.any()
        right = b[free] - A[np.ix_(free, held)] @ mean[held] if any_held else b
        whole = A[np.ix_(free, free)] if any_held else A.copy()
        diagonal = np.einsum("ii->i", whole)
        diagonal += precision[free]
        if not (diagonal > 0.0).all():
            return None
        scale = 1.0 / np.sqrt(diagonal)
        whole *= np.outer(scale, scale)
        diagonal += 1e-12
        factor, failed = dpotrf(np.asarray_chkfinite(whole))
        if failed:
            return None
        mean[free] = scale * _solved(factor, np.asarray_chkfinite(scale * right))
        outside = free & (np.abs(mean) > bound * (1.0 + 1e-9))
        wrong = outside
        if any_held:
            slope = b - A @ mean - precision * mean
            tiny = 1e-9 * (np.abs(b) + np.abs(A) @ np.abs(mean))
            wrong = outside | (held & (slope * np.sign(mean) < -tiny))
        if not wrong.any():
            return np.clip(mean, -bound, bound), free, factor, scale
        if wrong.sum() < fewest:
            fewest, patience = int(wrong.sum()), 3
        elif patience:
            patience -= 1
        else:
            wrong[: np.flatnonzero(wrong)[-1]] = False
        held ^= wrong
        mean[held] = np.clip(mean, -bound, bound)[held]
    return None


def _solved(factor: Array, right: Array) -> Array:
    """Solve with a Cholesky factor; ``scipy.linalg.cho_solve`` takes over twice the time."""
    return np.asarray(dpotrs(factor, right)[0]) if right.size else right


@dataclass(frozen=True)
class LeftOut:
    """Leave-one-run-out prediction.

    Attributes:
        fall: (runs,) chi2 of each run at theta = 0 minus that when predicted from the others.
        log_density: (runs,) log predictive density minus that of theta = 0.
        whole: solution from all runs.
        means: (runs, p) solutions, each without one run; of a single run, ``whole``.
    """

    fall: Array
    log_density: Array
    whole: Solution
    means: Array


def leave_one_out(
    A: Array, b: Array, sd: Array, bound: Array, reach: Array | None = None
) -> LeftOut:
    """Predict every run from the others; a single run is predicted from itself.

    Args:
        A: (runs, p, p) Gram matrices of the whitened columns.
        b: (runs, p) products of columns and whitened residual.
        sd, bound: (p,) prior standard deviations, and largest magnitudes (inf: unbounded).
        reach: (p,) largest step from the solution of all runs to one without a run, for which
            the linearisation holds; None: unlimited.
    """
    whole = solve(A.sum(0), b.sum(0), sd, bound)
    runs = len(b)
    fall, density, means = np.zeros(runs), np.zeros(runs), np.zeros((runs, len(whole.mean)))
    for r in range(runs):
        if runs == 1:
            rest = whole
        else:
            keep = np.arange(runs) != r
            rest = solve(A[keep].sum(0), b[keep].sum(0), sd, bound, whole.mean)
            rest = replace(rest, mean=whole.mean + within(rest.mean - whole.mean, reach))
        means[r] = rest.mean
        fall[r] = 2.0 * b[r] @ rest.mean - rest.mean @ A[r] @ rest.mean
        density[r] = 0.5 * fall[r] + 0.5 * _log_density_correction(A[r], b[r], rest)
    return LeftOut(fall, density, whole, means)


def within(step: Array, reach: Array | None) -> Array:
    """Return a step (p,), scaled down so that no coefficient moves beyond its ``reach`` (p,)."""
    if reach is None:
        return step
    return step / max(1.0, float(np.max(np.abs(step) / reach, initial=0.0)))


def _log_density_correction(A: Array, b: Array, rest: Solution) -> float:
    """Twice the term of a run's log density by the covariance S of theta.

    r' S (1 + A S)^-1 r - log|1 + A S| with r = b - A mean; 0 where the determinant isn't positive.
    """
    left = b - A @ rest.mean
    middle = np.eye(len(b)) + A @ rest.covariance
    sign, log_det = np.linalg.slogdet(middle)
    if sign <= 0:
        return 0.0
    return float(left @ rest.covariance @ np.linalg.solve(middle, left) - log_det)
