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
        name: name of the channel.
        column: name of its column in the file.
        unit: unit in the file.
        gain: factor of ``unit`` to SI, times ``scale`` and ``sign`` of the specification.
        offset: added after the gain, in SI.
        turn: number in the file at which an angle with a ``scale`` starts anew; None: of no angle.
    """

    name: str
    column: str
    unit: str
    gain: float
    offset: float
    turn: float | None = None


@dataclass(frozen=True)
class TimeSpec:
    """The clock of a file: time of the run = time of the file + trigger_offset_s.

    Attributes:
        column: column with the time; None for a clock by rate, or by stamps in the file.
        unit_s: unit of that column [s]; not used for dates.
        rate_hz: sample rate [Hz]; None for a clock by a column or by stamps.
        start_s: time of the first sample [s], with a rate.
        trigger_offset_s: time 0 of the file on the clock of the run [s].
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
        path: path of the file.
        kind: csv, parquet, mat, tdms, hdf5 or rosbag2.
        time: clock of the file.
        channels: channels to read from it.
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
        name: name of the run, and of the folder that is written.
        role: ``fit`` or ``held_out``.
        point: operating point delta_T [K], K, T_1 [N m], Omega.
        files: files to read the run from.
    """

    name: str
    role: str
    point: Mapping[str, float]
    files: tuple[FileSpec, ...]


@dataclass(frozen=True)
class ImportSpec:
    """Content of a spec.

    Attributes:
        rig: name of the rig.
        nominal: parameters by the data sheet, full model.
        shaft: angle channel that the mesh phase is computed from; empty if phase is a column.
        phase_offset: mesh phase [rad] at the zero of that angle.
        runs: the runs to import.
        noise, sensors: copied to campaign.yaml; None if missing.
    """

    rig: str
    nominal: Parameters
    shaft: str
    phase_offset: float
    runs: tuple[RunSpec, ...]
    noise: Mapping[str, Any] | None
    sensors: Mapping[str, Any] | None


def recorded_name(channel: str) -> str:
    """Return the recorded name of a channel: ``u_c`` for ``angle_c``, others unchanged."""
    return channel.replace("angle_", "u_", 1) if channel.startswith("angle_") else channel
