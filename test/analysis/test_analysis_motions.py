"""Period, largest exponent, spectrum, contact: motions and maps with known answers."""

from __future__ import annotations

import numpy as np
import pytest
from analysis_support import MESH_HZ, circle, harmonic_series, henon, logistic

from herringbone_sim.analysis.contact import contact_shares
from herringbone_sim.analysis.lyapunov import largest_exponent
from herringbone_sim.analysis.motion import motion_of
from herringbone_sim.analysis.periods import find_period
from herringbone_sim.analysis.spectra import amplitude_spectrum, lines, share_off_lines
from herringbone_sim.core.timeseries import TimeSeries


def _rng() -> np.random.Generator:
    return np.random.default_rng(7)


def _orbit(period: int, n: int = 400) -> np.ndarray:
    return np.tile(_rng().normal(size=(period, 4)), (n // period + 1, 1))[:n]


@pytest.mark.parametrize("period", [1, 2, 3, 4, 7, 12, 16])
def test_periods_of_exact_repeats(period: int) -> None:
    assert find_period(_orbit(period)).value == period


@pytest.mark.parametrize("period", [1, 2, 3, 4, 12])
def test_periods_under_known_noise(period: int) -> None:
    noisy = _orbit(period) + _rng().normal(0, 0.01, (400, 4))
    assert find_period(noisy, noise=0.01).value == period
    assert find_period(noisy).value == 0


def test_a_split_above_the_noise_is_a_doubled_period() -> None:
    orbit = _orbit(2)
    orbit[::2] = orbit[1] + 0.08
    noisy = orbit + _rng().normal(0, 0.01, orbit.shape)
    assert find_period(noisy, noise=0.01).value == 2


@pytest.mark.parametrize("points", [logistic(600), henon(600), circle(600)])
def test_chaos_and_quasi_periodic_motion_have_no_period(points: np.ndarray) -> None:
    assert find_period(points / points.std()).value == 0


def test_slow_drift_is_no_period_though_each_return_is_close() -> None:
    drift = np.stack((np.linspace(0, 0.1, 500), np.zeros(500)), axis=1)
    assert np.abs(np.diff(drift, axis=0)).max() < 1e-3
    assert find_period(drift).value == 0


def test_leaving_an_unstable_orbit_is_no_period() -> None:
    leaving = 1e-12 * np.exp(np.arange(300) * np.log(1e9) / 300)[:, None] * np.ones((1, 2))
    found = find_period(leaving)
    assert found.value == 0
    assert "leaves" in found.reason
    arriving = leaving[::-1]
    assert find_period(arriving).value == 1


def test_logistic_periods_along_its_cascade() -> None:
    # Period doublings at r = 3, 3.449, 3.544; window of period 3 from 3.8284 (May 1976).
    for r, period in ((2.9, 1), (3.3, 2), (3.5, 4), (3.55, 8), (3.84, 3)):
        assert find_period(logistic(4000, r)[3000:] / 0.3).value == period


def test_too_few_cycles_give_no_period_with_the_reason() -> None:
    few = find_period(henon(20))
    assert few.value is None
    assert "too short" in few.reason
    assert find_period(henon(3)).value is None


def test_exponent_of_the_logistic_map_is_log_2() -> None:
    found = largest_exponent(logistic(5000), _rng())
    assert found.value == pytest.approx(np.log(2), abs=0.01)
    assert found.low < np.log(2) < found.high


@pytest.mark.parametrize(("n", "tolerance"), [(500, 0.05), (8000, 0.02)])
def test_exponent_of_the_henon_map(n: int, tolerance: float) -> None:
    # 0.4192 (Sprott 2003)
    found = largest_exponent(henon(n), _rng())
    assert found.value == pytest.approx(0.4192, abs=tolerance)
    assert found.low < found.value < found.high


def test_exponent_survives_a_change_of_coordinates_and_copies() -> None:
    points = henon(4000)
    turned = np.hstack((points @ np.array([[2.0, 1.0], [0.3, -1.0]]), points[:, :1]))
    found = largest_exponent(turned, _rng())
    assert found.value == pytest.approx(0.4192, abs=0.025)


def test_exponent_under_noise_stays_near() -> None:
    points = henon(4000)
    noisy = points + _rng().normal(0, 0.003 * points.std(), points.shape)
    found = largest_exponent(noisy, _rng(), noise=0.003 * points.std())
    assert found.value == pytest.approx(0.4192, abs=0.06)


def test_exponent_of_quasi_periodic_motion_is_zero() -> None:
    assert largest_exponent(circle(3000), _rng()).value == pytest.approx(0, abs=2e-3)


@pytest.mark.parametrize(
    ("points", "noise", "words"),
    [
        (_orbit(3), 0.0, "repeat"),
        (np.ones((400, 4)), 0.0, "do not spread"),
        (np.ones((400, 4)) + _rng().normal(0, 0.01, (400, 4)), 0.01, "do not spread"),
        (henon(40), 0.0, "too few"),
        (_rng().normal(size=(200, 6)), 0.0, "too few points for this motion"),
    ],
)
def test_no_exponent_comes_with_its_reason(points: np.ndarray, noise: float, words: str) -> None:
    found = largest_exponent(points, _rng(), noise)
    assert np.isnan(found.value)
    assert words in found.reason


def test_a_long_period_has_no_exponent_whatever_its_rounding() -> None:
    rng = _rng()
    points = np.tile(rng.normal(size=(28, 4)), (40, 1)) + 1e-12 * rng.normal(size=(1120, 4))
    found = largest_exponent(points, rng)
    assert np.isnan(found.value)
    assert "repeats every 28 cycles" in found.reason


def test_the_interval_narrows_with_more_data() -> None:
    short, long = (largest_exponent(henon(n), _rng()) for n in (400, 6000))
    assert long.high - long.low < 0.5 * (short.high - short.low)


def test_spectrum_is_right_in_amplitude_at_h_over_n() -> None:
    amplitudes = {1.0: 3e-5, 1 / 3: 1e-5, 5 / 3: 4e-6}
    spectrum = amplitude_spectrum(motion_of(harmonic_series(600, amplitudes)), period=3)
    found = {line.label: line.amplitude for line in lines(spectrum, 3)}
    assert found["1"] == pytest.approx(3e-5, rel=1e-3)
    assert found["1/3"] == pytest.approx(1e-5, rel=1e-3)
    assert found["5/3"] == pytest.approx(4e-6, rel=1e-3)
    assert found["2/3"] < 1e-9
    assert share_off_lines(spectrum, 3)[0] < 1e-6
    assert share_off_lines(spectrum, 1)[0] == pytest.approx(
        (1e-10 + 1.6e-11) / (9e-10 + 1e-10 + 1.6e-11), rel=1e-2
    )


def test_spectrum_does_not_mind_uneven_samples() -> None:
    series = harmonic_series(300, {1.0: 3e-5}, per_cycle=64)
    rows = np.sort(_rng().permutation(len(series))[: 3 * len(series) // 4])
    uneven = TimeSeries(series.times[rows], series.data[rows], series.names)
    spectrum = amplitude_spectrum(motion_of(uneven))
    assert lines(spectrum, 1)[0].amplitude == pytest.approx(3e-5, rel=0.02)


def test_contact_shares_of_a_sine() -> None:
    motion = motion_of(harmonic_series(200, {1.0: 1e-4}, per_cycle=64))
    (shares,) = contact_shares(motion, {"sp": 5e-5})
    assert shares.drive == pytest.approx(1 / 3, abs=0.02)  # sin > 1/2 for a third of the time
    assert shares.back == pytest.approx(1 / 3, abs=0.02)
    assert shares.drive + shares.separated + shares.back == pytest.approx(1)


def test_contact_without_a_backlash_is_nan() -> None:
    motion = motion_of(harmonic_series(200, {1.0: 1e-4}))
    for half in (None, {"rp": 5e-5}):
        (shares,) = contact_shares(motion, half)
        assert np.isnan([shares.drive, shares.separated, shares.back]).all()
    assert motion.frequency_hz == pytest.approx(MESH_HZ)
