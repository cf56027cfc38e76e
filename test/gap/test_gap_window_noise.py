"""Noise of few sensors that the campaign does not tell: learned from windows of the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from herringbone_sim.gap.data.noise import spectral_floor
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.observations.windows.noise import with_noise_of_windows
from herringbone_sim.gap.sensor_calibration import calibrated_sensors, with_learned_noise
from herringbone_sim.gap.sensors.correction import without_channels
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import PracticeCampaign, make_campaign
from herringbone_sim.practice.plan import RequestedNoise, draw_plan


def made(seed: int, truth: str, kind: str, channels: str) -> PracticeCampaign:
    return make_campaign(
        draw_plan(seed, truth, noise=RequestedNoise(kind), channels=channels, d=10.0)
    )


def prepared(one: PracticeCampaign) -> PreparedCampaign:
    return as_prepared(one)


@pytest.fixture(scope="module")
def encoders() -> PracticeCampaign:
    """A healthy rig: encoders of suns and carrier, gauges in the pins, noise not told."""
    return made(560104, "none", "encoders", "shafts_pins")


def test_noise_of_encoders_is_that_of_their_steps(encoders: PracticeCampaign) -> None:
    """A step over the root of 12, of which the spectrum tells half in some runs."""
    campaign = prepared(encoders)
    counts = encoders.label["noise"]["encoders"]["counts"]
    model = campaign.runs[0].model
    at = model.layout.bodies.index("c")
    step = 2.0 * np.pi / counts * model.scales.base_radius("c")
    runs = campaign.of_role("fit")
    by_spectrum = [spectral_floor(run.u.values[:, [at]])[0] for run in runs]
    assert min(by_spectrum) < 0.6 * step / np.sqrt(12.0)
    for of in (campaign, with_learned_noise(calibrated_sensors(campaign))):
        found = [run.u.sigma[at] for run in of.of_role("fit")]
        np.testing.assert_allclose(found, step / np.sqrt(12.0), rtol=0.2)


def test_noise_of_gauges_is_not_taken_for_motion(encoders: PracticeCampaign) -> None:
    """A hundredth of the RMS; the spectrum of a force with contact says three times as much."""
    campaign = prepared(encoders)
    learned = with_learned_noise(calibrated_sensors(campaign))
    ratio = np.array(
        [
            [one.pin.sigma / np.sqrt(np.mean(one.pin.values**2, axis=0)) for one in of.runs]
            for of in (campaign, learned)
        ]
    )
    assert ratio[0].max() > 0.03
    assert np.median(ratio[1]) < 0.016
    assert ratio[1].min() > 0.009


def test_noise_of_accelerations_is_not_taken_for_motion() -> None:
    """A hundredth of the RMS; the spectrum of a gear that loses contact says five times that."""
    campaign = prepared(made(641008, "none", "coloured", "accelerometers"))
    learned = with_learned_noise(calibrated_sensors(campaign))
    ratio = np.array(
        [
            [one.a.sigma[:3] / np.sqrt(np.mean(one.a.values[:, :3] ** 2, axis=0)) for one in of]
            for of in (campaign.of_role("fit"), learned.of_role("fit"))
        ]
    )
    assert ratio[0].max() > 0.04
    assert ratio[1].max() < 0.035
    assert np.median(ratio[1]) < 0.015
    assert ratio[1].min() > 0.007


def test_an_effect_makes_no_encoder_noisier_than_its_noisiest_run() -> None:
    """Ten times the noise of a step is left of some runs; their noise is raised to that one's."""
    whole = prepared(made(600003, "backlash_offset", "encoders", "few"))
    runs = [replace(r, u=r.u.with_noise(0.5 * r.u.sigma)) for r in whole.of_role("fit")]
    runs[0] = whole.of_role("fit")[0]
    before = np.array([run.u.sigma[:3] for run in runs])
    after = np.array([run.u.sigma[:3] for run in with_noise_of_windows(runs, known=False)])
    assert np.all(after >= before)
    assert np.any(after > 1.1 * before)
    assert after.max(axis=0) == pytest.approx(before.max(axis=0))


def test_noise_that_is_told_stays() -> None:
    """Of the channels with a mean; raw angles lose theirs, and their noise is learned."""
    campaign = prepared(made(600001, "none", "white", "shafts_pins"))
    assert campaign.noise_known
    assert with_learned_noise(campaign) is campaign
    run = campaign.of_role("fit")[1]
    raw = replace(run, detrended=("u_c",), u=run.u.with_noise(0.1 * run.u.sigma))
    other = replace(raw, name="noisy", u=run.u)
    learned, _ = with_noise_of_windows([raw, other], known=True)
    at = run.model.layout.bodies.index("u_c".removeprefix("u_"))
    told = np.arange(len(run.u.sigma)) != at
    np.testing.assert_array_equal(learned.u.sigma[told], raw.u.sigma[told])
    assert learned.u.sigma[at] == pytest.approx(run.u.sigma[at], rel=0.2)
    np.testing.assert_array_equal(learned.pin.sigma, raw.pin.sigma)


def test_a_rotation_that_a_run_lacks_gets_no_noise() -> None:
    """What has noise counts as recorded."""
    run = prepared(made(600001, "none", "encoders", "rotations")).of_role("fit")[1]
    lacking = without_channels(run, ("u_p1_L",))
    for one in with_noise_of_windows([run, lacking], known=False):
        np.testing.assert_array_equal(np.isfinite(one.u.sigma), one.u.recorded)
