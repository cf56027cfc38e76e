"""Regression with bounds, evidence and leave-one-run-out against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.stats import multivariate_normal

from herringbone_sim.diagnosis import regression
from herringbone_sim.diagnosis.regression import leave_one_out, posterior_mean, solve


def density(y, Phi, sd, mean=0.0):
    """log N(y; Phi mean, 1 + Phi sd^2 Phi') relative to log N(y; 0, 1)."""
    n = len(y)
    spread = np.eye(n) + Phi @ np.diag(sd**2) @ Phi.T
    center = Phi @ (np.zeros(Phi.shape[1]) + mean)
    of_model = multivariate_normal(center, spread).logpdf(y)
    return of_model - multivariate_normal(np.zeros(n), np.eye(n)).logpdf(y)


def problem(seed, most=12):
    """Phi, y, sd and bounds of a regression whose columns are correlated."""
    rng = np.random.default_rng(seed)
    p = rng.integers(1, most)
    mixing = np.eye(p) + rng.uniform(0.0, 2.0) * rng.normal(size=(p, p))
    Phi = rng.normal(size=(40, p)) @ mixing
    y = Phi @ rng.normal(size=p) + rng.normal(size=40)
    bound = np.where(rng.random(p) < 0.7, rng.uniform(0.05, 1.5, p), np.inf)
    return Phi, y, rng.uniform(0.3, 3.0, p), bound


def test_a_solution_whose_bounds_never_settle_is_not_taken_for_one(monkeypatch):
    """A solver that always ends outside: bound and free take turns for ever."""
    monkeypatch.setattr(regression, "_solved", lambda factor, right: np.full_like(right, 5.0))
    found = solve(np.eye(1), np.zeros(1), np.ones(1), np.ones(1))
    assert (found.mean, found.covariance) == (0.0, 1.0)


@pytest.mark.parametrize("start", range(0, 100, 25))
def test_bounded_solutions_are_those_of_least_squares_in_a_box(start):
    held = 0
    for seed in range(start, start + 25):
        Phi, y, sd, bound = problem(seed)
        found = solve(Phi.T @ Phi, Phi.T @ y, sd, bound)
        tall, right = np.vstack([Phi, np.diag(1.0 / sd)]), np.append(y, np.zeros(len(sd)))
        expected = lsq_linear(tall, right, (-bound, bound), method="bvls", tol=1e-15).x
        np.testing.assert_allclose(found.mean, expected, rtol=0.0, atol=1e-9)
        alone = posterior_mean(Phi.T @ Phi, Phi.T @ y, sd, bound)
        assert np.array_equal(alone, found.mean)
        for near in (found.mean, -found.mean, np.where(np.isfinite(bound), -bound, 5.0)):
            again = posterior_mean(Phi.T @ Phi, Phi.T @ y, sd, bound, near)
            np.testing.assert_allclose(again, found.mean, rtol=0.0, atol=1e-9)
        held += np.sum(np.abs(expected) == bound)
    assert held > 10  # else the bounds are not tried


def test_the_covariance_is_that_of_the_posterior():
    for seed in range(20):
        Phi, y, sd, _ = problem(seed)
        found = solve(Phi.T @ Phi, Phi.T @ y, sd, np.full(len(sd), np.inf))
        spread = np.linalg.inv(Phi.T @ Phi + np.diag(sd**-2.0))
        np.testing.assert_allclose(found.covariance, spread, rtol=1e-7, atol=1e-10)


def test_coefficients_at_their_bounds_are_certain():
    for seed in range(20):
        Phi, y, sd, bound = problem(seed)
        found = solve(Phi.T @ Phi, Phi.T @ y, sd, bound)
        held = np.abs(found.mean) == bound
        assert not found.covariance[held].any()
        free = Phi[:, ~held]
        spread = np.linalg.inv(free.T @ free + np.diag(sd[~held] ** -2.0))
        of_free = found.covariance[np.ix_(~held, ~held)]
        np.testing.assert_allclose(of_free, spread, rtol=1e-7, atol=1e-10)


def test_runs_left_out_are_predicted_by_a_regression_on_the_others():
    rng = np.random.default_rng(5)
    Phi, y = rng.normal(size=(4, 15, 3)), rng.normal(size=(4, 15))
    y += Phi @ [0.5, -1.0, 0.2]
    sd, free = np.array([0.5, 1.0, 2.0]), np.full(3, np.inf)
    A, b = np.einsum("rni,rnj->rij", Phi, Phi), np.einsum("rni,rn->ri", Phi, y)
    found = leave_one_out(A, b, sd, free)
    for r in range(4):
        others = np.arange(4) != r
        X, z = Phi[others].reshape(-1, 3), y[others].ravel()
        spread = np.linalg.inv(X.T @ X + np.diag(sd**-2.0))
        mean = spread @ X.T @ z
        np.testing.assert_allclose(found.means[r], mean, atol=1e-9)
        fall = y[r] @ y[r] - np.sum((y[r] - Phi[r] @ mean) ** 2)
        assert found.fall[r] == pytest.approx(fall, abs=1e-8)
        roots, turns = np.linalg.eigh(spread)
        predicted = density(y[r], Phi[r] @ turns, np.sqrt(roots), turns.T @ mean)
        assert found.log_density[r] == pytest.approx(predicted, abs=1e-8)
