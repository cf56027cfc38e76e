"""Specification of an import: which column of which file is which channel, in which unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from herringbone_sim.core.parameters import Parameters


@dataclass(frozen=True)
class ChannelSpec:
    """One channel: SI value = gain * number in the file + offset.

    Attributes:
        name: of the channel.
        column: its name in the file.
        unit: in the file.
        gain: product of unit factor, scale and sign [SI].
        offset: [SI].
    """

    name: str
    column: str
    unit: str
    gain: float
    offset: float


@dataclass(frozen=True)
class TimeSpec:
    """The clock of a file: time of the run = time of the file + trigger_offset_s.

    Attributes:
        column: column with the time; None if the time follows from the rate.
        unit_s: unit of that column in seconds.
        rate_hz: sample rate; None with a column.
        start_s: time of the first sample, with a rate.
        trigger_offset_s: how much later the zero of this file is than that of the run.
    """

    column: str | None = None
    unit_s: float = 1.0
    rate_hz: float | None = None
    start_s: float = 0.0
    trigger_offset_s: float = 0.0

    @property
    def own(self) -> bool:
        """Whether the stamps inside the file are its clock."""
        return self.column is None and self.rate_hz is None


@dataclass(frozen=True)
class FileSpec:
    """One file of a run.

    Attributes:
        path: of the file.
        kind: csv, parquet, mat, tdms, hdf5 or rosbag2.
        time: its clock; with neither column nor rate, the stamps inside the file.
        channels: to read from it.
        resample: whether it may be interpolated to the clock of the run.
        options: for csv: delimiter, decimal, encoding, skip, skip_after_names.
    """

    path: Path
    kind: str
    time: TimeSpec
    channels: tuple[ChannelSpec, ...]
    resample: bool
    options: Mapping[str, Any]


@dataclass(frozen=True)
class RunSpec:
    """A run to import.

    Attributes:
        name: of the folder that is written.
        role: ``fit`` or ``held_out``.
        point: operating point delta_T [K], K, T_1 [N m], Omega.
        files: to read it from.
    """

    name: str
    role: str
    point: Mapping[str, float]
    files: tuple[FileSpec, ...]


@dataclass(frozen=True)
class ImportSpec:
    """Content of a spec.

    Attributes:
        rig: its name.
        nominal: parameters by the data sheet, full model.
        shaft: angle channel that the mesh phase is computed from; empty if phase is a column.
        phase_offset: mesh phase [rad] at the zero of that angle.
        noise, sensors: copied to campaign.yaml.
    """

    rig: str
    nominal: Parameters
    shaft: str
    phase_offset: float
    runs: tuple[RunSpec, ...]
    noise: Mapping[str, Any] | None
    sensors: Mapping[str, Any] | None


def recorded_name(channel: str) -> str:
    """Name in the recording of a channel of the spec: ``angle_c`` is recorded as ``u_c``."""
    return channel.replace("angle_", "u_", 1) if channel.startswith("angle_") else channel
