"""What real sensors do: rates from displacements, rates of splines, gratings off centre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from gap_support import POINTS, noisy, prepared, rig, sampled

from herringbone_sim.arrays import Array, rms
from herringbone_sim.diagnosis.coefficients import amplitudes
from herringbone_sim.diagnosis.fits import FittedExplanation
from herringbone_sim.diagnosis.products import residual_without_nuisance
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.effects.channels import between
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.diagnose import diagnose
from herringbone_sim.gap.gap_by_run import RowErrors, gap_of
from herringbone_sim.gap.observations import consistency, torque_balance
from herringbone_sim.gap.observations.calibration.copied_channels import (
    drop_common_copies,
    without_computed,
)
from herringbone_sim.gap.observations.force_law import slope
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.runs import gear_run, polynomial_rates
from herringbone_sim.gap.residuals.fusion import (
    QUADRATURE,
    displacement,
    fuse,
    increments,
    quadrature_covariance,
    velocity,
)
from herringbone_sim.gap.sensor_calibration import calibrated_sensors
from herringbone_sim.gap.sensors.consistency import error_signals, relations
from herringbone_sim.gap.sensors.correction import without_channels, without_sensor_error
from herringbone_sim.gap.verification.residual_gap import RunGap
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.plan import RequestedNoise, draw_plan
from herringbone_sim.practice.trial import Setting, plan_of


def test_a_slope_is_fast_where_there_is_little_noise_and_smooth_where_there_is_much() -> None:
    """A wave of ten samples: a quartic over seven misses 2.9 % of its slope, an octic over nine
    0.003 %; the noise of their weights is 0.51 and 1.17 over that of the values."""
    turn = 2.0 * np.pi / 10.0 * np.arange(2000.0)
    wave, exact = np.sin(turn), 2.0 * np.pi / 10.0 * np.cos(turn)
    rng = np.random.default_rng(1)
    for sigma, weight, bias in ((1e-5, 1.167, 4e-5), (1.0, 0.512, 0.03)):
        noise = sigma * rng.normal(size=(2000, 1))
        found, size = polynomial_rates(wave[:, None] + noise, np.array([sigma]), 1.0)
        off = (found[:, 0] - exact)[10:-10]
        assert size[0] == pytest.approx(weight, rel=0.01)
        most = 1.1 * size[0] * sigma + bias * np.sqrt(np.mean(exact**2))
        assert np.sqrt(np.mean(off**2)) < most


def test_the_slope_of_a_force_at_five_samples_a_cycle_loses_little() -> None:
    """Differences lose a quarter of the first order there."""
    run = rig({}, cycles=20).runs[0]
    motion = replace(gear_run(run, 1).motion, times=np.arange(400) / 5.0)
    wave = np.sin(2.0 * np.pi * motion.times)[:, None]
    exact = 2.0 * np.pi * np.cos(2.0 * np.pi * motion.times)
    inner = slice(20, -20)
    for found, share in ((slope(motion, wave), 0.98), (np.gradient(wave, 0.2, axis=0), 0.757)):
        part = found[inner, 0] @ exact[inner] / (exact[inner] @ exact[inner])
        assert part == pytest.approx(share, abs=0.005)


def test_held_out_runs_decide_nothing_about_channels() -> None:
    """Behind a filter: held-out runs of twice the lateness change no delay, those of copied rates
    no channel of the fit runs."""
    made = make_campaign(draw_plan(5, "none", noise=RequestedNoise("filtered")))
    campaign = as_prepared(made)
    right = calibrated_sensors(campaign)
    assert right.runs[0].delay_rad > 0.0
    late = [
        run
        if run.role == "fit"
        else replace(
            run,
            x=replace(run.x, values=between(run.times, run.x.values, run.times - 5e-6)),
            v=replace(run.v, values=np.gradient(run.x.values, run.step_s, axis=0)),
        )
        for run in campaign.runs
    ]
    found = calibrated_sensors(replace(campaign, runs=tuple(late)))
    for a, b in zip(right.of_role("fit"), found.of_role("fit"), strict=True):
        assert a.delay_rad == b.delay_rad
        assert np.array_equal(a.v.recorded, b.v.recorded)


def test_an_encoder_that_is_missing_changes_no_error_of_the_others() -> None:
    """The unit of a gain of a rotation is that rotation, whichever others are there."""
    run = rig({}, share=1e-6, cycles=20).runs[0]
    signals = []
    for one in (run, without_channels(run, ("u_s_R",))):
        signals.append(error_signals(one, fuse(one))[:, 24, 0])
    for found in signals:
        np.testing.assert_allclose(found, run.u.values[:, 0], atol=1e-3 * rms(run.u.values))


@pytest.mark.parametrize("which", [0, 2], ids=["fit", "held out"])
@pytest.mark.parametrize("quantity", ["u", "x"])
def test_a_run_without_some_channels_is_diagnosed_with_the_others(
    quantity: str, which: int
) -> None:
    """One run has no rotations, or no displacements: fewer relations, the same verdict."""
    campaign = rig({}, cycles=20)
    runs = list(campaign.runs)
    names = runs[which].model.layout.channels_of(quantity)
    runs[which] = without_channels(runs[which], names)
    report = diagnose(replace(campaign, runs=tuple(runs)), senses=False).report.to_dict()
    assert report["verdict"] == "none"


@pytest.mark.parametrize("missing", [1, 12], ids=["one gauge", "all gauges"])
def test_a_held_out_run_without_gauges_changes_no_gap_but_its_own(missing: int) -> None:
    """A rig with a wider play, so that the gap is that of the forces."""
    campaign = replace(rig({"b": 0.66}, cycles=20), noise_known=False)
    off = np.arange(12) < missing
    runs = (*campaign.runs[:2], campaign.runs[2].without("F", off))
    whole, lacking = (
        diagnose(one, senses=False).report for one in (campaign, replace(campaign, runs=runs))
    )
    assert lacking.verdict.verdict == whole.verdict.verdict
    assert str(lacking.gap.runs[:2]) == str(whole.gap.runs[:2])
    assert np.isfinite(lacking.gap.runs[2].nominal) == (missing == 1)


def test_a_gauge_that_one_run_lacks_may_be_off_in_the_others() -> None:
    """4 % within a tolerance of 5 % is found as the gain of that gauge."""
    campaign = replace(rig({}, cycles=20), gain_tolerance=(0.05,) * 12)
    first, second, third = campaign.runs
    j, scale = 0, np.where(np.arange(12) == 0, 1.04, 1.0)
    runs = tuple(
        run.with_measured("F", replace(run.F, values=run.F.values * scale))
        for run in (first, third)
    )
    machine = GearMachine(
        GearObservations(
            [runs[0], second.without("F", np.arange(12) == j)], gain_tolerance=(0.05,) * 12
        )
    )
    search = Search(machine)
    fit = search.settled(search.null)
    gain = {c.name: v for c, v in zip(fit.coefficients, fit.mean, strict=True)}[f"gain {j}"]
    assert gain == pytest.approx(0.04, abs=0.01)


def test_an_exchange_of_rates_that_geometry_allows_is_seen_against_displacements() -> None:
    """One unit of the column of the exchange takes all off the residual that it has put there."""
    right = rig({}, cycles=20).runs[0]
    names = ("v_sp2_R", "v_rp2_R")
    swapped = without_sensor_error(right, "swap", names, 1.0)
    clean, wrong = (consistency.block(run, fuse(run), names) for run in (right, swapped))
    assert clean is not None
    assert wrong is not None
    column = wrong.columns[:, :, wrong.functions.index("swap")]
    # Both are whitened by their own run: exchanged noise, and another error of the integral.
    left = wrong.residual - column - clean.residual
    assert np.sqrt(np.mean(left**2)) < 0.01 * np.sqrt(np.mean(clean.residual**2))
    assert np.mean(wrong.residual**2) > 100.0 * np.mean(clean.residual**2)
    lacking = without_channels(swapped, names[:1])
    some = consistency.block(lacking, fuse(lacking), names)
    assert some is not None
    assert not some.columns[:, :, some.functions.index("swap")].any()


def test_gratings_off_centre_are_no_finding_where_forces_come_from_the_law() -> None:
    """A healthy rig by its encoders: what the calibrated balance leaves is its noise.

    Without the gratings as nuisances it leaves several times as much of a run.
    """
    setting = Setting(noise=("encoders_two",), channels=("no_force",), truth="none")
    runs = [r for r in as_prepared(make_campaign(plan_of(setting, 4))).runs if r.role == "fit"]
    search = Search(GearMachine(GearObservations([without_computed(run) for run in runs[:3]])))
    made = amplitudes(search.base, search.null.mean, search.runs, search.rows)
    blocks = [
        b[torque_balance.NAME] for b in search.machine.blocks(made, {}, (torque_balance.NAME,))
    ]
    bare = [
        replace(b, shared=np.zeros((0, *b.shared.shape[1:])), shared_sd=np.zeros(0))
        for b in blocks
    ]
    left, more = (
        np.array([np.mean(residual_without_nuisance(b) ** 2) for b in some])
        for some in (blocks, bare)
    )
    assert (left < 2.0).all()
    assert np.max(more / left) > 2.0


@pytest.mark.parametrize("name", ["v_sp3_R", "v_rp1_L"])
def test_a_lone_rate_is_held_against_displacements(name: str) -> None:
    """Rates are central differences of rotations, but one has a bias, so that it alone stays: the
    mean of its increments against those of x is the bias, without the error of differences."""
    run = prepared(noisy(sampled({}, POINTS[0]), 1e-2, 3), POINTS[0], share=None)
    at = run.model.layout.channels_of("v").index(name)
    slope = np.gradient(run.x.values + run.waves.e, run.step_s, axis=0) - run.waves.e_rate
    bias = 0.05 * np.eye(slope.shape[1])[at]
    run = run.with_measured("v", replace(run.v, values=slope + bias))
    run = run.with_measured("u", run.u.without(run.u.recorded))
    (left,) = drop_common_copies([run])
    assert np.flatnonzero(left.v.recorded).tolist() == [at]
    relation = relations(left, np.zeros((len(left), 33, 1)))[-1]
    assert relation.residual.shape[1] == 1
    per_bias = left.step_s * relation.columns[0, 12 + at] * 0.05
    assert relation.residual.mean() / per_bias == pytest.approx(1.0, rel=0.1)
    assert relation.residual.std() < 3.0


def test_the_error_of_the_integral_of_rates_is_told_by_their_spectrum() -> None:
    """Healthy rig, ten samples a mesh cycle: increments of z depart from the integral of the rates
    by several times their noise where the gear is slow; relative to noise and told error by about
    as much as these, in every coordinate."""
    made = make_campaign(replace(draw_plan(620000, "none"), samples_per_cycle=10))
    for run, at_least in zip(as_prepared(made).runs[:3:2], (1.1, 5.0), strict=True):
        z, P = displacement(run)
        rate, V = velocity(run)
        off = (np.diff(z, axis=0) - increments(rate, run.step_s))[2:-2]
        noise = 2.0 * P + run.step_s**2 * np.sum(QUADRATURE**2) * V
        told, _ = quadrature_covariance(rate, V, run.step_s)
        assert np.all(np.mean(off**2, axis=0) > at_least * np.diag(noise))
        white = np.linalg.inv(np.linalg.cholesky(noise + told))
        assert np.all(np.abs(np.log(np.mean((off @ white.T) ** 2, axis=0))) < np.log(1.6))


def test_rates_of_noise_alone_have_no_error_of_the_integral() -> None:
    """The estimate is zero within its scatter, whatever the number of samples."""
    rng = np.random.default_rng(1)
    V = np.diag(rng.uniform(0.5, 2.0, 8))
    for n in (24, 480, 2880):
        found = [
            quadrature_covariance(rng.normal(size=(n, 8)) @ np.sqrt(V), V, 1e-5) for _ in range(40)
        ]
        off = np.array([np.diag(m) / np.diag(scatter) for m, scatter in found])
        assert np.sqrt(np.mean(off**2)) == pytest.approx(1.0, abs=0.35)
        assert abs(np.mean(off)) < 0.3


def test_few_samples_of_a_cycle_leave_no_more_than_noise() -> None:
    """Of the relations of sensors those that samples can't tell are left out; the others leave
    noise, with ten samples a cycle as with more. With 24 hardly any is left out."""
    for samples, out in ((10, (0.05, 0.3)), (24, (0.0, 0.05))):
        made = make_campaign(replace(draw_plan(620000, "none"), samples_per_cycle=samples))
        runs = as_prepared(made).runs[:5]
        blocks = [consistency.block(run, fuse(run), None) for run in runs]
        squares = np.array([np.mean(b.residual**2, axis=0) for b in blocks if b is not None])
        assert out[0] <= np.mean(squares == 0.0) <= out[1]
        assert np.mean(squares[squares > 0.0]) == pytest.approx(1.0, abs=0.1)


def test_the_floor_of_untold_noise_is_no_more_than_what_is_left() -> None:
    """Forces whose noise is overstated fivefold: the floor is that, or what is white in the
    residual if noise was not told. That is what the right noise leaves, as well as the spectrum
    of so short a run tells."""
    campaign = rig({}, cycles=30)
    loud = [replace(run, F=replace(run.F, sigma=5.0 * run.F.sigma)) for run in campaign.runs]
    machine = GearMachine(GearObservations(loud))
    none = FittedExplanation((), Search(machine).null)
    told, untold, right = (
        gap_of(whole, replace(campaign, noise_known=known), "force_law", none, None).runs
        for whole, known in (
            (machine, True),
            (machine, False),
            (GearMachine(GearObservations(campaign.runs)), True),
        )
    )
    for a, b, c in zip(told, untold, right, strict=True):
        assert a.floor > 1.5 * c.floor
        assert b.floor == pytest.approx(c.floor, rel=0.15)


def test_hum_and_offsets_of_sensors_are_neither_gap_nor_noise() -> None:
    """Forces with a hum of thrice their noise, and an offset of twice it: the same gap as without,
    if the offset is allowed for; else it counts."""
    campaign = rig({}, cycles=30)
    hummed = [
        replace(
            run,
            F=replace(
                run.F,
                values=run.F.values
                + 3.0 * run.F.sigma * np.sin(2.0 * np.pi * 50.0 * run.times)[:, None]
                + 2.0 * run.F.sigma,
            ),
        )
        for run in campaign.runs
    ]
    none = FittedExplanation((), Search(GearMachine(GearObservations(campaign.runs))).null)

    def gap(runs: Sequence[PreparedRun], offsets: Array | None) -> tuple[RunGap, ...]:
        machine, errors = GearMachine(GearObservations(runs)), RowErrors(offsets=offsets)
        return gap_of(machine, campaign, "force_law", none, None, None, errors).runs

    allowed = np.full(12, 1.0)
    for clean, right, wrong in zip(
        gap(campaign.runs, None), gap(hummed, allowed), gap(hummed, None), strict=True
    ):
        assert right.augmented == pytest.approx(clean.augmented, rel=0.03)
        assert right.floor == clean.floor
        assert wrong.augmented > 1.5 * clean.augmented
