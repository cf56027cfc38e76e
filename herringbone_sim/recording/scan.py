"""Read an MCAP file of any origin, finished or cut, from front to back.

The readers of ``mcap`` stop at the first invalid byte; this one skips damaged chunks and notes it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from herringbone_sim.errors import RecordingError, shown
from herringbone_sim.recording.bag import Topic
from herringbone_sim.recording.chunk import (
    MOST_BYTES,
    MOST_RATIO,
    RECORD,
    UnknownCompressionError,
    UnpackBudget,
    checksum,
    records,
)
from herringbone_sim.recording.files import check_file

# Far more topics than a robot has; rosbag2 describes each in metadata.yaml.
MOST_TOPICS = 4096
# Bytes of all schemas and channels together; a large message definition has some 50 kB.
MOST_DEFINED_BYTES = 64 << 20
# Damaged records of a file that are noted one by one.
MOST_NOTES = 10

_MESSAGE = struct.Struct("<HIQQ")
_FOOTER = struct.Struct("<QQI")
_TAIL = RECORD.size + _FOOTER.size + len(MCAP0_MAGIC)
_BEHIND_CRC = len(MCAP0_MAGIC) + 4
# Plain integers, as comparing with an Enum is slow for millions of records.
_CHUNK_CODE, _MESSAGE_CODE = int(Opcode.CHUNK), int(Opcode.MESSAGE)
_ENDS = frozenset(map(int, (Opcode.DATA_END, Opcode.FOOTER)))
_OF_SUMMARY = frozenset(map(int, (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS)))
_TAKEN = frozenset(
    map(int, (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA))
)
_DAMAGE = (zstandard.ZstdError, EndOfFile, RuntimeError, ValueError, struct.error, MemoryError)


class ScannedMessage(NamedTuple):
    """A serialised message in an MCAP file, with its topic, log time and publish time [ns]."""

    topic: Topic
    log_ns: int
    publish_ns: int
    message: memoryview


class Scan:
    """One pass over a file; the attributes are final when ``messages`` is exhausted.

    Args:
        path: the file.
        most_bytes: largest size [bytes] of a decompressed chunk, and of any record.

    Attributes:
        topics: channel number -> topic, as far as read.
        metadata: metadata records (name, content), in order.
        complete: whether the file was finished and its index is intact.
        size: size of the file [bytes].
        intact_bytes: bytes up to the end of the last complete record; ``size`` if it was finished.
        damaged: number of damaged or too long records, mainly chunks, which are left out.
        skipped: number of attachments, and of messages of an undefined channel.
    """

    def __init__(self, path: Path, most_bytes: int = MOST_BYTES) -> None:
        self.path = path
        self.topics: dict[int, Topic] = {}
        self.metadata: list[tuple[str, dict[str, str]]] = []
        self.complete = False
        self.size = 0
        self.intact_bytes = 0
        self.damaged = 0
        self.skipped = 0
        self._budget = UnpackBudget(most_bytes, most_bytes)
        self._schemas: dict[int, Schema] = {}
        self._defined: dict[tuple[int, int], bytes] = {}
        self._defined_bytes = 0
        self._notes: list[str] = []
        self._index_damaged = False
        self._unknown: UnknownCompressionError | None = None
        self._ended = False
        self._n_messages = 0
        self._counted: int | None = None

    def messages(self) -> Iterator[ScannedMessage]:
        """Yield every intact message, in the order of the file.

        Raises:
            RecordingError: the file can't be opened or is no MCAP file, its only messages have an
                unsupported compression, or it has too many topics.
        """
        with self._open() as stream:
            self._check_magic(stream)
            self._read_summary(stream)
            self._ended = False
            for opcode, body in self._records(stream, _TAKEN):
                yield from self._intact(opcode, body)
        if self._unknown and not self._n_messages:
            raise RecordingError(f"{self.path}: {self._unknown}") from self._unknown
        if self._ended:
            self.intact_bytes = self.size
        self.complete &= self._ended

    def _open(self) -> BinaryIO:
        """Open the file; RecordingError for a pipe or a device, as reading could block."""
        check_file(self.path)
        try:
            self.size = self.path.stat().st_size
            self._budget.remaining = max(self._budget.per_chunk, MOST_RATIO * self.size)
            return self.path.open("rb")
        except OSError as error:
            raise RecordingError(
                f"can't open {self.path} ({error.strerror}): name a run folder or a .mcap file"
            ) from error

    def _check_magic(self, stream: BinaryIO) -> None:
        """Raise RecordingError unless the file starts as MCAP does."""
        start = stream.read(len(MCAP0_MAGIC))
        if start != MCAP0_MAGIC:
            raise RecordingError(
                f"{self.path} is not an MCAP file: it must start with {MCAP0_MAGIC!r}, got "
                f"{start!r}: name another file"
            )
        self.intact_bytes = stream.tell()

    def _read_summary(self, stream: BinaryIO) -> None:
        """Read the topics in the summary of a finished file, as those in chunks may be damaged.

        Sets ``complete`` if footer and checksum are intact.
        """
        start = stream.tell()
        at = max(self.size - _TAIL, start)
        stream.seek(at)
        tail = stream.read()
        if tail[:1] == bytes([Opcode.FOOTER]) and tail.endswith(MCAP0_MAGIC):
            summary, _, crc = _FOOTER.unpack_from(tail, RECORD.size)
            self.complete = summary == 0 or start <= summary <= at
            if summary and self.complete and crc:
                self.complete = checksum(stream, summary, self.size - _BEHIND_CRC) == crc
            if summary and self.complete:
                stream.seek(summary)
                for opcode, body in self._records(stream, _OF_SUMMARY):
                    list(self._intact(opcode, body))
            self._index_damaged = not self.complete
        stream.seek(start)
        self.intact_bytes = start
        self._defined.clear()

    def _records(
        self, stream: BinaryIO, taken: frozenset[int]
    ) -> Iterator[tuple[int, memoryview]]:
        """Yield (opcode, content) of ``taken`` records until the section or the data end."""
        at, most = stream.tell(), self._budget.per_chunk
        while len(head := stream.read(RECORD.size)) == RECORD.size:
            opcode, length = RECORD.unpack(head)
            at += RECORD.size + length
            if opcode == 0 or at > self.size:
                return
            self.intact_bytes = at
            if opcode in _ENDS:
                self._ended = True
                return
            if opcode in taken and length <= most:
                body = memoryview(stream.read(length))
                if len(body) < length:
                    return
                yield opcode, body
                continue
            if opcode in taken:
                self._leave_out(length, f"too long (at most {most} bytes are read at once)")
            self.skipped += opcode == Opcode.ATTACHMENT
            if length:
                stream.seek(at)

    def _intact(self, opcode: int, body: memoryview) -> Iterator[ScannedMessage]:
        """Yield the messages of a record, and store any other content; damage is only noted."""
        try:
            inside = records(body, self._budget) if opcode == _CHUNK_CODE else ((opcode, body),)
            for inner, record in inside:
                if inner == _MESSAGE_CODE:
                    yield from self._message(record)
                else:
                    self._note_record(inner, record)
        except _DAMAGE as error:
            if isinstance(error, UnknownCompressionError):
                self._unknown = error
            self._leave_out(len(body), f"damaged ({str(error) or type(error).__name__})")

    def _leave_out(self, length: int, fault: str) -> None:
        """Count the record that ends at ``intact_bytes`` as damaged, and note the first few.

        Args:
            length: of the record in bytes.
            fault: completes "a record ... is <fault> and left out"; ``MOST_NOTES`` are kept.
        """
        self.damaged += 1
        if self.damaged <= MOST_NOTES:
            self._notes.append(
                f"a record of {length} bytes that ends at byte {self.intact_bytes} is {fault} "
                "and left out"
            )

    def _message(self, body: memoryview) -> tuple[ScannedMessage] | tuple[()]:
        """Return (message,) of a record; () if its channel was not read before it: one skipped."""
        channel, _, log_ns, publish_ns = _MESSAGE.unpack_from(body)
        self._n_messages += 1
        topic = self.topics.get(channel)
        if topic is None:
            self.skipped += 1
            return ()
        return (ScannedMessage(topic, log_ns, publish_ns, body[_MESSAGE.size :]),)

    def _note_record(self, opcode: int, body: memoryview) -> None:
        """Store the content of a metadata, statistics, schema or channel record."""
        if opcode == Opcode.METADATA:
            record = Metadata.read(_fields(body))
            self.metadata.append((record.name, record.metadata))
        elif opcode == Opcode.STATISTICS:
            (self._counted,) = struct.unpack_from("<Q", body)
        else:
            self._define(opcode, body)

    def _define(self, opcode: int, body: memoryview) -> None:
        """Register a schema or a channel, which files repeat, for instance before each chunk."""
        key, content = (opcode, int.from_bytes(body[:2], "little")), bytes(body)
        if self._defined.get(key) == content:
            return
        self._defined_bytes += len(body)
        new = opcode == Opcode.CHANNEL and key[1] not in self.topics
        if len(self.topics) + new > MOST_TOPICS or self._defined_bytes > MOST_DEFINED_BYTES:
            raise RecordingError(
                f"a recording may have {MOST_TOPICS} topics and {MOST_DEFINED_BYTES >> 20} MiB of "
                f"definitions, {self.path} has more: choose the topics that are recorded"
            )
        self._defined[key] = content
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(_fields(body))
            self._schemas[schema.id] = schema
        else:
            channel = Channel.read(_fields(body))
            if not channel.topic.isprintable():
                raise ValueError(f"no topic has the name {shown(channel.topic)}")
            schema = self._schemas.get(channel.schema_id, Schema(0, b"", "", ""))
            self.topics[channel.id] = Topic(
                channel.topic,
                schema.name,
                schema.data,
                schema.encoding,
                channel.message_encoding,
                channel.metadata,
            )

    @property
    def notes(self) -> list[str]:
        """A sentence on each irregularity, except on the end of the file, see ``end_notes``."""
        more = self.damaged - MOST_NOTES
        notes = self._notes + ([f"{more} more records are left out"] * (more > 0))
        if self._counted is not None and self._counted != self._n_messages:
            notes.append(
                f"{self.path.name} says that it holds {self._counted} messages, "
                f"{self._n_messages} of them were found"
            )
        return notes

    def end_notes(self) -> list[str]:
        """Return a sentence on a missing end or a damaged index; an empty list if intact."""
        if self.complete:
            return []
        if self._index_damaged:
            return [
                f"the index of {self.path.name} is damaged and not used; 'python -m "
                "herringbone_sim recover' rebuilds it"
            ]
        tail = self.size - self.intact_bytes
        left_out = f"its last {tail} of {self.size} bytes are no whole record and left out; "
        return [
            f"the file {self.path.name} was not finished: {left_out if tail else ''}'python -m "
            "herringbone_sim recover' rebuilds its index"
        ]


def _fields(body: memoryview) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))
