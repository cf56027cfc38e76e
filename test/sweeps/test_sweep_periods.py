"""The fast periods against ``analysis.periods.find_period`` on the same sections."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep_support import gear

from herringbone_sim.analysis.periods import find_period
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.model import build
from herringbone_sim.sweeps.periods import find_periods


def by_one(sections: np.ndarray) -> list[float]:
    values = [find_period(points).value for points in sections]
    return [np.nan if value is None else float(value) for value in values]


def orbit(period: int, points: int = 100, seed: int = 0) -> np.ndarray:
    """(points, 3) that repeat after ``period``."""
    cycle = np.random.default_rng(seed).normal(size=(period, 3))
    return np.tile(cycle, (points // period + 1, 1))[:points]


def logistic(r: float, points: int = 100) -> np.ndarray:
    """(points, 1) of the logistic map after 5000 iterations."""
    x, found = 0.4, []
    for i in range(5000 + points):
        x = r * x * (1.0 - x)
        if i >= 5000:
            found.append([x])
    return np.array(found)


def test_periods_up_to_16_and_no_more() -> None:
    found = find_periods(np.array([orbit(period) for period in range(1, 20)]))
    assert found.tolist() == [*range(1, 17), 0, 0, 0]


# Period doublings of the logistic map lie at 3, 3.4495, 3.5441, 3.5644; the window of 3 begins at
# 1 + sqrt(8) = 3.82843 and is announced below by intermittency, which stays close to it for long.
@pytest.mark.parametrize(
    ("r", "period"),
    [(2.9, 1), (3.3, 2), (3.5, 4), (3.55, 8), (3.567, 16), (3.83, 3), (3.827, 0), (4.0, 0)],
)
def test_the_logistic_map(r: float, period: int) -> None:
    assert find_periods(logistic(r)[None]).tolist() == [period]


def test_slow_chaos_is_no_period() -> None:
    drift = orbit(2) + 1e-4 * np.arange(100)[:, None]
    leaving = orbit(1) + 1e-9 * 1.12 ** np.arange(100)[:, None]
    assert find_periods(np.array([drift, leaving])).tolist() == [0, 0]


def test_too_few_points_say_so() -> None:
    wandering = np.random.default_rng(0).normal(size=(1, 30, 2))
    assert np.isnan(find_periods(wandering)).all()
    assert np.isnan(find_periods(orbit(1, 4)[None])).all()
    assert find_periods(orbit(3, 30)[None]).tolist() == [3]


def test_failed_values_stay_unknown() -> None:
    sections = np.array([orbit(2), np.full((100, 3), np.nan)])
    assert np.array_equal(find_periods(sections), [2, np.nan], equal_nan=True)


@settings(max_examples=60)
@given(
    period=st.integers(1, 18),
    points=st.integers(5, 120),
    noise=st.sampled_from([0.0, 3e-4, 9e-4, 1.1e-3, 1e-2]),
    growth=st.sampled_from([1.0, 1.02, 1.1]),
    seed=st.integers(0, 1000),
)
def test_agrees_with_find_period(
    period: int, points: int, noise: float, growth: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    parted = noise * growth ** np.arange(points)[:, None] / growth**points
    section = orbit(period, points, seed) + parted * rng.normal(size=(points, 3))
    assert np.array_equal(find_periods(section[None]), by_one(section[None]), equal_nan=True)


def test_agrees_with_find_period_on_gears() -> None:
    """The paper's gear from chaos over periods 3 and 2 to 1, and one on its way there."""
    models = [build(gear(delta_T=dT)) for dT in (20.0, 63.0, 65.0, 70.0, 81.0, 81.5, 85.0)]
    sections = run_batch(models, transient=200).sections
    found = find_periods(sections)
    assert found.tolist() == by_one(sections)
    assert {0.0, 1.0, 2.0} <= set(found)
