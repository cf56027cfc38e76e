"""Bring the files of one run to one clock: cut to their common time, resample only if allowed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.errors import RecordingError, listed
from herringbone_sim.recording.importing.columns import Columns
from herringbone_sim.recording.importing.spec import ChannelSpec, FileSpec
from herringbone_sim.recording.importing.turns import span, unwrapped
from herringbone_sim.recording.other_rates import SAME, nearest

HOLE = 3.0  # usual steps without a sample beyond which nothing is interpolated; chosen


@dataclass(frozen=True)
class ClockGroup:
    """Channels of one file that share their times.

    Attributes:
        label: name of the file, for messages.
        times: (n,) [s], strictly increasing.
        values: channel -> (n,), SI.
        resample: whether it may be interpolated at the times of another file.
    """

    label: str
    times: Array
    values: Mapping[str, Array]
    resample: bool

    @property
    def rate_hz(self) -> float:
        return float((len(self.times) - 1) / (self.times[-1] - self.times[0]))


@dataclass(frozen=True)
class Merged:
    """All channels of a run at the times of its first group.

    Attributes:
        times: (n,) [s] from 0.
        values: channel -> (n,), SI.
        left: channel -> reason why it is not in ``values``.
        notes: sentences on what was cut or interpolated.
    """

    times: Array
    values: dict[str, Array]
    left: dict[str, str]
    notes: tuple[str, ...]


def clock_groups(file: FileSpec, columns: Columns, zero: np.datetime64 | None) -> list[ClockGroup]:
    """Convert the channels of a file to SI and group them by their clock.

    Args:
        file: specification of the file.
        columns: its columns.
        zero: date that is time 0 of the run; None if no file has dates.

    Raises:
        RecordingError: a column and its clock differ in length, or a clock does not increase.
    """
    groups: dict[bytes, tuple[Array, dict[str, Array]]] = {}
    for channel in file.channels:
        times = _times(file, columns, channel, zero)
        group = groups.setdefault(times.tobytes(), (times, {}))
        raw = columns.values[channel.column]
        if len(raw) != len(times):
            raise RecordingError(
                f"column {channel.column!r} of {file.path} must have as many rows as its clock, "
                f"got {len(raw)} and {len(times)}: give it an entry of files of its own"
            )
        if channel.turn and span(raw) <= channel.turn:
            per_rad = channel.turn / (2.0 * np.pi)
            raw = per_rad * unwrapped(raw / per_rad)  # a scale is of the shaft, not of its turns
        group[1][channel.name] = channel.gain * raw + channel.offset
    streams = [ClockGroup(file.path.name, *group, file.resample) for group in groups.values()]
    for stream in streams:
        _check(file, stream.times)
    return streams


def first_date(file: FileSpec, columns: Columns) -> np.datetime64 | None:
    """Return the earliest first time stamp of a file's clocks; None if no clock has dates."""
    clocks = [columns.values[file.time.column]] if file.time.column else []
    clocks += columns.stamps.values() if file.time.own else []
    dates = [clock[0] for clock in clocks if clock.dtype.kind == "M" and len(clock)]
    return min(dates) if dates else None


def _times(
    file: FileSpec, columns: Columns, channel: ChannelSpec, zero: np.datetime64 | None
) -> Array:
    """Return the times (n,) [s] of a channel on the clock of the run."""
    time = file.time
    if time.rate_hz is not None:
        own = time.start_s + np.arange(len(columns.values[channel.column])) / time.rate_hz
    elif time.column is not None:
        own = columns.values[time.column]
    elif channel.column in columns.stamps:
        own = columns.stamps[channel.column]
    else:
        raise RecordingError(
            f"column {channel.column!r} of {file.path} has no clock of its own: give its file a "
            "time, a column or a rate"
        )
    if own.dtype.kind == "M":
        assert zero is not None  # one of the dates is the first
        own = (own - zero) / np.timedelta64(1, "ns") * 1e-9
    else:
        own = own * time.unit_s
    times: Array = own + time.trigger_offset_s
    return times


def _check(file: FileSpec, times: Array) -> None:
    """Raise RecordingError unless times are finite and strictly increasing."""
    steps = np.diff(times)
    wrong = ~(np.isfinite(times[:-1]) & np.isfinite(times[1:]) & (steps > 0.0))
    if len(times) < 2 or wrong.any():
        at = int(np.argmax(wrong)) if wrong.size else 0
        pair = [f"{time:.12g} s" for time in times[at : at + 2]]
        got = f"{listed(pair)} at row {at + 1}"
        raise RecordingError(
            f"time in {file.path} must increase strictly over two samples or more, got {got}: "
            "mend the file, or name the column of its clock"
        )


