"""Stroboscopic section: exact hits, starts anywhere, points between samples, noise."""

from __future__ import annotations

import numpy as np
import pytest
from analysis_support import HEAD, MESH_HZ, harmonic_series, series_of

from herringbone_sim.analysis.motion import motion_of, with_phase
from herringbone_sim.analysis.noise import noise_floor
from herringbone_sim.analysis.sections import section_noise, stroboscopic_section
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import AnalysisError


def test_samples_on_the_phase_are_taken_to_the_bit() -> None:
    series = harmonic_series(20, {0.5: 1e-5})
    section = stroboscopic_section(motion_of(series))
    assert section.cycles.tolist() == list(range(21))
    assert np.array_equal(section.x[:, 0], series["x_sp_L"][::16])
    assert np.array_equal(section.times, series.times[::16])


def test_hits_within_rounding_count_once() -> None:
    series = harmonic_series(20, {0.5: 1e-5})
    jittered = series.data.copy()
    jittered[:, 1] += np.where(np.arange(len(series)) % 2, 1e-9, -1e-9)
    section = stroboscopic_section(motion_of(TimeSeries(series.times, jittered, series.names)))
    assert np.array_equal(np.diff(section.cycles), np.ones(len(section) - 1))
    assert np.array_equal(section.x[:, 0], series["x_sp_L"][::16])


@pytest.mark.parametrize("first_phase", [0.2, 3.0, -40.0, 1e4 + 0.1])
def test_points_between_samples_are_interpolated(first_phase: float) -> None:
    motion = motion_of(harmonic_series(30, {0.5: 1e-5, 2.0: 2e-6}, first_phase=first_phase))
    section = stroboscopic_section(motion)
    angle = 2 * np.pi * section.cycles
    exact = 1e-5 * np.sin(0.5 * angle) + 2e-6 * np.sin(2 * angle)
    rate = 2 * np.pi * MESH_HZ * (0.5e-5 * np.cos(0.5 * angle) + 4e-6 * np.cos(2 * angle))
    assert len(section) in (30, 31)
    assert section.x[:, 0] == pytest.approx(exact, abs=1e-8)
    assert section.v[1:-1, 0] == pytest.approx(rate[1:-1], rel=0.02, abs=1e-4)


def test_noise_of_the_samples_is_found_and_carried_to_the_section() -> None:
    rng = np.random.default_rng(0)
    clean = harmonic_series(4000, {1.0: 1e-5}, first_phase=0.2)
    data = clean.data.copy()
    data[:, 5] += rng.normal(0, 2e-7, len(data))
    data[:, 6] += rng.normal(0, 1e-4, len(data))
    motion = motion_of(TimeSeries(clean.times, data, clean.names))
    found = noise_floor(motion.x), noise_floor(motion.v)
    assert found[0][0] == pytest.approx(2e-7, rel=0.1)
    assert found[1][0] == pytest.approx(1e-4, rel=0.1)
    section = stroboscopic_section(motion)
    measured = np.array([section.x.std(), section.v.std()])
    expected = section_noise(motion, (np.array([2e-7]), np.array([1e-4])))
    assert measured == pytest.approx(expected, rel=0.05)
    assert np.all(expected < [2e-7, 1e-4])


def test_a_missing_rate_is_worked_out_and_said() -> None:
    series = harmonic_series(30, {1.0: 1e-5}, per_cycle=64)
    bare = TimeSeries(series.times, series.data[:, :6], series.names[:6])
    motion = motion_of(bare)
    assert motion.v[1:-1, 0] == pytest.approx(series["v_sp_L"][1:-1], abs=2e-5)
    assert "worked out" in motion.notes[0]


def test_a_broken_channel_is_left_out_and_said() -> None:
    series = harmonic_series(30, {1.0: 1e-5})
    broken = np.full(len(series), np.nan)
    both = TimeSeries(
        series.times,
        np.column_stack((series.data, broken)),
        (*series.names, "x_sp_R"),
    )
    motion = motion_of(both)
    assert motion.meshes == ("sp_L",)
    assert "x_sp_R" in motion.notes[0]


def _without(name: str) -> TimeSeries:
    series = harmonic_series(30, {1.0: 1e-5})
    return series_of({n: series[n] for n in series.names if n != name})


def _with(name: str, value: float, row: slice) -> TimeSeries:
    series = harmonic_series(30, {1.0: 1e-5})
    data = series.data.copy()
    data[row, series.names.index(name)] = value
    return TimeSeries(series.times, data, series.names)


@pytest.mark.parametrize(
    ("series", "words"),
    [
        (_without("phase"), "--mesh-frequency"),
        (_without("x_sp_L"), "no displacement"),
        (_with("x_sp_L", np.nan, slice(None)), "every displacement holds NaN"),
        (_with("phase", 0.0, slice(None)), "phase must be finite and increase"),
        (_with("phase", np.nan, slice(7, 8)), "phase must be finite and increase"),
        (harmonic_series(1, {1.0: 1e-5}), "at least 32 samples, got 17"),
    ],
)
def test_bad_input_is_refused_with_the_reason(series: TimeSeries, words: str) -> None:
    with pytest.raises(AnalysisError, match=words):
        motion_of(series)


def test_a_given_mesh_frequency_stands_in_for_the_phase() -> None:
    motion = motion_of(with_phase(_without("phase"), MESH_HZ))
    assert motion.cycles == pytest.approx(30)
    assert motion.frequency_hz == pytest.approx(MESH_HZ)
    assert set(HEAD) - {"phase"} < set(_without("phase").names)
