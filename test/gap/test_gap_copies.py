"""Channels that were worked out of others count once; errors of single ones among them stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_support import NOMINAL, rig, shortened, with_few_runs
from scipy.interpolate import CubicSpline

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import build
from herringbone_sim.gap.data.kinematics import (
    bodies_to_coordinates,
    bodies_to_meshes,
    coordinates_to_meshes,
)
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.diagnose import diagnose
from herringbone_sim.gap.observations import consistency
from herringbone_sim.gap.observations.calibration.copied_channels import (
    drop_common_copies,
    without_computed,
)
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.sensors.consistency import geometric_residuals
from herringbone_sim.gap.sensors.correction import without_channels
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.plan import RequestedNoise, draw_plan


def test_rates_of_a_spline_through_rotations_are_no_second_measurement() -> None:
    """They repeat the rotations to the last bit; noise of their own makes them count again."""
    run = rig({}, cycles=20).runs[0]
    names = run.model.layout.bodies
    run = without_channels(run, tuple(f"u_{name}" for name in names))
    assert without_computed(run).v.recorded.all()
    times = np.arange(len(run)) * run.step_s
    rate = CubicSpline(times, run.x.values).derivative()(times)
    copied = replace(run, v=replace(run.v, values=rate))
    assert not without_computed(copied).v.recorded.any()
    wrong = rate * np.where(np.arange(rate.shape[1]) == 4, 1.2, 1.0)
    off = replace(run, v=replace(run.v, values=wrong))
    assert np.flatnonzero(without_computed(off).v.recorded).tolist() == [4]


def test_copies_are_the_same_in_all_runs() -> None:
    """Two of three runs show that rates are slopes; a rate of its own error stays in all runs."""
    runs = []
    for run in rig({}, cycles=20).runs[:3]:
        run = without_channels(run, tuple(f"u_{name}" for name in run.model.layout.bodies))
        times = np.arange(len(run)) * run.step_s
        rate = CubicSpline(times, run.x.values).derivative()(times)
        rate[:, 4] *= 1.2
        runs.append(replace(run, v=replace(run.v, values=rate)))
    noise = np.random.default_rng(1).normal(size=runs[2].v.values.shape)
    loud = 5.0 * np.std(runs[2].v.values) * noise
    runs[2] = replace(runs[2], v=replace(runs[2].v, values=runs[2].v.values + loud))
    assert without_computed(runs[2]).v.recorded.all()
    for run in drop_common_copies(runs):
        assert np.flatnonzero(run.v.recorded).tolist() == [4]
    # A copy that one run lacks is one in the others; a run without rates has no say.
    lacking = without_channels(runs[1], ("v_sp1_L",))
    without = without_channels(runs[1], runs[1].model.layout.channels_of("v"))
    for second in (lacking, without):
        run = drop_common_copies([runs[0], second])[0]
        assert np.flatnonzero(run.v.recorded).tolist() == [4]
        assert np.array_equal(np.isfinite(run.v.sigma), run.v.recorded)


def test_copied_rates_of_one_kind_of_mesh_are_seen() -> None:
    """Half of the rates, and one planet without an encoder, hide no copy."""
    run = rig({}, cycles=20).runs[0]
    layout, times = run.model.layout, np.arange(len(run)) * run.step_s
    rate = CubicSpline(times, run.x.values).derivative()(times)
    copied = replace(run, v=replace(run.v, values=rate))
    half = tuple(f"v_{mesh}" for mesh in layout.meshes if mesh.startswith("rp"))
    assert not without_computed(without_channels(copied, half)).v.recorded.any()
    D, B = coordinates_to_meshes(layout), bodies_to_coordinates(run.model)
    seen = CubicSpline(times, run.u.values @ (D @ B).T - run.waves.e).derivative()(times)
    of_turns = replace(run, v=replace(run.v, values=seen))
    blind = ("u_p1_L", *layout.channels_of("x"))
    left = without_computed(without_channels(of_turns, blind)).v.recorded
    assert [m for m, on in zip(layout.meshes, left, strict=True) if on] == ["sp1_L", "rp1_L"]


def test_displacements_of_a_second_set_of_encoders_are_dropped_where_the_sets_agree() -> None:
    """Noise of nine encoders in twelve displacements; a gain of one encoder, or sensors of their
    own, keep them."""
    run = without_channels(
        rig({}, cycles=20).runs[0], tuple(f"v_{m}" for m in build(NOMINAL).layout.meshes)
    )
    rng = np.random.default_rng(5)

    def seen(encoders: Array) -> PreparedRun:
        x = encoders @ bodies_to_meshes(run.model).T - run.waves.e
        return replace(run, x=replace(run.x, values=x))

    second = run.u.values + run.u.sigma * rng.normal(size=run.u.values.shape)
    found = without_computed(seen(second))
    assert not found.x.recorded.any()
    assert found.u.complete
    assert without_computed(seen(second * np.r_[1.3, np.ones(8)])).x.complete
    for overstated in (1.0, 1.5):
        noisier = replace(run, x=replace(run.x, sigma=overstated * run.x.sigma))
        assert without_computed(noisier).x.complete


def test_a_wrong_rate_among_copies_is_named_with_its_channel() -> None:
    """Rates are slopes of a spline through rotations, but one has a gain of 1.2."""
    plan = draw_plan(
        3,
        "sensor_gain",
        d=10.0,
        channels="full",
        noise=RequestedNoise("encoders"),
        law="catalogue",
    )
    made = make_campaign(plan)
    channels = made.label["effects"][0]["locus"]["channels"]
    assert channels == ["v_rp1_L"]
    campaign = with_few_runs(as_prepared(shortened(made, 60)))
    [cause, *_] = diagnose(campaign, senses=False).report.to_dict()["causes"]
    assert cause["effect"] == "sensor_gain"
    assert cause["parameters"]["channels"]["value"] == channels
    assert list(cause["locus"].values()) == ["rp", "1", "L"]
    gain = made.label["effects"][0]["parameters"]["gain"]["value"]
    # One rate beside displacements with other sensors' noise: a sixth of the size is missed.
    assert cause["parameters"]["gain"]["value"] - 1.0 == pytest.approx(gain - 1.0, rel=0.2)


def test_a_wrong_displacement_among_copies_of_rotations_stays() -> None:
    """x is worked out of u, but one has a bias of 1.5 times its noise: 0.4 times over twelve x."""
    run = rig({}, cycles=20).runs[0]
    x = run.u.values @ bodies_to_meshes(run.model).T - run.waves.e
    copied = replace(run, x=replace(run.x, values=x))
    assert not without_computed(copied).x.recorded.any()
    bias = 1.5 * run.x.sigma * (np.arange(12) == 7)
    left = without_computed(replace(run, x=replace(run.x, values=x + bias)))
    assert np.flatnonzero(left.x.recorded).tolist() == [7]


def test_a_wrong_displacement_of_a_second_set_of_encoders_keeps_them_all() -> None:
    """The bias is larger than half of the noise, but less than a third of it over twelve x."""
    run = rig({}, cycles=20).runs[0]
    run = without_channels(run, run.model.layout.channels_of("v"))
    second = run.u.values + run.u.sigma * np.random.default_rng(5).normal(size=(len(run), 9))
    x = second @ bodies_to_meshes(run.model).T - run.waves.e
    bias = run.x.sigma * (np.arange(12) == 7)
    assert not without_computed(replace(run, x=replace(run.x, values=x))).x.recorded.any()
    assert without_computed(replace(run, x=replace(run.x, values=x + bias))).x.complete


def test_an_error_that_runs_share_has_one_pattern_whatever_their_noise() -> None:
    """A bias of one x, in two runs with other noise of each channel, by the whitened relations."""
    run = without_channels(rig({}, cycles=20).runs[0], build(NOMINAL).layout.channels_of("u"))
    x = run.x.values + 20.0 * run.x.sigma * (np.arange(12) == 7)
    rng = np.random.default_rng(1)
    patterns = []
    for _ in range(2):
        sigma = run.x.sigma * rng.uniform(0.8, 1.25, 12)
        residual = geometric_residuals(replace(run, x=replace(run.x, values=x, sigma=sigma)))[0][0]
        patterns.append(residual.mean(axis=0))
    first, second = (pattern / np.linalg.norm(pattern) for pattern in patterns)
    assert first @ second > 0.95


def test_gratings_off_centre_change_no_relation_between_displacements() -> None:
    """x worked out of encoders obeys the geometry whatever their errors; u of other encoders
    differs from it."""
    run = rig({}, cycles=20).runs[0]
    run = without_channels(run, run.model.layout.channels_of("v"))
    alone = without_channels(run, run.model.layout.channels_of("u"))
    for seen, least, most in ((alone, 0.0, 1e-6), (run, 1.0, np.inf)):
        found = consistency.block(seen, fuse(seen), None)
        assert found is not None
        largest = found.nuisance_sd[:, -6:].max()
        assert least <= largest <= most
