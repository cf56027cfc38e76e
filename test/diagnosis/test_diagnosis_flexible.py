"""What measured quantities predict of a residual: laws by construction, and noise."""

from __future__ import annotations

import numpy as np
import pytest

from herringbone_sim.diagnosis.flexible import (
    MAX_SAMPLES,
    Predictable,
    RegressionInputs,
    predict_residuals,
)
from herringbone_sim.diagnosis.noise import noise_factors


@pytest.fixture(scope="module")
def measured():
    """Three runs of four measured values, an angle and a spring's force, and six blocks each."""
    rng = np.random.default_rng(2)
    around = [
        RegressionInputs(
            rng.normal(size=(1500, 1, 4)),
            np.linspace(0.0, 200.0, 1500)[:, None],
            np.stack([np.ones((1500, 1)), rng.normal(size=(1500, 1))], axis=2),
        )
        for _ in range(3)
    ]
    return rng, around, [np.repeat(np.arange(6), 250)] * 3


def test_noise_is_not_predictable(measured):
    rng, around, blocks = measured
    found = predict_residuals([rng.normal(size=(1500, 1)) for _ in around], around, blocks)
    assert np.all(found.left > 0.99 * found.chi2)
    assert found.count.sum() == 4500


@pytest.mark.parametrize(
    "law",
    [
        lambda s: np.sin(s.values[:, :, 0]) + 0.5 * np.cos(2.0 * s.values[:, :, 2]),
        lambda s: np.cos(2.0 * s.angles + 1.0) * s.factors[:, :, 1],
        lambda s: np.tanh(s.values[:, :, 1]) * s.factors[:, :, 1],
    ],
    ids=["force", "stiffness by angle", "stiffness by a value"],
)
def test_most_of_a_smooth_factor_of_what_is_measured_is_predictable(measured, law):
    rng, around, blocks = measured
    noisy = [3.0 * law(s) + rng.normal(size=(1500, 1)) for s in around]
    found = predict_residuals(noisy, around, blocks)
    noise = found.count.sum()
    assert found.left.sum() - noise < 0.25 * (found.chi2.sum() - noise)


def test_what_repeats_with_the_turn_of_a_member_is_predictable_whatever_its_shape():
    """Fifteen waves of random orders below two of the mesh; random features don't follow them."""
    rng = np.random.default_rng(4)
    phase = np.linspace(0.0, 2.0 * np.pi * 120.0, 2400)[:, None]
    orders, at = rng.choice(np.arange(1, 51), 15, replace=False), rng.uniform(0.0, 6.0, 15)
    shape = np.cos(phase / 25.0 * orders + at).sum(axis=1, keepdims=True)
    runs = [
        RegressionInputs(
            rng.normal(size=(2400, 1, 2)), np.hstack([phase, phase / 25.0]), np.ones((2400, 1, 1))
        )
        for _ in range(2)
    ]
    blocks = [np.repeat(np.arange(20), 120)] * 2
    noisy = [2.0 * shape + rng.normal(size=(2400, 1)) for _ in runs]
    found = predict_residuals(noisy, runs, blocks)
    assert found.chi2.sum() > 10.0 * found.count.sum()
    assert found.left.sum() < 2.0 * found.count.sum()
    noise = [rng.normal(size=(2400, 1)) for _ in runs]
    assert predict_residuals(noise, runs, blocks).predicted < 0.01 * 4800.0


def test_a_row_that_a_run_does_not_have_is_left_at_zero(measured):
    """Other runs predict something for its zeros; that counts neither as left nor as a value."""
    rng, around, blocks = measured
    noisy = [0.3 * np.sin(s.values[:, :, 0]) + rng.normal(size=(1500, 1)) for s in around]
    noisy[1] = np.zeros_like(noisy[1])
    found = predict_residuals(noisy, around, blocks)
    assert (found.chi2[1], found.left[1], found.count[1]) == (0.0, 0.0, 0.0)
    assert found.predicted > 0.0
    some = Predictable(
        np.array([[0.0, 0.0], [400.0, 400.0]]),
        np.array([[0.0, 0.0], [400.0, 400.0]]),
        np.array([[0.0, 0.0], [100.0, 100.0]]),
    )
    np.testing.assert_allclose(noise_factors(some), [[1.0, 1.0], [2.0, 2.0]])


def test_a_law_of_the_mesh_phase_is_predictable_from_few_of_its_samples():
    """12 samples a mesh cycle, one of 12 used: not always the same one of the cycle."""
    rng, n = np.random.default_rng(3), 72_000
    angles = 2.0 * np.pi * np.arange(n)[:, None] / 12.0
    around = RegressionInputs(np.zeros((n, 1, 1)), angles, np.ones((n, 1, 1)))
    noisy = 3.0 * np.cos(angles) + rng.normal(size=(n, 1))
    found = predict_residuals([noisy], [around], [np.arange(n) // 72])
    assert found.count.sum() == MAX_SAMPLES
    assert found.left.sum() < 1.2 * found.count.sum()
    assert found.chi2.sum() == pytest.approx(5.5 * found.count.sum(), rel=0.05)  # 1 + 3^2 / 2


def test_larger_noise_makes_less_of_the_same_squares(measured):
    rng, around, blocks = measured
    found = predict_residuals([rng.normal(size=(1500, 1)) for _ in around], around, blocks)
    beside = found.with_noise_scaled(np.full((3, 1), 2.0))
    np.testing.assert_allclose(beside.left, 0.25 * found.left)
    np.testing.assert_allclose(beside.count, found.count)
