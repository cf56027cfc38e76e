"""Cut a run into segments where its parameters change: steps, staircases, ramps, gaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.analysis.motion import Motion
from herringbone_sim.arrays import Array
from herringbone_sim.core.timeseries import TimeSeries, held

Change = tuple[float, Mapping[str, float]]
Rows = NDArray[np.intp]

COLUMNS = ("K", "delta_T", "T_1")
EVENTS = (
    "xi",
    "control_phase",
    "effects",
    *COLUMNS,
)  # a change of another parameter makes no cut
FREQUENCY = "mesh_frequency_hz"
MIN_RAMP = 8  # changes in one direction
MIN_DWELL_CYCLES = 8.0  # a value that lasts for less is part of a ramp
BIN_CYCLES = 40.0
MAX_BINS = 240


@dataclass(frozen=True)
class Segment:
    """Rows of a run at one operating point.

    Attributes:
        start, stop: first row, and the row after the last.
        point: mean of each parameter, and the measured mesh frequency in Hz, by name.
        cycles: length in mesh cycles.
        ramp: parameter that changes continuously within the segment, or "".
        ramp_ends: its value in the first and in the last row; NaN without a ramp.
    """

    start: int
    stop: int
    point: Mapping[str, float]
    cycles: float
    ramp: str = ""
    ramp_ends: tuple[float, float] = (float("nan"), float("nan"))


@dataclass(frozen=True)
class ParameterHistory:
    """Values of one parameter over a run.

    ``values[i]`` is in force from row ``rows[i]`` on; ``rows[0]`` is 0.
    """

    name: str
    rows: Rows
    values: Array


def cut(
    series: TimeSeries,
    motion: Motion,
    changes: Sequence[Change] = (),
    base: Mapping[str, float] | None = None,
) -> tuple[Segment, ...]:
    """Cut a run into segments of constant parameters, in order, without overlap.

    A cut is made where a channel K, delta_T or T_1, or the mesh frequency, changes, at the given
    changes of xi, control_phase and the set of effects (and of K, delta_T, T_1 if they have no
    channel), and at gaps in the phase. More than 8 successive changes of one parameter in one
    direction are a ramp: if each value lasts for at least 8 cycles, each becomes a segment, else
    the ramp is cut into bins of about 40 cycles. A channel that changes up and down more than once
    a cycle is a measurement, not a setting: it makes no cut and its mean is used.

    Args:
        series: the run.
        motion: the same samples.
        changes: (time in s, new values) of parameters, in order.
        base: parameters at the start that have no channel.
    """
    tracks = _tracks(series, motion, changes, base or {})
    cuts: set[int] = {int(row) for row in _gaps(motion)}
    ramps: list[tuple[int, int, str]] = []
    for track in tracks:
        rows, moving = _cuts_of(track, motion)
        cuts |= {int(row) for row in rows}
        ramps += moving
    edges = [0, *sorted(cut for cut in cuts if 0 < cut < len(motion)), len(motion)]
    return tuple(_segment(*ends, tracks, ramps, motion) for ends in pairwise(edges))


def _tracks(
    series: TimeSeries, motion: Motion, changes: Sequence[Change], base: Mapping[str, float]
) -> list[ParameterHistory]:
    """Tracks of all parameters: from channels, from the mesh frequency, from given changes."""
    columns = [name for name in COLUMNS if name in series and np.isfinite(series[name]).any()]
    tracks = [_track_of_column(name, series[name], motion) for name in columns]
    tracks.append(_track_of_frequency(motion))
    moved = {name for _, values in changes for name in values if name in EVENTS}
    named = [name for name in EVENTS if name in moved | base.keys() and name not in columns]
    return tracks + [_track_of_events(name, series.times, changes, base) for name in named]


def _track_of_column(name: str, values: Array, motion: Motion) -> ParameterHistory:
    """History of a parameter that is a channel (n,); constant at its mean if it is measured."""
    values = held(values)
    steps = np.diff(values)
    rows = np.flatnonzero(steps) + 1
    both_ways = rows.size and 0.1 < np.mean(steps[rows - 1] > 0) < 0.9
    if both_ways and rows.size > max(motion.cycles, 8):
        return ParameterHistory(name, np.zeros(1, np.intp), np.array([values.mean()]))
    rows = np.concatenate(([0], rows))
    return ParameterHistory(name, rows, values[rows])


def _track_of_frequency(motion: Motion) -> ParameterHistory:
    """ParameterHistory of the mesh frequency [Hz], with a new value from each row where it jumps.

    A jump is a relative change of the slope of the phase from sample to sample by more than 1e-6
    plus 20 times the median of such changes. Those at gaps in the phase do not count.
    """
    slopes = np.diff(motion.turns) / np.diff(motion.times)
    relative = np.abs(np.diff(slopes)) / slopes[:-1]
    tolerance = 1e-6 + 20 * float(np.median(relative))
    rows = np.flatnonzero(relative > tolerance) + 1
    # A change between two samples appears as two steps of the slope: use the second one.
    rows = rows[np.append(np.diff(rows) > 1, True)] if rows.size else rows
    gaps = _gaps(motion)
    rows = rows[~np.isin(rows, np.concatenate((gaps - 1, gaps)))]
    rows = np.concatenate(([0], rows)).astype(np.intp)
    return ParameterHistory(FREQUENCY, rows, slopes[np.minimum(rows, len(slopes) - 1)])


def _track_of_events(
    name: str, times: Array, changes: Sequence[Change], base: Mapping[str, float]
) -> ParameterHistory:
    """ParameterHistory of a parameter from its given changes.

    A change acts from the first sample at or after its time. Changes to the value that is in
    force already are ignored.

    Args:
        name: of the parameter.
        times: (n,) times of the samples [s].
        changes: (time in s, new values by name), in order.
        base: values at the start, by name; NaN for a parameter that is not among them.
    """
    rows, values = [0], [base.get(name, float("nan"))]
    for time, change in changes:
        if name in change and change[name] != values[-1]:
            row = int(np.searchsorted(times, time))
            if row == rows[-1]:
                values[-1] = change[name]
            else:
                rows.append(row)
                values.append(change[name])
    return ParameterHistory(name, np.array(rows), np.array(values, dtype=float))


def _gaps(motion: Motion) -> Rows:
    """First rows after gaps in the phase, longer than 3 sample steps and a quarter of a cycle."""
    steps = np.diff(motion.turns)
    return np.flatnonzero(steps > max(3 * float(np.median(steps)), 0.25)) + 1


def _cuts_of(track: ParameterHistory, motion: Motion) -> tuple[Rows, list[tuple[int, int, str]]]:
    """Rows at which one parameter cuts the run, and its ramps as (first row, last row, name)."""
    rows, moving = track.rows[1:], []
    is_cut = np.ones(len(rows), dtype=bool)
    bins: list[int] = []
    for first, last in _one_way_runs(np.diff(track.values)):
        turns = motion.turns[np.minimum(rows[first : last + 1], len(motion) - 1)]
        if np.median(np.diff(turns)) < MIN_DWELL_CYCLES:
            is_cut[first + 1 : last] = False
            count = int(np.clip((turns[-1] - turns[0]) / BIN_CYCLES, 1, MAX_BINS))
            edges = np.linspace(turns[0], turns[-1], count + 1)
            bins += [int(row) for row in np.searchsorted(motion.turns, edges)]
            moving.append((int(rows[first]), int(rows[last]), track.name))
    return np.unique(np.concatenate((rows[is_cut], bins)).astype(np.intp)), moving


def _one_way_runs(steps: Array) -> list[tuple[int, int]]:
    """First and last index of each sequence of more than 8 steps of the same sign."""
    if not steps.size:
        return []
    turns = np.flatnonzero(np.diff(np.sign(steps)) != 0) + 1
    edges = np.concatenate(([0], turns, [len(steps)]))
    return [(int(a), int(b) - 1) for a, b in pairwise(edges) if b - a > MIN_RAMP]


def _segment(
    start: int,
    stop: int,
    tracks: Sequence[ParameterHistory],
    ramps: Sequence[tuple[int, int, str]],
    motion: Motion,
) -> Segment:
    """Segment of the rows from ``start`` to before ``stop``."""
    ramp = next((name for first, last, name in ramps if first <= start and stop <= last), "")
    point = {track.name: _mean(track, start, stop) for track in tracks}
    cycles = motion.rows(start, stop).cycles
    if stop - start > 1:
        point[FREQUENCY] = motion.rows(start, stop).frequency_hz
    if not ramp:
        return Segment(start, stop, point, cycles)
    moving = next(track for track in tracks if track.name == ramp)
    ends = _value(moving, start), _value(moving, stop - 1)
    return Segment(start, stop, point, cycles, ramp, ends)


def _value(track: ParameterHistory, row: int) -> float:
    """Value of a parameter in force at a row."""
    return float(track.values[np.searchsorted(track.rows, row, "right") - 1])


def _mean(track: ParameterHistory, start: int, stop: int) -> float:
    """Mean of a parameter over rows, weighted by the number of rows that each value holds."""
    first = int(np.searchsorted(track.rows, start, "right")) - 1
    last = int(np.searchsorted(track.rows, stop, "left"))
    if last - first <= 1:
        return float(track.values[first])
    edges = np.clip(np.append(track.rows[first:last], stop), start, stop)
    return float(np.average(track.values[first:last], weights=np.diff(edges)))
