"""Load the files of a run into memory: of any program, finished or cut, times unchecked."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.bag import METADATA_NAME
from herringbone_sim.recording.cdr import Array, Buffer
from herringbone_sim.recording.gaps import gap_notes
from herringbone_sim.recording.messages import (
    Value,
    decode_parameter_event,
    decode_samples,
    decode_string,
)
from herringbone_sim.recording.scan import Found, Scan
from herringbone_sim.recording.writer import RECORD_NAME


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
        counted: samples that the writer says it wrote; None if it doesn't say.
        bytes_on_disk: size of the .mcap files.
    """

    path: Path
    name: str
    names: tuple[str, ...] = ()
    rows: Array = field(default_factory=lambda: np.empty((0, 0)))
    channels: dict[str, Any] = field(default_factory=dict)
    changes: tuple[ParameterChange, ...] = ()
    complete: bool = True
    counted: int | None = None
    bytes_on_disk: int = 0
    notes: list[str] = field(default_factory=list)

    @property
    def times(self) -> Array:
        """Times (n,) of the samples [s], a copy."""
        return np.array(self.rows[:, self.names.index("t")])


def bag_files(path: Path | str) -> list[Path]:
    """The .mcap files of a run folder, in order, or the one that is named.

    Raises:
        RecordingError: no such path, or nothing to read in it.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f"there is no {path}: name a run folder or a .mcap file")
    if path.is_file():
        return [path]
    files = _listed(path) or sorted(path.glob("*.mcap"), key=_natural)
    if not files:
        runs = sorted(file.parent.name for file in path.glob("*/*.mcap"))
        hint = f"name one of its runs, as {path / runs[0]}" if runs else "name another folder"
        raise RecordingError(f"a run folder must hold a .mcap file, {path} has none: {hint}")
    return files


def _listed(folder: Path) -> list[Path]:
    """Files that ``metadata.yaml`` names, where all of them are there."""
    names = bag_information(folder)[0].get("relative_file_paths")
    files = [folder / str(name) for name in names] if isinstance(names, list) else []
    return files if all(file.is_file() for file in files) else []


def _natural(file: Path) -> list[int]:
    return [int(digits) for digits in re.findall(r"\d+", file.name)]


def bag_information(folder: Path) -> tuple[dict[str, Any], list[str]]:
    """Content of ``metadata.yaml``, empty if there is none, and what is odd about it."""
    try:
        text = (folder / METADATA_NAME).read_text(encoding="utf-8")
        information = yaml.safe_load(text)["rosbag2_bagfile_information"]
        return dict(information), []
    except FileNotFoundError:
        return {}, [f"{METADATA_NAME} is missing: 'python -m herringbone_sim recover' writes it"]
    except (OSError, ValueError, yaml.YAMLError, KeyError, TypeError):
        return {}, [
            f"{METADATA_NAME} can't be read: 'python -m herringbone_sim recover' writes it anew"
        ]


def is_samples(found: Found) -> bool:
    """Whether this is a message of the ``samples`` topic of any node."""
    last, kind = (text.rpartition("/")[2] for text in (found.topic.name, found.topic.type_name))
    return (last, kind) == ("samples", "Float64MultiArray")


def iter_sample_blocks(path: Path | str) -> Iterator[tuple[tuple[str, ...], Array]]:
    """Channel names (c,) and rows (n, c), one message at a time, in the order of the file.

    Raises:
        RecordingError: see ``read_recording``; time is not checked.
    """
    blocks = _Samples(Path(path))
    for file in bag_files(path):
        for found in Scan(file).messages():
            if is_samples(found):
                yield blocks.decode(found)


class _Samples:
    """Decodes ``samples`` and holds that topic and channels stay the same."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topic = ""
        self.names: tuple[str, ...] = ()
        self.n = 0

    def decode(self, found: Found) -> tuple[tuple[str, ...], Array]:
        names, rows = decode_samples(found.message)
        if not self.topic:
            self.topic, self.names = found.topic.name, names
            self._check_names()
        if found.topic.name != self.topic:
            raise RecordingError(
                f"a run must hold the samples of one node, {self.path} has {self.topic} and "
                f"{found.topic.name}: record each into a run of its own"
            )
        if names != self.names:
            raise RecordingError(
                f"the channels must stay the same throughout {self.path}, got {len(names)} "
                f"({', '.join(names[:3])}, ...) after {len(self.names)} at sample {self.n}: "
                "start a new run when the channels change"
            )
        self.n += len(rows)
        return names, rows

    def _check_names(self) -> None:
        twice = {name for name in self.names if self.names.count(name) > 1}
        if "t" not in self.names or twice:
            raise RecordingError(
                f"the samples of {self.path} must have a channel t and no name twice, got "
                f"{', '.join(self.names)}: mend the label of the layout's second dimension"
            )


