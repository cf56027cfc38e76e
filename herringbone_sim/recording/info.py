"""Summary of a run: duration, rates, operating point, parameter changes, gaps, damage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.errors import listed
from herringbone_sim.recording.gaps import Gap, sample_gaps
from herringbone_sim.recording.load import load
from herringbone_sim.recording.raw import ParameterChange, RawRecording
from herringbone_sim.recording.reader import first_jump

OPERATING = ("K", "delta_T", "T_1")
_TWO_PI = 2 * np.pi


@dataclass(frozen=True)
class Channel:
    """Statistics of one channel of the samples.

    Attributes:
        unit: as in the ``channels`` topic, empty if missing.
        nans: number of values that are NaN or infinite.
        minimum, maximum, mean: of the finite values; None without any.
    """

    name: str
    unit: str
    nans: int
    minimum: float | None
    maximum: float | None
    mean: float | None

    @property
    def constant(self) -> bool:
        """Whether all finite values are equal."""
        return self.minimum is not None and self.minimum == self.maximum


@dataclass(frozen=True)
class RunInfo:
    """Summary of a run.

    Attributes:
        n_samples: number of samples in the files.
        t_first_s, t_last_s, duration_s: first and last time, and their difference [s].
        sample_rate_hz: from the median time step; None unless that is positive.
        samples_per_cycle: samples per mesh cycle, from the median step of ``phase``; None without
            ``phase``, or if the step is not positive.
        mesh_hz: mesh frequency [Hz]; None if one of the two above is None.
        channels: one entry per channel.
        changes: parameter changes.
        gaps: gaps of missing samples.
        time_jump: index of the first sample that is not later than the one before; None if time
            increases throughout.
        parameters: parameters of the gear, as recorded.
        source: ``simulator``, or the name of the rig.
        model, version: kind of model and version of this package, if the simulator recorded it.
        complete: whether every file exists and was finished.
        missing_files: names of files that ``metadata.yaml`` lists and that do not exist.
        samples_counted: number of samples that the writer counted; None if not recorded.
        bytes_on_disk, bytes_of_samples: size of the .mcap files, and of the samples in memory.
        notes: a sentence on each irregularity.
    """

    path: Path
    name: str
    source: str
    model: str
    version: str
    n_samples: int
    t_first_s: float
    t_last_s: float
    duration_s: float
    sample_rate_hz: float | None
    samples_per_cycle: float | None
    mesh_hz: float | None
    channels: tuple[Channel, ...]
    changes: tuple[ParameterChange, ...]
    gaps: tuple[Gap, ...]
    time_jump: int | None
    parameters: Mapping[str, Any]
    complete: bool
    missing_files: tuple[str, ...]
    samples_counted: int | None
    bytes_on_disk: int
    bytes_of_samples: int
    notes: tuple[str, ...]

    @property
    def missing(self) -> int:
        """Number of missing samples in all gaps."""
        return sum(gap.missing for gap in self.gaps)


def recording_info(path: Path | str) -> RunInfo:
    """Summarise a run folder or .mcap file, also one whose time goes backwards.

    Raises:
        RecordingError: as ``read_recording``.
    """
    return summarise(load(path))


def summarise(raw: RawRecording) -> RunInfo:
    """Summarise a run that was loaded into memory."""
    times = raw.times
    time_step, phase_step = _median_step(times), _phase_step(raw)
    rate = 1 / time_step if time_step else None
    jump, channels = first_jump(times), _channels(raw)
    return RunInfo(
        path=raw.path,
        name=raw.name,
        source=raw.channels.source,
        model=raw.channels.model,
        version=raw.channels.version,
        n_samples=len(times),
        t_first_s=float(times[0]),
        t_last_s=float(times[-1]),
        duration_s=float(times[-1]) - float(times[0]),
        sample_rate_hz=rate,
        samples_per_cycle=_TWO_PI / phase_step if phase_step else None,
        mesh_hz=phase_step / _TWO_PI * rate if phase_step and rate else None,
        channels=channels,
        changes=raw.changes,
        gaps=sample_gaps(raw.names, raw.rows),
        time_jump=jump,
        parameters=raw.channels.parameters,
        complete=raw.complete,
        missing_files=raw.missing_files,
        samples_counted=raw.counted,
        bytes_on_disk=raw.bytes_on_disk,
        bytes_of_samples=raw.rows.nbytes,
        notes=(*raw.notes, *_jump_notes(times, jump), *_channel_notes(channels)),
    )


def _median_step(values: Array) -> float | None:
    """Return the median difference of successive values; None unless positive and finite."""
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.diff(values)
    middle = float(np.median(steps)) if len(steps) else float("nan")
    return middle if 0 < middle < np.inf else None


def _phase_step(raw: RawRecording) -> float | None:
    """Return the median step of the phase [rad]; None without ``phase`` or a positive step."""
    if "phase" not in raw.names:
        return None
    return _median_step(raw.rows[:, raw.names.index("phase")])


def _channels(raw: RawRecording) -> tuple[Channel, ...]:
    """Return the statistics of every channel."""
    units = raw.channels.units
    return tuple(
        _channel(name, units.get(name, ""), raw.rows[:, column])
        for column, name in enumerate(raw.names)
    )


def _channel(name: str, unit: str, values: Array) -> Channel:
    """Return the statistics of a channel with values (n,)."""
    finite = values[np.isfinite(values)]
    nans = len(values) - len(finite)
    if not len(finite):
        return Channel(name, unit, nans, None, None, None)
    with np.errstate(over="ignore"):
        low, high, mean = float(finite.min()), float(finite.max()), float(finite.mean())
    return Channel(name, unit, nans, low, high, mean)


def _jump_notes(times: Array, jump: int | None) -> list[str]:
    """Return a sentence on the first sample that is not later than the one before, if any."""
    if jump is None:
        return []
    return [
        f"time goes from {float(times[jump - 1])!r} s to {float(times[jump])!r} s at sample {jump}"
    ]


def _channel_notes(channels: tuple[Channel, ...]) -> list[str]:
    """Return sentences on channels with values that are not finite, and on constant channels."""
    broken = [f"{channel.name} ({channel.nans})" for channel in channels if channel.nans]
    still = [c.name for c in channels if c.constant and c.name not in OPERATING]
    notes = [f"no finite number in some samples of {listed(broken)}"] if broken else []
    return notes + ([f"constant throughout: {listed(still)}"] if still else [])
