"""Read a run: samples, channel data and parameter changes of a recording, finished or cut."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.channels import Channels
from herringbone_sim.recording.load import iter_sample_blocks, load
from herringbone_sim.recording.other_rates import beside
from herringbone_sim.recording.raw import ParameterChange

__all__ = ["ParameterChange", "Recording", "first_jump", "iter_sample_blocks", "read_recording"]


@dataclass(frozen=True)
class Recording:
    """Content of a run; time increases strictly.

    Attributes:
        path: the run folder or .mcap file that was read.
        name: name of the folder, or of the file without its suffix.
        samples: samples of all channels at the full rate; if time jumps, only those of the
            longest stretch over which it increases.
        channels: content of the ``channels`` topic; empty if there is none.
        changes: parameter changes in the order of the file.
        complete: whether every file of the run exists and was finished.
        notes: a sentence on each irregularity.
        jump_s: time [s] of the last sample before the first jump of time, which the last note
            describes; None if the recorded time increases throughout.
    """

    path: Path
    name: str
    samples: TimeSeries
    channels: Channels
    changes: tuple[ParameterChange, ...]
    complete: bool
    notes: tuple[str, ...]
    jump_s: float | None = None


def first_jump(times: Array) -> int | None:
    """Return the index of the first sample not later than the one before; None without any."""
    late = _late(times)
    return int(np.argmax(late)) + 1 if late.any() else None


def _late(times: Array) -> Flags:
    """Return (n - 1,) flags of the samples 1, 2, ... that are not later than the one before."""
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.diff(times)
    return ~((steps > 0) & np.isfinite(steps))


def longest_stretch(times: Array) -> slice:
    """Return the slice of the longest stretch over which time (n,) increases."""
    breaks = np.flatnonzero(_late(times)) + 1
    edges = np.concatenate([[0], breaks, [len(times)]])
    at = int(np.diff(edges).argmax())
    return slice(int(edges[at]), int(edges[at + 1]))


def read_recording(
    path: Path | str, cut_at_jump: bool = False, most_bytes: int | None = None
) -> Recording:
    """Read a run folder or a .mcap file, written by this package or by a rig.

    Channels of topics such as ``samples_torque``, of another rate, stand beside the samples of
    their time, see ``other_rates``.

    Args:
        path: run folder or .mcap file.
        cut_at_jump: if time does not increase throughout, return the longest stretch over which
            it does instead of raising RecordingError.
        most_bytes: memory limit [bytes]; None: 40 times the size on the disk, at least 256 MiB.

    Raises:
        RecordingError: no such run, no samples, channels that change or belong to two nodes, a
            message that is no valid CDR, time that does not increase, or more than ``most_bytes``.
    """
    raw = load(path, most_bytes)
    times, rows = raw.times, raw.rows
    jump = first_jump(times)
    before, after = (float(times[jump - 1]), float(times[jump])) if jump else (0.0, 0.0)
    if jump is not None and not cut_at_jump:
        raise RecordingError(
            f"time must increase strictly, {raw.path} has {after!r} s after "
            f"{before!r} s at sample {jump}: mend the clock of the recorder, or read "
            "in Python with cut_at_jump=True the longest stretch without a jump"
        )
    if jump is not None:
        stretch = longest_stretch(times)
        n_left_out = len(times) - (stretch.stop - stretch.start)
        where = (
            "from there on" if stretch.start == 0 else f"outside of {stretch.start}:{stretch.stop}"
        )
        raw.notes.append(
            f"time goes from {before!r} s to {after!r} s at sample {jump}: {n_left_out} samples "
            f"{where} are left out"
        )
        times, rows = times[stretch], rows[stretch]
    # Where time jumps, nothing tells of which stretch a reading is.
    samples, notes = beside(TimeSeries(times, rows, raw.names), raw.others if jump is None else ())
    if jump is not None:
        notes += [
            f"the readings of {other.topic} are left out: time jumps, so it is not known beside "
            "which samples they stand"
            for other in raw.others
        ]
    notes = [*notes, *raw.notes]  # that on a jump of time is the last
    at = None if jump is None else before
    return Recording(
        raw.path, raw.name, samples, raw.channels, raw.changes, raw.complete, tuple(notes), at
    )
