"""Noise of channels that is not told: steps of converters and encoders, and what x and u leave."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gap_support import NOMINAL, OMEGA_N, POINTS, noisy, prepared, sampled

from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import build
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.gap.data.kinematics import bodies_to_meshes
from herringbone_sim.gap.data.noise import resolution
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.residuals.foreign_runs import geometry_scales
from herringbone_sim.gap.sensors.noise import with_estimated_noise, without_wrong_noise
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.plan import RequestedNoise, draw_plan

SHAFTS = ("u_s_L", "u_s_R", "u_c")
X_OF_ALL = tuple(f"x_{m}{n}_{side}" for side in "LR" for m in ("sp", "rp") for n in (1, 2, 3))
NEARLY_SINES = (
    {"delta_T": 92.0, "K": 0.0, "T_1": 250.0, "Omega": 0.95},
    {"delta_T": 40.0, "K": 0.0, "T_1": 2000.0, "Omega": 0.32},
)


def test_steps_of_an_encoder_are_seen_through_the_steady_rotation() -> None:
    """Counts less a rotation lie on no grid, but their second differences do."""
    t = np.linspace(0.0, 1.0, 3000)
    angle = 3.0 * t[:, None] + 1e-3 * np.sin(np.outer(t, [40.0, 63.0]))
    step = 2e-5
    counts = np.round(angle / step) * step
    for clock in (t, np.round(t, 9)):
        np.testing.assert_allclose(resolution(counts - 3.0 * clock[:, None]), step, rtol=1e-3)
    assert np.all(resolution(angle - 3.0 * t[:, None]) == 0.0)


@pytest.mark.parametrize("step", [2.44e-3, 2.44e-2, 0.244])
@pytest.mark.parametrize("kept", [np.float64, np.float32, lambda y: np.round(y, 4)])
def test_steps_of_a_converter_are_seen_however_they_are_stored(step: float, kept: Any) -> None:
    force = 500.0 + np.random.default_rng(1).normal(0.0, 100.0, (3000, 1))
    converted = np.asarray(kept(np.round(force / step) * step), dtype=float)
    assert resolution(converted)[0] == pytest.approx(step, rel=0.02)


def test_values_on_no_grid_have_no_steps() -> None:
    """White noise, a clean motion whose samples repeat, one spike, a constant, nothing."""
    rng, n = np.random.default_rng(2), np.arange(3000.0)
    spike = rng.normal(0.0, 1e-3, 3000)
    spike[7] = 50.0
    periodic = np.sin(0.2 * np.pi * n) + 0.3 * np.sin(0.4 * np.pi * n + 1.0)
    every = (rng.normal(size=3000), periodic, spike, np.ones(3000), np.full(3000, np.nan))
    np.testing.assert_array_equal(resolution(np.stack(every, axis=1)), 0.0)


def test_a_second_set_of_encoders_is_no_other_gear_and_as_noisy_as_it_is() -> None:
    """A healthy rig: gratings off centre, whose lines are no motion, and x with steps of its own,
    of which the spectrum tells half."""
    made = make_campaign(draw_plan(660013, "none", noise=RequestedNoise("encoders_two")))
    campaign = as_prepared(made)
    for run in campaign.runs:
        of_u, of_e = geometry_scales(run)
        assert of_u == pytest.approx(1.0, abs=0.1)
        assert of_e == pytest.approx(0.0, abs=0.1)
    step = 2.0 * np.pi / made.label["noise"]["encoders"]["counts"] / np.sqrt(12.0)
    for run in campaign.of_role("fit"):
        model = run.model
        of_u = step * np.array([model.scales.base_radius(body) for body in model.layout.bodies])
        of_x = np.sqrt(bodies_to_meshes(model) ** 2 @ of_u**2)
        found = with_estimated_noise(run)
        np.testing.assert_allclose(found.u.sigma, of_u, rtol=0.3)
        assert np.all((found.x.sigma / of_x > 0.4) & (found.x.sigma / of_x < 1.3))


@pytest.mark.parametrize("point", NEARLY_SINES)
def test_noise_of_encoders_makes_no_other_gear_of_a_nearly_harmonic_motion(
    point: dict[str, float],
) -> None:
    """Motion and e(t) are sines of one frequency, so that little but noise tells them apart."""
    run = prepared(sampled({}, point), point, share=None)
    noise = 0.7e-6 * np.random.default_rng(1).normal(size=run.u.values.shape)
    u = run.u.values + noise
    x = u @ bodies_to_meshes(run.model).T - run.waves.e
    measured = run.with_measured("u", replace(run.u, values=u, sigma=np.full(u.shape[1], 0.7e-6)))
    measured = measured.with_measured("x", replace(run.x, values=x))
    scales = np.array(geometry_scales(measured))
    assert np.all(np.isnan(scales) | (np.abs(scales - [1.0, 0.0]) < 0.15))


def test_a_gear_without_mesh_error_has_scales_too() -> None:
    """Nothing goes with e(t) where it is zero."""
    nominal = NOMINAL.changed({"e_m": 0.0})
    series, _ = simulate(build(nominal.changed({**POINTS[0], "omega_n": OMEGA_N})), 60)
    run = prepared(noisy(series, 1e-3, 1), POINTS[0], share=1e-3, nominal=nominal)
    np.testing.assert_allclose(geometry_scales(run), [1.0, 0.0], atol=0.02)


@pytest.mark.parametrize("channels", [None, SHAFTS, (*X_OF_ALL, "F_sp1_L")])
@pytest.mark.parametrize(("given", "contradicted"), [(0.01, True), (0.005, False), (0.003, True)])
def test_noise_that_the_recording_contradicts_counts_as_not_given(
    channels: tuple[str, ...] | None, given: float, contradicted: bool
) -> None:
    """The noise is 0.005 of the RMS. From shafts alone only the upper bound by spectra is seen."""
    series = noisy(sampled({}, POINTS[0]), 0.005, 3)
    if channels:
        names = (*series.names[:5], *channels)
        series = TimeSeries(series.times, np.stack([series[n] for n in names], axis=1), names)
    run = prepared(series, POINTS[0], share=given)
    campaign, ratio = without_wrong_noise(PreparedCampaign("rig", NOMINAL, (run,), ()))
    if channels == SHAFTS and given < 0.005:
        assert campaign.noise_known
        return
    assert campaign.noise_known is not contradicted
    assert ratio == pytest.approx(0.005 / given if contradicted else 1.0, rel=0.1)
    if contradicted:
        quantity = "x" if channels and channels != SHAFTS else "u"
        m, actual = (getattr(r, quantity) for r in (campaign.runs[0], run))
        of_actual = (actual.sigma * 0.005 / given)[m.recorded]
        np.testing.assert_allclose(m.sigma[m.recorded], of_actual, rtol=0.25)


def test_computed_channels_contradict_no_noise() -> None:
    """x worked out of noisy rotations and rounded, and rates of such x: the geometry of x and u
    shows the rounding alone, that of the rates what differences make of the noise."""
    run = prepared(noisy(sampled({}, POINTS[0]), 0.01, 3), POINTS[0], share=0.01)
    x = run.u.values @ bodies_to_meshes(run.model).T - run.waves.e
    step = np.ptp(x, axis=0) / 2**12
    v = np.gradient(x, run.step_s, axis=0)
    run = run.with_measured("x", replace(run.x, values=np.round(x / step) * step))
    run = run.with_measured("v", replace(run.v, values=v))
    campaign, ratio = without_wrong_noise(PreparedCampaign("rig", NOMINAL, (run,), ()))
    assert campaign.noise_known
    assert ratio == 1.0


def test_noise_given_for_a_force_stays_where_that_of_motion_is_contradicted() -> None:
    """x, v, u have half the noise that is given; that of one force is given alone."""
    run = prepared(noisy(sampled({}, POINTS[0]), 0.005, 3), POINTS[0], share=0.01)
    alone = np.arange(12) == 4
    run = run.with_measured("F", replace(run.F, sigma_given=alone))
    campaign, _ = without_wrong_noise(PreparedCampaign("rig", NOMINAL, (run,), ()))
    found = campaign.runs[0].F.sigma / run.F.sigma
    assert found[4] == 1.0
    assert np.all(np.delete(found, 4) != 1.0)
