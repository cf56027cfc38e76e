"""Content of the files of a run, whose times are not checked, and notes on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.errors import listed
from herringbone_sim.recording.channels import Channels
from herringbone_sim.recording.gaps import gap_notes
from herringbone_sim.recording.messages import Value
from herringbone_sim.recording.other_rates import OtherSamples


@dataclass(frozen=True)
class ParameterChange:
    """Parameters that changed together.

    Attributes:
        t_s: simulation time at which they took effect in the samples [s].
        t_ns: the same time as recorded [ns].
        node: full name of the node.
        values: new value by parameter name; None for a deleted one.
    """

    t_s: float
    t_ns: int
    node: str
    values: Mapping[str, Value]


@dataclass
class RawRecording:
    """Content of the files of a run; times are not checked.

    Attributes:
        names: c channel names.
        rows: (n, c) samples.
        others: samples of sensors with rates of their own, by topic.
        complete: whether every file exists and was finished.
        missing_files: names of files that ``metadata.yaml`` lists and that do not exist.
        recovered: whether a file was rebuilt after it had been cut off.
        counted: number of samples that the writer counted; None if a file has no count.
        bytes_on_disk: size of the .mcap files.
        notes: a sentence on each irregularity.
    """

    path: Path
    name: str
    names: tuple[str, ...] = ()
    rows: Array = field(default_factory=lambda: np.empty((0, 0)))
    others: tuple[OtherSamples, ...] = ()
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


def no_samples_message(raw: RawRecording, topics: set[str]) -> str:
    """Return why a run has no samples, and what to do; ``topics``: its topics for samples."""
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
    """Return sentences on missing channel data or samples, and changes outside of the samples."""
    notes = []
    if not raw.channels.content:
        notes.append("there is no channels message: units and parameters are unknown")
    if raw.counted is not None and raw.counted != len(raw.rows):
        notes.append(f"the writer counted {raw.counted} samples, {len(raw.rows)} were read")
    return notes + gap_notes(raw.names, raw.rows) + _change_notes(raw)


def _change_notes(raw: RawRecording) -> list[str]:
    """Return a sentence on parameter changes outside of the time of the samples, if any."""
    times = raw.times
    outside = [change for change in raw.changes if not times[0] <= change.t_s <= times[-1]]
    if not outside:
        return []
    return [
        f"{len(outside)} of {len(raw.changes)} parameter changes lie outside of the samples, the "
        f"first at {outside[0].t_s:.9g} s"
    ]
