"""Load the files of a run into memory: of any program, finished or cut, times unchecked."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from herringbone_sim.errors import RecordingError, listed, shown
from herringbone_sim.recording.bag import METADATA_NAME, Topic
from herringbone_sim.recording.cdr import Array
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
from herringbone_sim.recording.raw import (
    ParameterChange,
    RawRecording,
    content_notes,
    without_samples,
)
from herringbone_sim.recording.run_files import RECORD_NAME
from herringbone_sim.recording.scan import MOST_NOTES, Found, Scan

# Memory for a run of little size on the disk; it is that of a chunk of the largest kind.
LEAST_MEMORY = 256 << 20
# Bytes in memory for each on the disk: periodic motions of a gear with many planets pack so well.
MEMORY_RATIO = 40
# Columns beside those of the samples that are at work while a run is read: times, steps, gaps.
_COLUMNS_AT_WORK = 8
# With more digits it is no count of samples.
_COUNT = re.compile("[0-9]{1,15}")
# An event in memory: the object itself, and how much larger its values are than on the disk.
_EVENT_BYTES, _EVENT_RATIO = 512, 8


def is_samples(topic: Topic) -> bool:
    """Whether this is the ``samples`` topic of any node."""
    last, kind = (text.rpartition("/")[2] for text in (topic.name, topic.type_name))
    return (last, kind) == ("samples", "Float64MultiArray")


def iter_sample_blocks(path: Path | str) -> Iterator[tuple[tuple[str, ...], Array]]:
    """Channel names (c,) and rows (n, c), one message at a time, in the order of the file.

    Raises:
        RecordingError: see ``read_recording``; time is not checked.
    """
    blocks = _Samples(Path(path))
    for file in bag_files(path):
        for found in Scan(file).messages():
            if is_samples(found.topic):
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
                f"a run must hold the samples of one node, {self.path} has "
                f"{listed([self.topic])} and {listed([found.topic.name])}: record each into a "
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
        odd = not all(name.isprintable() for name in self.names)
        if "t" not in self.names or odd or len(set(self.names)) < len(self.names):
            raise RecordingError(
                f"the samples of {self.path} must have a channel t and no name twice, got "
                f"{listed(self.names if not odd else [shown(name) for name in self.names])}: "
                "mend the label of the layout's second dimension"
            )


class _Loading:
    """Takes the messages of one file after the other, into no more memory than is allowed."""

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
        # Rows one behind the other: they grow in place, and hold no chunk in memory.
        self._content = bytearray()

    def take_file(self, file: Path) -> None:
        scan = Scan(file)
        told = False
        for found in scan.messages():
            self.n_messages += 1
            last = found.topic.name.rpartition("/")[2]
            if is_samples(found.topic):
                self._take_rows(self.samples.decode(found)[1])
            elif last == "channels" and not told:
                told = True
                self._guarded(self._take_channels, found)
            elif last == "parameter_events":
                self._take_memory(_EVENT_BYTES + _EVENT_RATIO * len(found.message))
                self._guarded(self._take_event, found)
        self._take_scan(scan)

    def finish(self) -> RawRecording:
        raw, names = self.raw, self.samples.names
        if self._n_left_out > MOST_NOTES:
            raw.notes.append(f"{self._n_left_out - MOST_NOTES} more messages are left out")
        if not self._content:
            raise RecordingError(without_samples(raw, self._topics))
        raw.names = names
        raw.rows = np.frombuffer(self._content, dtype=np.float64).reshape(-1, len(names))
        raw.changes = tuple(self.changes)
        counts = [count for count in self._counts if count is not None]
        raw.counted = sum(counts) if len(counts) == len(self._counts) else None
        raw.notes += content_notes(raw)
        return raw

    def _take_rows(self, rows: Array) -> None:
        n, c = rows.shape
        self._take_memory(n * (c + _COLUMNS_AT_WORK) * rows.itemsize)
        self._content += np.ascontiguousarray(rows).data.cast("B") if n else b""

    def _take_memory(self, size: int) -> None:
        self._left -= size
        if self._left < 0:
            raise RecordingError(
                f"{self.raw.path} unpacks to more than {self._most_bytes >> 20} MiB, many times "
                "its size on the disk, as a file made to fill the memory does: it is not read; "
                "of a run of several files name one, RUN/RUN_0.mcap, and in Python give "
                "read_recording(path, most_bytes=...) more where it is known to be good"
            )

    def _guarded(self, take: Callable[[Found], None], found: Found) -> None:
        try:
            take(found)
        except RecordingError as error:
            self._n_left_out += 1
            if self._n_left_out <= MOST_NOTES:
                self.raw.notes.append(
                    f"a message of {listed([found.topic.name])} is left out: {error}"
                )

    def _take_channels(self, found: Found) -> None:
        """The first of a run counts: its state is that at the first sample."""
        if not self.raw.channels.content:
            self.raw.channels, notes = read_channels(decode_string(found.message))
            self.raw.notes += notes

    def _take_event(self, found: Found) -> None:
        event = decode_parameter_event(found.message)
        change = ParameterChange(event.stamp_ns / 1e9, event.stamp_ns, event.node, event.changed)
        self.changes.append(change)

    def _take_scan(self, scan: Scan) -> None:
        raw = self.raw
        raw.notes += scan.notes + scan.end_notes()
        raw.complete &= scan.complete
        raw.bytes_on_disk += scan.size
        self._topics |= {topic.name for topic in scan.topics.values() if is_samples(topic)}
        told = dict(scan.metadata).get(RECORD_NAME, {})
        raw.recovered |= "recovered" in told
        count = told.get("samples_written", "")
        self._counts.append(int(count) if _COUNT.fullmatch(count) else None)


def load(path: Path | str, most_bytes: int | None = None) -> RawRecording:
    """All of a run in memory, without a check of its times; as ``read_recording``."""
    path = Path(path)
    files = bag_files(path)
    if most_bytes is None:
        on_disk = sum(file.stat().st_size for file in files)
        most_bytes = max(LEAST_MEMORY, MEMORY_RATIO * on_disk)
    loading = _Loading(path, most_bytes)
    information = readable_bag(path if path.is_dir() else path.parent)
    loading.raw.notes += information.notes
    for file in files:
        loading.take_file(file)
    if path.is_dir():
        _compare(loading, information)
    return loading.finish()


def _compare(loading: _Loading, told: BagInformation) -> None:
    """Hold the files of a run folder against what ``metadata.yaml`` says of them."""
    raw = loading.raw
    raw.notes += told.file_notes
    raw.missing_files = told.missing
    raw.complete &= not told.missing
    if told.n_messages not in (None, loading.n_messages) and raw.complete:
        raw.notes.append(
            f"{METADATA_NAME} counts {shown(told.n_messages)} messages, {loading.n_messages} were "
            "read"
        )
