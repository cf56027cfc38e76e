"""Planted sensor errors show by consistency alone, with their size; right ones are silent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from gap_support import NOMINAL, POINTS, noisy, prepared, sampled, with_few_runs
from scipy.interpolate import CubicSpline

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.effects.effect import Active, Locus, active
from herringbone_sim.effects.registry import effects
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.hypotheses.sensors import PARAMETER_NAMES
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.sensor_calibration import calibrated_sensors
from herringbone_sim.gap.sensors.consistency import (
    consistency_chi2,
    error_signals,
    relations,
)
from herringbone_sim.gap.sensors.correction import correct_sensors, without_channels
from herringbone_sim.gap.sensors.filter_delay import with_delayed_waves
from herringbone_sim.gap.sensors.groups import sensor_names
from herringbone_sim.gap.sensors.noise import with_estimated_noise
from herringbone_sim.gap.sensors.swaps import find_swap
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.plan import RequestedNoise, draw_plan

UNLIKE = {"k_factor": [1.0, 1.1, 0.95, 1.0, 1.05, 1.0] * 2, "e_factor": [1.0, 0.9, 1.1] * 4}
Change = Callable[[np.ndarray, np.ndarray], np.ndarray]


@pytest.fixture(scope="module")
def clean() -> list[TimeSeries]:
    return [sampled(UNLIKE, point, 60) for point in POINTS]


def changed(series: TimeSeries, names: tuple[str, ...], change: Change) -> TimeSeries:
    data = series.data.copy()
    for name in names:
        j = series.names.index(name)
        data[:, j] = change(series.times, data[:, j])
    return TimeSeries(series.times, data, series.names)


def runs_of(
    clean: list[TimeSeries], names: tuple[str, ...], change: Change, share: float = 0.01
) -> list[PreparedRun]:
    return [
        prepared(noisy(changed(series, names, change), share, i), point, share=share)
        for i, (series, point) in enumerate(zip(clean, POINTS, strict=True))
    ]


def size_of(runs: list[PreparedRun], effect: str, names: tuple[str, ...]) -> tuple[float, float]:
    """Error that some channels share [SI], and its sigma, by least squares."""
    every = sensor_names(NOMINAL.layout)
    at, kind = [every.index(name) for name in names], list(PARAMETER_NAMES).index(effect)
    normal = right = 0.0
    for run in runs:
        signals = error_signals(run, fuse(run))
        for one in relations(run, signals):
            column = np.einsum("dj,tj->td", one.columns[:, at], one.signals[:, at, kind])
            normal += float(np.sum(column**2))
            right += float(np.sum(column * one.residual))
    return right / normal, normal**-0.5


@pytest.mark.parametrize("share", [0.1, 0.01, 0.001])
def test_silent_on_a_rig_whose_sensors_are_right(clean: list[TimeSeries], share: float) -> None:
    runs = runs_of(clean, (), lambda t, y: y, share)
    assert consistency_chi2(runs) == pytest.approx(1.0, abs=0.15)


def test_the_clock_of_some_channels_is_taken_off_them_alone(clean: list[TimeSeries]) -> None:
    """x that was later by 400 ppm of the time: corrected it is right again, all else untouched."""
    names = tuple(f"x_{mesh}" for mesh in NOMINAL.layout.meshes)
    right = runs_of(clean, (), lambda t, y: y)[0]
    lead = 4e-4
    wrong = runs_of(clean, names, lambda t, y: CubicSpline(t, y)(t + lead * (t - t[0])))[0]
    drift = Active(effects()["clock_drift"], (400.0,), Locus(), (("channels", ("x",)),))
    found = correct_sensors(wrong, (drift,))
    inner = slice(0, -24)
    before, after = (np.std((run.x.values - right.x.values)[inner]) for run in (wrong, found))
    assert after < 0.1 * before
    assert np.array_equal(found.times, wrong.times)
    assert np.array_equal(found.v.values, wrong.v.values)


@pytest.mark.parametrize("point", range(3))
def test_noise_that_nobody_tells_is_found(clean: list[TimeSeries], point: int) -> None:
    series = noisy(clean[point], 0.01, 8)
    told, guessed = (prepared(series, POINTS[point], share=share) for share in (0.01, None))
    found = with_estimated_noise(guessed)
    for quantity in "xvFu":
        true, before, after = (getattr(run, quantity).sigma for run in (told, guessed, found))
        assert 0.7 < np.median(after / true) < 2.5
        assert np.all(after <= before)
        if np.median(before / true) > 2.4:  # spectra with motion up to their end
            assert np.median(after / before) < 0.8


def all_of(prefix: str, ending: str = "") -> tuple[str, ...]:
    meshes = NOMINAL.layout.meshes
    return tuple(f"{prefix}_{m}" for m in meshes if m.endswith(ending))


@pytest.mark.parametrize(
    ("names", "change", "effect", "value"),
    [
        (("x_sp2_L",), lambda t, y: 1.02 * y, "sensor_gain", 0.02),
        (all_of("v"), lambda t, y: 0.97 * y, "sensor_gain", -0.03),
        (("u_c",), lambda t, y: y + 2e-6, "sensor_bias", 2e-6),
        (all_of("x", "R"), lambda t, y: CubicSpline(t, y)(t - 3e-6), "sensor_delay", 3e-6),
        (("v_rp1_R",), lambda t, y: CubicSpline(t, y)(t - 2e-6), "sensor_delay", 2e-6),
        (all_of("x"), lambda t, y: CubicSpline(t, y)(t + 4e-4 * t), "clock_drift", -4e-4),
    ],
)
def test_a_planted_error_comes_back(
    clean: list[TimeSeries], names: tuple[str, ...], change: Change, effect: str, value: float
) -> None:
    runs = runs_of([_from_zero(s) for s in clean], names, change)
    assert consistency_chi2(runs) > 1.05  # 1 where all sensors agree
    size, sigma = size_of(runs, effect, names)
    assert size == pytest.approx(value, abs=max(5.0 * sigma, 0.05 * abs(value)))


def _from_zero(series: TimeSeries) -> TimeSeries:
    data = series.data.copy()
    data[:, 0] -= data[0, 0]
    return TimeSeries(data[:, 0].copy(), data, series.names)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("x_sp1_L", "x_sp2_L"),
        ("x_sp2_R", "x_rp2_R"),
        ("v_sp3_L", "v_rp3_L"),  # by geometry a planet that moves otherwise
    ],
)
def test_an_exchange_of_channels_is_seen_where_they_differ(
    clean: list[TimeSeries], one: str, other: str
) -> None:
    swapped = []
    for series in clean:
        names = list(series.names)
        i, j = names.index(one), names.index(other)
        names[i], names[j] = names[j], names[i]
        swapped.append(TimeSeries(series.times, series.data, tuple(names)))
    found = find_swap(runs_of(swapped, (), lambda t, y: y))
    assert found is not None
    assert set(found) == {one, other}


def test_dropped_channels_are_gone(clean: list[TimeSeries]) -> None:
    run = without_channels(prepared(clean[0], POINTS[0]), ("x_sp1_L", "u_c"))
    assert not run.x.recorded[0]
    assert not run.u.recorded[2]
    assert np.isnan(run.x.values[:, 0]).all()
    assert run.x.recorded[1:].all()


def test_an_accelerometer_that_cannot_be_put_right_is_dropped(clean: list[TimeSeries]) -> None:
    run = prepared(clean[0], POINTS[0])
    n = len(run.model.layout.bodies)
    run = run.with_measured("a", Measured(np.ones((len(run), n)), np.full(n, True), np.ones(n)))
    spec = replace(effects()["sensor_gain"], id="sensor_of_a_plugin")
    found = correct_sensors(run, (active(spec, values={"channels": ("a_c",)}),))
    assert [not on for on in found.a.recorded] == [b == "c" for b in run.model.layout.bodies]


def test_a_clock_is_put_right_behind_a_common_filter(clean: list[TimeSeries]) -> None:
    run = with_delayed_waves(prepared(clean[0], POINTS[0]), 1e-5, 0.9)
    found = correct_sensors(run, (active(effects()["clock_drift"], values={"ppm": 1.0}),))
    np.testing.assert_allclose(found.waves.e, run.waves.e, atol=1e-12)
    np.testing.assert_allclose(found.waves.k, run.waves.k, rtol=1e-12)


def test_an_exchange_is_whole_or_none() -> None:
    """Two sensors of a healthy rig that move alike: a share of an exchange would average their
    noise, and leave less than none."""
    made = make_campaign(draw_plan(640500, "none", noise=RequestedNoise("coloured")))
    campaign = calibrated_sensors(with_few_runs(as_prepared(made)))
    names = ("x_sp1_L", "x_sp3_L")
    machine = GearMachine(GearObservations(campaign.of_role("fit"), stride=2, swap=names))
    search = Search(machine)
    none = search.settled(search.null)
    (exchange,) = [h for h in machine.hypotheses() if dict(h.options).get("channels") == names]
    assert exchange.partly_screened  # it acts in force law and balance too
    start = np.append(none.mean, 1.0)
    found = search.settled(search.refined(exchange.coefficients, start))
    assert found.mean[-1] == pytest.approx(1.0, abs=2e-3)
    assert found.in_sample > none.in_sample - search.worth