def merged(parts: Sequence[ClockGroup]) -> Merged:
    """Bring the channels of all groups to the times of the first group.

    Groups with other sample times are interpolated linearly if they may be, else left out. The run
    is cut to the time that all remaining groups have, and starts at 0.

    Raises:
        RecordingError: the files do not overlap in time.
    """
    main, left_out, notes = parts[0], dict[str, str](), list[str]()
    joined: list[ClockGroup] = []
    for group in parts[1:]:
        fits = group.resample or _same_samples(main.times, group.times)
        if fits:
            joined.append(group)
            continue
        reason = (
            f"{group.label} has a clock of its own ({group.rate_hz:.6g} Hz), {main.label} "
            f"{main.rate_hz:.6g} Hz: set resample: true to bring it there by straight lines"
        )
        if group.times[0] > main.times[-1] or group.times[-1] < main.times[0]:
            reason = (
                f"{group.label} has {group.times[0]:.6g} s to {group.times[-1]:.6g} s, "
                f"{main.label} {main.times[0]:.6g} s to {main.times[-1]:.6g} s, nothing in "
                "common: mend start or trigger_offset"
            )
        left_out |= dict.fromkeys(group.values, reason)
    rows = _overlap(main, joined)
    times = main.times[rows]
    if rows.stop - rows.start < len(main.times):
        cut = len(main.times) - (rows.stop - rows.start)
        notes.append(f"{cut} samples of {main.label} lie outside of the other files: cut off")
    values = {name: column[rows] for name, column in main.values.items()}
    for group in joined:
        same = _same_samples(main.times, group.times)
        values |= {n: _at(times, group.times, v, same) for n, v in group.values.items()}
        if not same:
            folds = ", and what is faster folds back" if group.rate_hz > main.rate_hz else ""
            notes.append(
                f"{group.label}: {group.rate_hz:.6g} Hz brought to {main.rate_hz:.6g} Hz by "
                f"straight lines{folds}"
            )
    return Merged(times - times[0], values, left_out, tuple(notes))


def _same_samples(times: Array, others: Array) -> bool:
    """Whether two clocks have the same sample times, within ``SAME`` steps, where they overlap."""
    reach = SAME * min(np.median(np.diff(times)), np.median(np.diff(others)))
    low, high = max(times[0], others[0]) - reach, min(times[-1], others[-1]) + reach
    both = times[(times >= low) & (times <= high)]
    counted = np.count_nonzero((others >= low) & (others <= high))
    if not len(both) or len(both) != counted:
        return False
    return bool((np.abs(others[nearest(both, others)] - both) <= reach).all())


def _overlap(main: ClockGroup, others: Sequence[ClockGroup]) -> slice:
    """Return the rows of ``main`` within the times of all others; RecordingError if too few."""
    reach = SAME * float(np.median(np.diff(main.times)))
    low = max((group.times[0] for group in others), default=-np.inf) - reach
    high = min((group.times[-1] for group in others), default=np.inf) + reach
    rows = np.flatnonzero((main.times >= low) & (main.times <= high))
    if len(rows) < 2:
        spans = "; ".join(
            f"{group.label} from {group.times[0]:.6g} s to {group.times[-1]:.6g} s"
            for group in (main, *others)
        )
        raise RecordingError(
            f"the files of a run must overlap in time, got {spans}: mend start or trigger_offset"
        )
    return slice(int(rows[0]), int(rows[-1]) + 1)


def _at(times: Array, sample_times: Array, values: Array, same: bool) -> Array:
    """Return values at other times: of the nearest samples if ``same``, else interpolated.

    NaN where samples are missing: between two that are more than ``HOLE`` usual steps apart.
    """
    if same:
        there: Array = values[nearest(times, sample_times)]
        return there
    between: Array = np.interp(times, sample_times, values)
    steps = np.diff(sample_times)
    after = np.clip(np.searchsorted(sample_times, times), 1, len(steps))
    hole = (steps[after - 1] > HOLE * np.median(steps)) & ~np.isin(times, sample_times)
    between[hole] = np.nan
    return between
