"""Load the files of a run, finished or cut off, into memory without checking the times."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.errors import RecordingError, listed, shown
from herringbone_sim.recording.bag import METADATA_NAME, Topic
from herringbone_sim.recording.channels import read_channels
from herringbone_sim.recording.files import (
    BagInformation,
    bag_files,
    check_file,
    readable_bag,
)
from herringbone_sim.recording.messages import (
    decode_parameter_event,
    decode_samples,
    decode_string,
)
from herringbone_sim.recording.other_rates import OtherSamples
from herringbone_sim.recording.raw import (
    ParameterChange,
    RawRecording,
    content_notes,
    no_samples_message,
)
from herringbone_sim.recording.run_files import RECORD_NAME
from herringbone_sim.recording.scan import MOST_NOTES, Scan, ScannedMessage

# Memory limit for a small run: one chunk of the largest size.
LEAST_MEMORY = 256 << 20
# Memory limit per byte on the disk; periodic motions with many planets compress nearly as much.
MEMORY_RATIO = 40
# Temporary columns in memory beside the channels while a run is read: times, steps, gaps.
_COLUMNS_AT_WORK = 8
# Text of a plausible number of samples.
_COUNT = re.compile("[0-9]{1,15}")
# Memory of a parameter event: bytes of the object, and bytes per byte of the message.
_EVENT_BYTES, _EVENT_RATIO = 512, 8


def is_samples(topic: Topic) -> bool:
    """Whether a topic is the ``samples`` topic of any node."""
    last, kind = (text.rpartition("/")[2] for text in (topic.name, topic.type_name))
    return (last, kind) == ("samples", "Float64MultiArray")


def is_of_another_rate(topic: Topic) -> bool:
    """Whether a topic has samples of sensors with a rate of their own, as ``samples_torque``."""
    last, kind = (text.rpartition("/")[2] for text in (topic.name, topic.type_name))
    return last.startswith("samples_") and kind == "Float64MultiArray"


def iter_sample_blocks(path: Path | str) -> Iterator[tuple[tuple[str, ...], Array]]:
    """Yield channel names (c,) and rows (n, c) of each message, in the order of the file.

    Raises:
        RecordingError: see ``read_recording``; time is not checked.
    """
    blocks = _Samples(Path(path))
    for file in bag_files(path):
        for message in Scan(file).messages():
            if is_samples(message.topic):
                yield blocks.decode(message)


class _Samples:
    """Decoder of the ``samples`` messages of a run; topic and channels must stay the same."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topic = ""
        self.names: tuple[str, ...] = ()
        self.n = 0

    def decode(self, scanned: ScannedMessage) -> tuple[tuple[str, ...], Array]:
        """Decode a ``samples`` message and count its rows.

        Returns:
            Names (c,) of the channels and samples (n, c).

        Raises:
            RecordingError: the message can't be decoded, the names are not unique, not printable
                or without ``t``, or topic or names differ from those of the first message.
        """
        names, rows = decode_samples(scanned.message)
        if not self.topic:
            self.names = names
            self._check_names()
            self.topic = scanned.topic.name
        if scanned.topic.name != self.topic:
            raise RecordingError(
                f"a run must hold the samples of one node, {self.path} has "
                f"{listed([self.topic])} and {listed([scanned.topic.name])}: record each into a "
                "run of its own"
            )
        if names != self.names:
            raise RecordingError(
                f"the channels must stay the same throughout {self.path}, got {len(names)} "
                f"({listed(names[:3])}, ...) after {len(self.names)} at sample {self.n}: "
                "start a new run when the channels change"
            )
        self.n += len(rows)
        return names, rows

    def _check_names(self) -> None:
        """Raise RecordingError unless the names are unique, printable and include ``t``."""
        odd = not all(name.isprintable() for name in self.names)
        if "t" not in self.names or odd or len(set(self.names)) < len(self.names):
            raise RecordingError(
                f"the samples of {self.path} must have a channel t and no name twice, got "
                f"{listed(self.names if not odd else [shown(name) for name in self.names])}: "
                "mend the label of the layout's second dimension"
            )


