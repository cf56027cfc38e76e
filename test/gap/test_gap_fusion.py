"""Fusion of x, u and v: less noise, no bias, and the noise that is left is the noise reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_support import NOMINAL, POINTS, noisy, prepared, rig, sampled

from herringbone_sim.core.mesh import backlash
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.gap.data.noise import spectral_floor
from herringbone_sim.gap.residuals.fusion import QUADRATURE, fuse, increments, least_squares
from herringbone_sim.gap.residuals.mesh_law import law, mesh_motion


@pytest.fixture(scope="module")
def clean() -> list[TimeSeries]:
    return [sampled({"e_m": 0.345}, point, 120) for point in POINTS]


def test_the_noise_left_on_x_is_what_is_reported_and_several_times_less(
    clean: list[TimeSeries],
) -> None:
    for i, (series, point) in enumerate(zip(clean, POINTS, strict=True)):
        run = prepared(noisy(series, 0.01, i), point)
        fused = fuse(run)
        truth = series.columns(tuple(f"x_{m}" for m in NOMINAL.layout.meshes))
        left = np.sqrt(np.mean((fused.x - truth) ** 2, axis=0))
        assert np.median(left / fused.sigma_x) == pytest.approx(1.0, abs=0.1)
        assert np.max(left / fused.sigma_x) < 1.6
        assert (run.x.sigma / fused.sigma_x).min() > 3.0
        rates = series.columns(tuple(f"v_{m}" for m in NOMINAL.layout.meshes))
        left_v = np.sqrt(np.mean((fused.v - rates) ** 2, axis=0))
        np.testing.assert_allclose(left_v / fused.sigma_v, 1.0, atol=0.1)


def test_without_noise_nothing_is_changed(clean: list[TimeSeries]) -> None:
    run = prepared(clean[0], POINTS[0])
    x = run.x.values
    assert np.abs(fuse(run).x - x).max() < 0.01 * x.std()


def test_few_channels_give_what_they_can_and_nan_elsewhere(clean: list[TimeSeries]) -> None:
    keep = ("t", "phase", "u_s_L", "u_c")
    run = prepared(TimeSeries(clean[0].times, clean[0].columns(keep), keep), POINTS[0])
    fused = fuse(run)
    assert np.isfinite(fused.z[:, 0]).all()
    assert np.isnan(fused.z[:, 1:]).all()
    assert np.isnan(fused.x).all()
    assert np.isnan(fused.sigma_x).all()


def test_u_alone_gives_x(clean: list[TimeSeries]) -> None:
    keep = tuple(n for n in clean[0].names if n[0] not in "xvF")
    run = prepared(TimeSeries(clean[0].times, clean[0].columns(keep), keep), POINTS[0])
    truth = clean[0].columns(tuple(f"x_{m}" for m in NOMINAL.layout.meshes))
    np.testing.assert_allclose(fuse(run).x, truth, atol=1e-9)


def test_least_squares_weighs_by_noise() -> None:
    rows, sigma = np.ones((2, 1)), np.array([1.0, 2.0])
    value, covariance = least_squares(rows, sigma, np.array([[0.0, 5.0]]), np.eye(1))
    assert value[0, 0] == pytest.approx(1.0)
    assert covariance[0, 0] == pytest.approx(0.8)


def test_increments_are_exact_for_polynomials_of_degree_five() -> None:
    assert QUADRATURE.sum() == pytest.approx(1.0)
    t = np.linspace(0.0, 1.0, 21)
    moved = np.diff(t**6)
    np.testing.assert_allclose(increments(6 * t[:, None] ** 5, 0.05)[2:-2, 0], moved[2:-2])


def test_the_expected_backlash_is_the_mean_over_the_noise() -> None:
    run, one, none = rig({}).runs[0], np.ones(1), np.zeros(1)
    x = np.array([[-1.2], [0.0], [0.9], [1.1], [4.0]])
    draws = x + 0.3 * np.random.default_rng(0).normal(size=(5, 200_000))
    mesh = {"v": 0.0 * x, "k": 0.0 * x + 1.0, "k_m": one, "c": none, "b": one}
    noise = {"sigma_x": 0.3 * one, "sigma_v": none, "sigma_F": none}
    motion = replace(mesh_motion(run, fuse(run)), x=x, **mesh, **noise)
    found, f = law(motion), backlash(draws, 1.0)
    np.testing.assert_allclose(found.f[:, 0], f.mean(axis=1), atol=3e-3)
    np.testing.assert_allclose(found.sigma[:, 0] ** 2, f.var(axis=1), atol=1e-3)
    np.testing.assert_allclose(found.contact_drive[:, 0], (draws > 1).mean(axis=1), atol=5e-3)
    np.testing.assert_allclose(found.contact_back[:, 0], (draws < -1).mean(axis=1), atol=5e-3)
    np.testing.assert_allclose(law(replace(motion, sigma_x=none)).f, backlash(x, 1.0))


def test_noise_is_found_in_the_spectrum_when_nobody_tells() -> None:
    campaign = rig({})
    for run in campaign.runs:
        floor = spectral_floor(run.x.values)
        np.testing.assert_allclose(floor / run.x.sigma, 1.0, atol=0.35)
    told = replace(campaign.runs[0].x, sigma=floor)
    assert told.complete
