"""A clock is told by the mesh phase, a speed that scatters is not taken for one."""

from __future__ import annotations

from dataclasses import replace

import pytest
from gap_support import POINTS, noisy, prepared, sampled

from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.sensors.clock import find_clock, lateness, rate_ppm, set_right

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")


@pytest.fixture(scope="module")
def runs() -> list[PreparedRun]:
    taken = [noisy(sampled({}, point, 20), 0.01, i) for i, point in enumerate(POINTS)]
    return [prepared(series, point) for series, point in zip(taken, POINTS, strict=True)]


def drifting(run: PreparedRun, ppm: float) -> PreparedRun:
    return replace(run, times=run.times * (1.0 + 1e-6 * ppm))


def test_a_right_clock_is_silent(runs: list[PreparedRun]) -> None:
    assert find_clock(runs) is None


@pytest.mark.parametrize("ppm", [-63.0, 12.0, 4000.0])
def test_a_drift_of_all_runs_is_the_clocks(runs: list[PreparedRun], ppm: float) -> None:
    late = [drifting(run, ppm) for run in runs]
    found = find_clock(late)
    assert found is not None
    assert found.ppm == pytest.approx(ppm, abs=0.05)
    assert lateness(late) > 36.0
    assert lateness(late, found.ppm) < 1e-3


def test_speeds_that_scatter_are_no_clock(runs: list[PreparedRun]) -> None:
    off = [drifting(run, ppm) for run, ppm in zip(runs, (900.0, -700.0, 300.0), strict=True)]
    assert find_clock(off) is None


def test_one_run_says_nothing_of_its_clock(runs: list[PreparedRun]) -> None:
    assert find_clock([drifting(runs[0], 500.0)]) is None


def test_a_clock_put_right_keeps_its_speed(runs: list[PreparedRun]) -> None:
    right = set_right(drifting(runs[0], 800.0), 800.0)
    assert rate_ppm(right) == pytest.approx(0.0, abs=1e-3)
