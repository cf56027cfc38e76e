"""What an import goes by: which column of which file is which channel, in which unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from herringbone_sim.core.parameters import Parameters


@dataclass(frozen=True)
class ChannelSpec:
    """One channel: SI value = gain x number in the file + offset.

    Attributes:
        name: of the channel.
        column: as the file calls it.
        unit: in the file.
        gain: unit, scale and sign together [SI].
        offset: [SI].
    """

    name: str
    column: str
    unit: str
    gain: float
    offset: float


@dataclass(frozen=True)
class TimeSpec:
    """The clock of a file: t = its own time + trigger_offset_s, on the clock of the run.

    Attributes:
        column: that holds the time; None where it follows from the rate.
        unit_s: seconds in one unit of that column.
        rate_hz: samples a second; None with a column.
        start_s: time of the first sample, with a rate.
        trigger_offset_s: by how much this file's zero is later than that of the run.
    """

    column: str | None = None
    unit_s: float = 1.0
    rate_hz: float | None = None
    start_s: float = 0.0
    trigger_offset_s: float = 0.0

    @property
    def own(self) -> bool:
        """Whether the file's own stamps are its clock."""
        return self.column is None and self.rate_hz is None


@dataclass(frozen=True)
class FileSpec:
    """One file of a run.

    Attributes:
        path: it lies there.
        kind: csv, parquet, mat, tdms, hdf5 or rosbag2.
        time: its clock; with neither column nor rate, that of the file itself.
        channels: taken of it.
        resample: whether another clock is brought to that of the run, by straight lines.
        options: of tables of text: delimiter, decimal, encoding, skip, skip_after_names.
    """

    path: Path
    kind: str
    time: TimeSpec
    channels: tuple[ChannelSpec, ...]
    resample: bool
    options: Mapping[str, Any]


@dataclass(frozen=True)
class RunSpec:
    """A run: its folder's name, role, operating point [SI] and files."""

    name: str
    role: str
    point: Mapping[str, float]
    files: tuple[FileSpec, ...]


@dataclass(frozen=True)
class ImportSpec:
    """All that a spec says.

    Attributes:
        rig: name.
        nominal: the data sheet, full model.
        shaft: angle channel that the mesh phase is made of; empty where phase is a column.
        phase_offset: mesh phase [rad] where that angle is zero.
        noise, sensors: passed on to campaign.yaml.
    """

    rig: str
    nominal: Parameters
    shaft: str
    phase_offset: float
    runs: tuple[RunSpec, ...]
    noise: Mapping[str, Any] | None
    sensors: Mapping[str, Any] | None


def made_of(channel: str) -> str:
    """Name that a channel of a spec has in the recording."""
    return channel.replace("angle_", "u_", 1) if channel.startswith("angle_") else channel