def load(path: Path | str) -> RawRecording:
    """All of a run in memory, without a check of its times; errors as in ``read_recording``."""
    path = Path(path)
    raw = RawRecording(path, path.stem if path.is_file() else path.resolve().name)
    samples, blocks = _Samples(path), list[Array]()
    changes: list[ParameterChange] = []
    folder = path if path.is_dir() else path.parent
    raw.notes += _metadata_notes(folder)
    for file in bag_files(path):
        scan = Scan(file)
        for found in scan.messages():
            if is_samples(found):
                blocks.append(samples.decode(found)[1])
            else:
                _take_other(raw, changes, found)
        _take_scan(raw, scan)
    raw.names, raw.rows = samples.names, _joined(path, blocks, raw.complete)
    raw.changes = tuple(changes)
    raw.notes += _content_notes(raw)
    return raw


def _take_other(raw: RawRecording, changes: list[ParameterChange], found: Found) -> None:
    last = found.topic.name.rpartition("/")[2]
    try:
        if last == "channels":
            raw.channels = _channels(found.message)
        elif last == "parameter_events":
            event = decode_parameter_event(found.message)
            change = ParameterChange(
                event.stamp_ns / 1e9, event.stamp_ns, event.node, event.changed
            )
            changes.append(change)
    except RecordingError as error:
        raw.notes.append(f"a message of {found.topic.name} is left out: {error}")


def _channels(message: Buffer) -> dict[str, Any]:
    try:
        content = json.loads(decode_string(message))
    except json.JSONDecodeError as error:
        raise RecordingError(f"it must be JSON, got {error}: mend the program") from error
    if not isinstance(content, dict):
        raise RecordingError(
            f"it must be a JSON object, got {type(content).__name__}: mend the program"
        )
    return content


def _take_scan(raw: RawRecording, scan: Scan) -> None:
    raw.notes += scan.notes + scan.end_notes()
    raw.complete &= scan.complete
    raw.bytes_on_disk += scan.size
    told = dict(scan.metadata).get(RECORD_NAME, {}).get("samples_written", "")
    if told.isdigit():
        raw.counted = (raw.counted or 0) + int(told)


def _joined(path: Path, blocks: list[Array], complete: bool) -> Array:
    if not sum(map(len, blocks)) and not complete:
        raise RecordingError(
            f"a run must hold samples, {path} was cut off before the first of them were whole on "
            "the disk: record it again"
        )
    if not sum(map(len, blocks)):
        raise RecordingError(
            f"a run must hold samples, {path} has none: record a topic whose name ends in "
            "/samples (std_msgs/Float64MultiArray)"
        )
    return np.concatenate(blocks)


def _metadata_notes(folder: Path) -> list[str]:
    """What is odd about ``metadata.yaml``; a bag compressed by rosbag2 itself can't be read."""
    information, notes = bag_information(folder)
    mode = str(information.get("compression_mode") or "none").lower()
    if mode not in ("none", "storage"):
        raise RecordingError(
            f"a run must be compressed inside its MCAP chunks, {folder} has the compression mode "
            f"{mode!r}: rewrite it with 'ros2 bag convert'"
        )
    return notes


def _content_notes(raw: RawRecording) -> list[str]:
    notes = []
    if not raw.channels:
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