class _Loading:
    """Accumulate the content of the files of a run, in order, within a memory limit [bytes]."""

    def __init__(self, path: Path, most_bytes: int) -> None:
        name = path.stem if check_file(path) else path.resolve().name
        self.raw = RawRecording(path, name)
        self.samples = _Samples(path)
        self.changes: list[ParameterChange] = []
        self._most_bytes = most_bytes
        self._left = most_bytes
        self._n_left_out = self.n_messages = 0
        self._topics: set[str] = set()
        self._counts: list[int | None] = []
        # All rows in one growing buffer, so that no chunk stays in memory.
        self._content = bytearray()
        self._others: dict[str, tuple[_Samples, bytearray]] = {}

    def take_file(self, file: Path) -> None:
        """Read all messages of the next file."""
        scan = Scan(file)
        has_channels = False
        for message in scan.messages():
            self.n_messages += 1
            last = message.topic.name.rpartition("/")[2]
            if is_samples(message.topic):
                self._take_rows(self.samples, self._content, message)
            elif is_of_another_rate(message.topic):
                fresh = _Samples(self.raw.path), bytearray()
                of_topic = self._others.setdefault(message.topic.name, fresh)
                self._guarded(partial(self._take_rows, *of_topic), message)
            elif last == "channels" and not has_channels:
                has_channels = True
                self._guarded(self._take_channels, message)
            elif last == "parameter_events":
                self._take_memory(_EVENT_BYTES + _EVENT_RATIO * len(message.message))
                self._guarded(self._take_event, message)
        self._take_scan(scan)

    def finish(self) -> RawRecording:
        """Return the loaded run; RecordingError if it has no samples."""
        raw, names = self.raw, self.samples.names
        if self._n_left_out > MOST_NOTES:
            raw.notes.append(f"{self._n_left_out - MOST_NOTES} more messages are left out")
        if not self._content:
            raise RecordingError(no_samples_message(raw, self._topics))
        raw.names = names
        raw.rows = _rows(self.samples, self._content)
        raw.others = tuple(
            OtherSamples(topic, samples.names, _rows(samples, content))
            for topic, (samples, content) in self._others.items()
            if content
        )
        raw.notes += [
            f"{listed(other.names)} of {other.topic} have a rate of their own: {len(other.rows)} "
            "readings, put beside the samples of their time where the run is read"
            for other in raw.others
        ]
        raw.changes = tuple(self.changes)
        counts = [count for count in self._counts if count is not None]
        raw.counted = sum(counts) if len(counts) == len(self._counts) else None
        raw.notes += content_notes(raw)
        return raw

    def _take_rows(self, samples: _Samples, content: bytearray, scanned: ScannedMessage) -> None:
        """Append the samples (n, c) of a message to the buffer of its topic."""
        rows = samples.decode(scanned)[1]
        n, c = rows.shape
        self._take_memory(n * (c + _COLUMNS_AT_WORK) * rows.itemsize)
        content += np.ascontiguousarray(rows).data.cast("B") if n else b""

    def _take_memory(self, size: int) -> None:
        """Subtract bytes from what is left of the memory limit; RecordingError below zero."""
        self._left -= size
        if self._left < 0:
            raise RecordingError(
                f"{self.raw.path} unpacks to more than {self._most_bytes >> 20} MiB, many times "
                "its size on the disk, as a file made to fill the memory does: it is not read; "
                "of a run of several files name one, RUN/RUN_0.mcap, and in Python give "
                "read_recording(path, most_bytes=...) more where it is known to be good"
            )

    def _guarded(self, take: Callable[[ScannedMessage], None], scanned: ScannedMessage) -> None:
        """Pass a message to ``take``; if it can't be decoded, leave it out and note that."""
        try:
            take(scanned)
        except RecordingError as error:
            self._n_left_out += 1
            if self._n_left_out <= MOST_NOTES:
                self.raw.notes.append(
                    f"a message of {listed([scanned.topic.name])} is left out: {error}"
                )

    def _take_channels(self, scanned: ScannedMessage) -> None:
        """Store the first ``channels`` message of a run: it has the state at the first sample."""
        if not self.raw.channels.content:
            self.raw.channels, notes = read_channels(decode_string(scanned.message))
            self.raw.notes += notes

    def _take_event(self, scanned: ScannedMessage) -> None:
        """Append a parameter change."""
        event = decode_parameter_event(scanned.message)
        change = ParameterChange(event.stamp_ns / 1e9, event.stamp_ns, event.node, event.changed)
        self.changes.append(change)

    def _take_scan(self, scan: Scan) -> None:
        """Add notes, completeness, size, topics and sample count of a file read to its end."""
        raw = self.raw
        raw.notes += scan.notes + scan.end_notes()
        raw.complete &= scan.complete
        raw.bytes_on_disk += scan.size
        self._topics |= {topic.name for topic in scan.topics.values() if is_samples(topic)}
        record = dict(scan.metadata).get(RECORD_NAME, {})
        raw.recovered |= "recovered" in record
        count = record.get("samples_written", "")
        self._counts.append(int(count) if _COUNT.fullmatch(count) else None)


def _rows(samples: _Samples, content: bytearray) -> Array:
    """Return the rows (n, c) in a buffer."""
    return np.frombuffer(content, dtype=np.float64).reshape(-1, len(samples.names))


def load(path: Path | str, most_bytes: int | None = None) -> RawRecording:
    """Load a whole run into memory without checking its times; errors as ``read_recording``.

    Args:
        path: run folder or .mcap file.
        most_bytes: memory limit [bytes]; None: as ``read_recording``.
    """
    path = Path(path)
    files = bag_files(path)
    if most_bytes is None:
        on_disk = sum(file.stat().st_size for file in files)
        most_bytes = max(LEAST_MEMORY, MEMORY_RATIO * on_disk)
    loading = _Loading(path, most_bytes)
    information = readable_bag(path)
    loading.raw.notes += information.notes
    for file in files:
        loading.take_file(file)
    if path.is_dir():
        _compare(loading, information)
    return loading.finish()


def _compare(loading: _Loading, information: BagInformation) -> None:
    """Note where the files of a run folder differ from its ``metadata.yaml``."""
    raw = loading.raw
    raw.notes += information.file_notes
    raw.missing_files = information.missing
    raw.complete &= not information.missing
    if information.n_messages not in (None, loading.n_messages) and raw.complete:
        raw.notes.append(
            f"{METADATA_NAME} counts {shown(information.n_messages)} messages, "
            f"{loading.n_messages} were read"
        )
