"""Read a run: samples, channels and parameter changes of any recording, finished or cut."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.cdr import Array
from herringbone_sim.recording.load import ParameterChange, iter_sample_blocks, load

__all__ = ["ParameterChange", "Recording", "first_jump", "iter_sample_blocks", "read_recording"]


@dataclass(frozen=True)
class Recording:
    """A run that was read.

    Attributes:
        path: as it was named: a run folder or a .mcap file.
        name: of the run.
        samples: full-rate samples.
        channels: content of the ``channels`` topic; empty if there is none.
        changes: parameter changes in the order of the file.
        complete: whether the file was finished.
        notes: a sentence on everything odd.
    """

    path: Path
    name: str
    samples: TimeSeries
    channels: dict[str, Any]
    changes: tuple[ParameterChange, ...]
    complete: bool
    notes: tuple[str, ...]


def first_jump(times: Array) -> int | None:
    """Index of the first sample that is not later than the one before; None if there is none."""
    steps = np.diff(times)
    late = ~(steps > 0)
    return int(np.argmax(late)) + 1 if late.any() else None


def read_recording(path: Path | str, cut_at_jump: bool = False) -> Recording:
    """Read a run folder or a .mcap file, written by this package or by a rig.

    Args:
        path: run folder or .mcap file.
        cut_at_jump: keep only the samples before the first at which time does not increase.

    Raises:
        RecordingError: nothing there, no samples, channels that change or belong to two nodes,
            a message that is no valid CDR, or time that does not increase.
    """
    raw = load(path)
    times, rows = raw.times, raw.rows
    jump = first_jump(times)
    before, after = (float(times[jump - 1]), float(times[jump])) if jump else (0.0, 0.0)
    if jump is not None and not cut_at_jump:
        raise RecordingError(
            f"time must increase strictly, {raw.path} has {after!r} s after "
            f"{before!r} s at sample {jump}: mend the clock of the recorder, or read "
            "with cut_at_jump=True what lies before"
        )
    if jump is not None:
        raw.notes.append(
            f"time goes from {before!r} s to {after!r} s at sample {jump}: "
            f"{len(rows) - jump} samples from there on are left out"
        )
        times, rows = times[:jump], rows[:jump]
    samples = TimeSeries(times, rows, raw.names)
    notes = tuple(raw.notes)
    return Recording(raw.path, raw.name, samples, raw.channels, raw.changes, raw.complete, notes)
