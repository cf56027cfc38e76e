"""Planted sensor errors come back by consistency alone; right ones are silent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from gap_support import NOMINAL, POINTS, noisy, prepared, sampled
from herringbone_sim.gap.sensors.find import SensorCheck, contradictions, find_sensor_errors
from scipy.interpolate import CubicSpline

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.gap.sensors.corrected import drop
from herringbone_sim.gap.sensors.noise import quieter

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")
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


def check(
    clean: list[TimeSeries], names: tuple[str, ...], change: Change, share: float = 0.01
) -> SensorCheck:
    runs = [
        prepared(noisy(changed(series, names, change), share, i), point, share=share)
        for i, (series, point) in enumerate(zip(clean, POINTS, strict=True))
    ]
    return find_sensor_errors(runs)


@pytest.mark.parametrize("share", [0.1, 0.01, 0.001])
def test_silent_on_a_rig_whose_sensors_are_right(clean: list[TimeSeries], share: float) -> None:
    found = check(clean, (), lambda t, y: y, share)
    assert found.findings == ()
    assert found.before == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("point", range(3))
def test_noise_that_nobody_tells_is_found(clean: list[TimeSeries], point: int) -> None:
    series = noisy(clean[point], 0.01, 8)
    told, guessed = (prepared(series, POINTS[point], share=share) for share in (0.01, None))
    found = quieter(guessed)
    for quantity in "xvFu":
        true, before, after = (getattr(run, quantity).sigma for run in (told, guessed, found))
        assert 0.7 < np.median(after / true) < 2.5
        assert np.all(after <= before)
        if np.median(before / true) > 2.4:  # spectra with motion up to their end
            assert np.median(after / before) < 0.8


def test_what_sensors_contradict_is_told_with_what_was_done(clean: list[TimeSeries]) -> None:
    (told,) = contradictions(check(clean, ("v_rp1_R",), lambda t, y: 1.1 * y))
    assert told.channels == ("v_rp1_R",)
    assert "v_rp1_R contradicts the other channels, most like sensor_gain of 0.1" in told.text
    assert "left out" in told.text


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
        (all_of("x"), lambda t, y: CubicSpline(t, y)(t + 4e-4 * t), "clock_drift", -400.0),
    ],
)
def test_a_planted_error_comes_back(
    clean: list[TimeSeries], names: tuple[str, ...], change: Change, effect: str, value: float
) -> None:
    found = check([_from_zero(s) for s in clean], names, change)
    first = found.findings[0]
    assert (first.effect, set(first.group.names)) == (effect, set(names))
    assert first.value == pytest.approx(value, abs=max(4.0 * first.sigma, 0.02 * abs(value)))
    assert len(found.findings) == 1
    assert found.after == pytest.approx(1.0, abs=0.05)
    assert found.corrected == pytest.approx(1.0, abs=0.1)


def _from_zero(series: TimeSeries) -> TimeSeries:
    data = series.data.copy()
    data[:, 0] -= data[0, 0]
    return TimeSeries(data[:, 0].copy(), data, series.names)


@pytest.mark.parametrize(
    ("change", "known"),
    [
        (lambda t, y: y + 5e-6, True),
        (lambda t, y: 1.2e-5 * np.floor(y / 1.2e-5), False),  # its mean error is a bias
    ],
)
def test_a_channel_put_right_agrees_only_where_its_error_is_known(
    clean: list[TimeSeries], change: Change, known: bool
) -> None:
    found = check(clean, ("x_sp2_L",), change)
    assert found.before > 1.2
    assert found.findings
    assert found.after == pytest.approx(1.0, abs=0.05)
    left = (found.corrected - 1.0) / (found.before - 1.0)
    assert left < 0.05 if known else left > 0.2


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
    found = check(swapped, (), lambda t, y: y)
    first = found.findings[0]
    assert first.effect == "channel_swap"
    assert set(first.group.names) == {one, other}
    assert found.corrected == pytest.approx(1.0, abs=0.1)


def test_dropped_channels_are_gone(clean: list[TimeSeries]) -> None:
    run = drop(prepared(clean[0], POINTS[0]), ("x_sp1_L", "u_c"))
    assert not run.x.there[0]
    assert not run.u.there[2]
    assert np.isnan(run.x.values[:, 0]).all()
    assert run.x.there[1:].all()
