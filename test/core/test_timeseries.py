"""The one form of samples: what it refuses, and that it hands out what was put in."""

from __future__ import annotations

import numpy as np
import pytest

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import AnalysisError

TIMES = np.array([0.0, 0.5, 2.0])
DATA = np.arange(6.0).reshape(3, 2)


@pytest.fixture
def series():
    return TimeSeries(TIMES, DATA, ("a", "b"))


def test_channels_by_name(series):
    assert len(series) == 3
    assert "a" in series
    assert "c" not in series
    assert series["b"].tolist() == [1.0, 3.0, 5.0]
    assert series.columns(("b", "a")).tolist() == [[1.0, 0.0], [3.0, 2.0], [5.0, 4.0]]


def test_rows_are_views_with_their_times(series):
    part = series.rows(1, 3)
    assert part.times.tolist() == [0.5, 2.0]
    assert np.shares_memory(part.data, DATA)


def test_columns_are_a_copy(series):
    assert not np.shares_memory(series.columns(("a",)), DATA)


def test_a_missing_channel_is_named_with_those_there_are(series):
    with pytest.raises(KeyError, match="no channel 'c'; there are a, b"):
        series["c"]


def test_shapes_must_agree():
    with pytest.raises(AnalysisError, match=r"\(3, 1\), got \(3, 2\)"):
        TimeSeries(TIMES, DATA, ("a",))


def test_names_must_be_unique():
    with pytest.raises(AnalysisError, match="got twice: a"):
        TimeSeries(TIMES, DATA, ("a", "a"))


@pytest.mark.parametrize("times", [[0.0, 1.0, 1.0], [0.0, 2.0, 1.0], [0.0, 1.0, np.nan]])
def test_time_must_increase_strictly(times):
    with pytest.raises(AnalysisError, match="at sample 2"):
        TimeSeries(np.array(times), DATA, ("a", "b"))


def test_empty_and_single_rows_are_series():
    assert len(TimeSeries(np.empty(0), np.empty((0, 2)), ("a", "b"))) == 0
    assert len(TimeSeries(np.zeros(1), np.zeros((1, 2)), ("a", "b"))) == 1
