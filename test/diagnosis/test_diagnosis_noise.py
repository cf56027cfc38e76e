"""Noise that nobody tells: known numbers of chi2, and blocks with offsets that are drawn here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from herringbone_sim.diagnosis.flexible import Predictable
from herringbone_sim.diagnosis.noise import less_noise, noise_factors, offset_sds
from herringbone_sim.diagnosis.products import Block, products, with_offsets


def runs_with(offsets, n=1000, noise=2.0):
    """A block for each run: white noise, offsets (runs, rows) of the rows over the noise."""
    rng = np.random.default_rng(7)
    runs, rows = np.shape(offsets)
    return [
        {
            "law": Block(
                "law",
                noise * (rng.normal(size=(n, rows)) + offsets[r]),
                np.full((n, rows), noise),
                (),
                np.zeros((n, rows, 0)),
                np.zeros((n, rows, 0)),
                np.zeros((rows, 0)),
                np.zeros((0, rows, 0)),
                np.zeros(0),
            )
        }
        for r in range(runs)
    ]


def test_noise_is_what_is_not_predictable_of_most_rows():
    """Eight rows: six at twice their noise, one that stands out, one of which half is foreseen."""
    count, chi2 = np.full((1, 8), 100.0), np.array([[4.0] * 6 + [100.0, 4.0]]) * 100.0
    left = chi2.copy()
    left[0, 7] = 0.5 * chi2[0, 7]
    found = noise_factors(Predictable(chi2, left, count))
    np.testing.assert_allclose(found[0, :6], 2.0)
    assert found[0, 6] == pytest.approx(2.0)  # no more than rows of its kind
    assert found[0, 7] == 1.0


def test_noise_is_no_more_than_what_an_effect_leaves():
    """The calibrated machine left four times the noise, of which an effect takes three."""
    assumed = {"windows": np.full((2, 1), 2.0)}

    def left(chi2, predicted):
        values = np.full((2, 1), chi2)
        return {"windows": Predictable(values, values - predicted, np.full((2, 1), 1000.0))}

    found = less_noise(assumed, left(250.0, 0.0))
    np.testing.assert_allclose(found["windows"], 1.0)
    found = less_noise(assumed, left(500.0, 0.0))
    np.testing.assert_allclose(found["windows"], np.sqrt(2.0))
    assert less_noise(assumed, left(1000.0, 0.0)) is None  # it leaves as much
    assert less_noise(assumed, left(1500.0, 0.0)) is None  # noise is never more than assumed


def test_an_offset_that_differs_from_run_to_run_is_drift():
    """Row 0 drifts, row 1 is biased alike in all runs, row 2 has neither."""
    offsets = np.array([[0.9, 0.8, 0.0], [-0.7, 0.8, 0.0], [0.1, 0.8, 0.0], [-0.3, 0.8, 0.0]])
    found = offset_sds(runs_with(offsets), np.inf)[0]["law"]
    assert found[0] == pytest.approx(np.std(offsets[:, 0], ddof=1), abs=0.05)
    assert np.all(found[1:] < 0.05)


def test_small_offsets_and_rows_of_a_single_run_are_no_drift():
    small = np.zeros((4, 3))
    small[:, 0] = [0.1, -0.1, 0.05, 0.0]
    assert offset_sds(runs_with(small), np.inf) == ({}, 0.0)
    alone = runs_with(np.array([[1.0], [0.0]]))
    alone[1]["law"] = replace(alone[1]["law"], residual=np.zeros((1000, 1)))
    assert offset_sds(alone, 0.0) == ({}, 0.0)


def test_small_offsets_count_if_little_else_can_be_predicted():
    """0.08 of the noise in 3 x 4 x 1000 values, some 80 of chi2: less than 2 %, more than chance
    and most of 100; white noise has none, even if nothing can be predicted."""
    small = 0.08 * np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [-1.0] * 3])
    of_runs = runs_with(small)
    assert offset_sds(of_runs, 1000.0) == ({}, 0.0)
    assert offset_sds(of_runs, 100.0)[0]
    assert offset_sds(runs_with(np.zeros((4, 12))), 0.0) == ({}, 0.0)


def test_offsets_are_in_units_of_a_noise_that_varies():
    """Half of the values have ten times the noise of the others; the offset is in one unit."""
    rng = np.random.default_rng(3)
    sigma = np.where(rng.random((1000, 1)) < 0.5, 1.0, 10.0)
    true = np.array([3.0, -2.0, 0.5, -1.0])
    of_runs = runs_with(np.zeros((4, 1)))
    for of_run, offset in zip(of_runs, true, strict=True):
        residual = sigma * rng.normal(size=(1000, 1)) + offset
        of_run["law"] = replace(of_run["law"], residual=residual, sigma=sigma)
    found = offset_sds(of_runs, np.inf)[0]["law"] * np.sqrt(np.mean(sigma**2))
    assert found[0] == pytest.approx(np.std(true, ddof=1), rel=0.1)


def test_more_noise_than_assumed_is_no_drift():
    """White noise of twice the assumed size, 50 values a run."""
    of_runs = runs_with(np.zeros((3, 12)), n=50)
    assumed = [{"law": replace(b["law"], sigma=0.5 * b["law"].sigma)} for b in of_runs]
    assert offset_sds(assumed, np.inf)[0]
    assert offset_sds(assumed, np.inf, {"law": np.full((3, 12), 2.0)}) == ({}, 0.0)


def test_an_allowed_offset_leaves_the_rest_of_the_noise():
    """One value of a thousand goes into the constant; without any, chi2 grows by its square."""
    of_run = runs_with(np.array([[1.5, 0.0]]))[0]["law"]
    assert products(of_run).chi2[0] == pytest.approx(1000.0 * (1.0 + 1.5**2), rel=0.1)
    allowed = products(with_offsets(of_run, np.array([1.0, 0.0]), None)).chi2
    assert allowed[0] == pytest.approx(
        of_run.residual[:, 0].var() / 4.0 * 1000.0 + 1.5**2, rel=0.01
    )
    assert allowed[1] == pytest.approx(products(of_run).chi2[1], rel=1e-6)
