"""What lies in the files of a run, and what can be said of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from herringbone_sim.errors import listed
from herringbone_sim.recording.cdr import Array
from herringbone_sim.recording.channels import Channels
from herringbone_sim.recording.gaps import gap_notes
from herringbone_sim.recording.messages import Value


@dataclass(frozen=True)
class ParameterChange:
    """Parameters that changed together.

    Attributes:
        t_s: simulation time [s] at which they took effect in ``samples``.
        t_ns: the same, as recorded [ns].
        node: full name of the node.
        values: new value by parameter name; None for a deleted one.
    """

    t_s: float
    t_ns: int
    node: str
    values: Mapping[str, Value]


@dataclass
class RawRecording:
    """What lies in the files of a run, with time as it is, not checked.

    Attributes:
        names: c channel names.
        rows: (n, c) samples.
        complete: whether every file is there and was finished.
        missing_files: names of those that ``metadata.yaml`` tells of and are not there.
        counted: samples that the writer says it wrote; None if a file doesn't say.
        recovered: whether a file of it was rebuilt after it was cut off.
        bytes_on_disk: size of the .mcap files.
    """

    path: Path
    name: str
    names: tuple[str, ...] = ()
    rows: Array = field(default_factory=lambda: np.empty((0, 0)))
    channels: Channels = field(default_factory=Channels)
    changes: tuple[ParameterChange, ...] = ()
    complete: bool = True
    missing_files: tuple[str, ...] = ()
    recovered: bool = False
    counted: int | None = None
    bytes_on_disk: int = 0
    notes: list[str] = field(default_factory=list)

    @property
    def times(self) -> Array:
        """Times (n,) of the samples [s], a copy."""
        return np.array(self.rows[:, self.names.index("t")])


def without_samples(raw: RawRecording, topics: set[str]) -> str:
    """Why there are none, and what to do."""
    if not raw.complete or raw.recovered:
        return (
            f"a run must hold samples, {raw.path} was cut off before the first of them were whole "
            "on the disk: record it again"
        )
    if topics:
        return (
            f"a run must hold samples, {raw.path} ended before the first: {listed(topics)} has "
            "none; record it again"
        )
    return (
        f"a run must hold samples, {raw.path} has none: record a topic whose name ends in "
        "/samples (std_msgs/Float64MultiArray)"
    )


def content_notes(raw: RawRecording) -> list[str]:
    notes = []
    if not raw.channels.content:
        notes.append("there is no channels message: units and parameters are unknown")
    if raw.counted is not None and raw.counted != len(raw.rows):
        notes.append(f"the writer counted {raw.counted} samples, {len(raw.rows)} were read")
    return notes + gap_notes(raw.names, raw.rows) + _change_notes(raw)


def _change_notes(raw: RawRecording) -> list[str]:
    times = raw.times
    outside = [change for change in raw.changes if not times[0] <= change.t_s <= times[-1]]
    if not outside:
        return []
    return [
        f"{len(outside)} of {len(raw.changes)} parameter changes lie outside of the samples, the "
        f"first at {outside[0].t_s:.9g} s"
    ]
