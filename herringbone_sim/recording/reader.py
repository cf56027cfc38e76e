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
from herringbone_sim.recording.raw import ParameterChange

__all__ = ["ParameterChange", "Recording", "first_jump", "iter_sample_blocks", "read_recording"]


@dataclass(frozen=True)
class Recording:
    """A run that was read.

    Attributes:
        path: as given: a run folder or a .mcap file.
        name: of the folder, or of the file without its ending.
        samples: full-rate samples of all channels; of a run cut at a jump of time, the longest
            stretch over which time increases.
        channels: content of the ``channels`` topic; empty if there is none.
        changes: parameter changes in the order of the file.
        complete: whether every file of the run exists and was finished.
        notes: a sentence on each irregularity.
        jump_s: time [s] of the last sample before the first jump, where the next sample is not
            later, which the last note describes; None if time increases throughout.
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
    """Index of the first sample that is not later than the one before; None if there is none."""
    late = _late(times)
    return int(np.argmax(late)) + 1 if late.any() else None


def _late(times: Array) -> Flags:
    """Whether (n - 1,) each sample after the first is not later by a finite time."""
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.diff(times)
    return ~((steps > 0) & np.isfinite(steps))


def longest_stretch(times: Array) -> slice:
    """Slice of the longest stretch over which time (n,) increases."""
    breaks = np.flatnonzero(_late(times)) + 1
    edges = np.concatenate([[0], breaks, [len(times)]])
    at = int(np.diff(edges).argmax())
    return slice(int(edges[at]), int(edges[at + 1]))


def read_recording(
    path: Path | str, cut_at_jump: bool = False, most_bytes: int | None = None
) -> Recording:
    """Read a run folder or a .mcap file, written by this package or by a rig.

    Args:
        path: run folder or .mcap file.
        cut_at_jump: keep the longest stretch over which time increases.
        most_bytes: memory that the samples may take; by default 40 times the size on the disk, at
            least 256 MiB.

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
            "with cut_at_jump=True the longest stretch without a jump"
        )
    if jump is not None:
        kept = longest_stretch(times)
        rest = len(times) - (kept.stop - kept.start)
        where = "from there on" if kept.start == 0 else f"outside of {kept.start}:{kept.stop}"
        raw.notes.append(
            f"time goes from {before!r} s to {after!r} s at sample {jump}: {rest} samples "
            f"{where} are left out"
        )
        times, rows = times[kept], rows[kept]
    samples = TimeSeries(times, rows, raw.names)
    notes = tuple(raw.notes)
    at = None if jump is None else before
    return Recording(
        raw.path, raw.name, samples, raw.channels, raw.changes, raw.complete, notes, at
    )
