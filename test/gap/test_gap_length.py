"""A long recording is used in part: four turns of the carrier, not more samples than needed."""

from __future__ import annotations

import numpy as np
import pytest

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.gap.data.usable_part import MOST_SAMPLES, usable_part


def recording(cycles: float, per_cycle: int) -> TimeSeries:
    phase = 2.0 * np.pi * np.arange(int(cycles * per_cycle)) / per_cycle
    return TimeSeries(phase / 3e4, np.stack([phase, np.sin(phase)], axis=1), ("phase", "u_c"))


@pytest.mark.parametrize(("cycles", "per_cycle"), [(120, 24), (308, 24), (100, 100), (240, 50)])
def test_a_run_of_usual_length_is_used_whole(cycles: int, per_cycle: int) -> None:
    series = recording(cycles, per_cycle)
    assert usable_part("run", series, 77) == (series, ())


@pytest.mark.parametrize(("per_cycle", "left"), [(24, 24), (100, 33), (30, 30)])
def test_of_a_long_run_the_middle_is_used(per_cycle: int, left: int) -> None:
    """``left``: samples of a cycle, as every k-th is kept where four turns have too many."""
    series = recording(1000.0, per_cycle)
    part, (finding,) = usable_part("run", series, 77)
    assert np.ptp(part["phase"]) / (2.0 * np.pi) == pytest.approx(308.0, abs=0.2)
    assert len(part) / 308.0 == pytest.approx(left, abs=0.5)
    assert len(part) <= MOST_SAMPLES
    assert part["phase"].mean() == pytest.approx(series["phase"].mean(), rel=1e-3)
    np.testing.assert_allclose(part["u_c"], np.sin(part["phase"]))
    assert finding.run == "run"
    assert f"{len(part)} samples" in finding.text


def test_few_samples_of_a_cycle_are_not_thinned_out() -> None:
    """A ring of 2000 teeth: four turns of its carrier are 8000 cycles."""
    part, _ = usable_part("run", recording(9000.0, 20), 2000)
    assert len(part) == pytest.approx(8000 * 20, rel=1e-3)


@pytest.mark.parametrize("samples", [0, 1])
def test_too_few_samples_are_left_to_the_check_of_their_number(samples: int) -> None:
    series = recording(1.0, 24)
    short = TimeSeries(series.times[:samples], series.data[:samples], series.names)
    assert usable_part("run", short, 77) == (short, ())
