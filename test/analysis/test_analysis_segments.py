"""Cuts at parameter changes, ramps, staircases, gaps; transients."""

from __future__ import annotations

import numpy as np
import pytest
from analysis_support import harmonic_series, henon, series_of, steps

from herringbone_sim.analysis.motion import motion_of
from herringbone_sim.analysis.segments import FREQUENCY, Segment, cut
from herringbone_sim.analysis.transients import settling_cycles
from herringbone_sim.core.timeseries import TimeSeries

PER_CYCLE = 16


def _cut(series: TimeSeries, *args: object, **kwargs: object) -> tuple[Segment, ...]:
    return cut(series, motion_of(series), *args, **kwargs)  # type: ignore[arg-type]


def _starts(segments: tuple[Segment, ...]) -> list[int]:
    return [segment.start for segment in segments]


def test_a_constant_run_is_one_segment() -> None:
    (only,) = _cut(harmonic_series(50, {1.0: 1e-5}))
    assert (only.start, only.stop) == (0, 801)
    assert only.cycles == pytest.approx(50)
    assert only.point[FREQUENCY] == pytest.approx(100)
    assert only.point["delta_T"] == 50.0


def test_cuts_lie_at_the_first_row_of_a_new_value() -> None:
    n = 100 * PER_CYCLE + 1
    K = np.where(np.arange(n) < 320, 0.0, 0.3)
    delta_T = np.where(np.arange(n) < 960, 50.0, 70.0)
    segments = _cut(harmonic_series(100, {1.0: 1e-5}, K=K, delta_T=delta_T))
    assert _starts(segments) == [0, 320, 960]
    assert [s.point["K"] for s in segments] == [0.0, 0.3, 0.3]
    assert [s.point["delta_T"] for s in segments] == [50.0, 50.0, 70.0]
    assert segments[-1].stop == n


def test_changes_that_are_no_column_come_from_the_events() -> None:
    series = harmonic_series(100, {1.0: 1e-5})
    changes = [(0.2, {"xi": 0.1}), (0.5, {"publish_rate": 30.0}), (0.7, {"xi": 0.12})]
    segments = _cut(series, changes, {"xi": 0.07})
    assert [series.times[s.start] for s in segments] == pytest.approx([0.0, 0.2, 0.7])
    assert [s.point["xi"] for s in segments] == [0.07, 0.1, 0.12]


def test_an_event_of_a_recorded_column_cuts_once() -> None:
    n = 100 * PER_CYCLE + 1
    K = np.where(np.arange(n) < 320, 0.0, 0.3)
    segments = _cut(harmonic_series(100, {1.0: 1e-5}, K=K), [(0.2003, {"K": 0.3})])
    assert _starts(segments) == [0, 320]


def test_a_change_of_mesh_frequency_cuts() -> None:
    series = harmonic_series(100, {1.0: 1e-5})
    times = series.times.copy()
    times[800:] = times[800] + (times[800:] - times[800]) * 1.25
    data = series.data.copy()
    data[:, 0] = times
    segments = _cut(TimeSeries(times, data, series.names))
    assert [s.start for s in segments] == [0, pytest.approx(800, abs=1)]
    assert [s.point[FREQUENCY] for s in segments] == pytest.approx([100, 80], rel=1e-3)


def test_a_staircase_gives_each_dwell() -> None:
    values = np.linspace(20, 60, 21)
    n = 21 * 20 * PER_CYCLE + 1
    delta_T = steps([20 * PER_CYCLE] * 21, values, n)
    segments = _cut(harmonic_series(21 * 20, {1.0: 1e-5}, delta_T=delta_T))
    assert [s.point["delta_T"] for s in segments] == pytest.approx(values)
    assert not any(s.ramp for s in segments)


def test_a_continuous_ramp_is_binned_between_its_dwells() -> None:
    values = np.linspace(0, 0.5, 401)
    n = 1000 * PER_CYCLE + 1
    K = steps([100 * PER_CYCLE] + [2 * PER_CYCLE] * 400, values, n)
    segments = _cut(harmonic_series(1000, {1.0: 1e-5}, K=K))
    moving = [s for s in segments if s.ramp == "K"]
    assert [segments[0].ramp, segments[-1].ramp] == ["", ""]
    assert len(moving) == len(segments) - 2
    assert all(30 < s.cycles < 50 for s in moving)
    middle = [s.point["K"] for s in moving]
    assert np.all(np.diff(middle) > 0)
    assert all(s.ramp_ends[0] < s.point["K"] < s.ramp_ends[1] for s in moving)
    assert segments[-1].point["K"] == 0.5
    assert segments[-1].cycles == pytest.approx(100, abs=5)


def test_few_steps_or_steps_to_and_fro_are_no_ramp() -> None:
    n = 60 * PER_CYCLE + 1
    few = steps([16 * 4] * 9, [0.1 * i for i in range(9)], n)
    assert not any(s.ramp for s in _cut(harmonic_series(60, {1.0: 1e-5}, K=few)))
    to_and_fro = steps([16 * 2] * 29, [0.1 * (i % 2) for i in range(29)], n)
    assert not any(s.ramp for s in _cut(harmonic_series(60, {1.0: 1e-5}, K=to_and_fro)))


def test_a_measured_temperature_cuts_nothing() -> None:
    noisy = 50 + np.random.default_rng(0).normal(0, 0.1, 100 * PER_CYCLE + 1)
    (only,) = _cut(harmonic_series(100, {1.0: 1e-5}, delta_T=noisy))
    assert only.point["delta_T"] == pytest.approx(50, abs=0.02)


def test_a_gap_cuts() -> None:
    series = harmonic_series(100, {1.0: 1e-5})
    kept = np.r_[0:400, 480 : len(series)]
    gapped = series_of({name: series[name][kept] for name in series.names})
    assert _starts(_cut(gapped)) == [0, 400]


def test_a_decaying_transient_is_dropped_until_it_is_gone() -> None:
    decay = np.exp(-np.arange(1000) / 20)[:, None] * np.array([[1.0, -0.5]])
    dropped, settled = settling_cycles(decay)
    assert settled
    assert 20 * np.log(1e4) * 0.6 < dropped < 20 * np.log(1e4) * 1.4


def test_a_chaotic_transient_before_a_periodic_motion_is_dropped() -> None:
    points = np.vstack((henon(300), np.tile([[0.2, 0.1], [0.5, 0.3]], (350, 1))))
    dropped, settled = settling_cycles(points)
    assert settled
    assert 290 <= dropped <= 330


def test_stationary_chaos_loses_no_more_than_the_least() -> None:
    assert settling_cycles(henon(2000)) == (50, True)


def test_a_motion_that_never_settles_is_said() -> None:
    drift = np.linspace(0, 1, 400)[:, None]
    dropped, settled = settling_cycles(drift)
    assert (dropped, settled) == (200, False)
