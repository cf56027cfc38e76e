"""Walk through an MCAP file of any origin, finished or cut, from front to back.

``mcap``'s own readers give up at the first odd byte. This one takes every whole record in front
of the end of the file, leaves out a chunk whose content is damaged, and says so.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.bag import Topic

_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")
_MESSAGE = struct.Struct("<HIQQ")
_TAIL = _RECORD.size + 20 + len(MCAP0_MAGIC)
_DAMAGE = (zstandard.ZstdError, EndOfFile, RuntimeError, ValueError, struct.error, MemoryError)


@dataclass(frozen=True)
class Found:
    """A message as it lies in the file; times in ns."""

    topic: Topic
    log_ns: int
    publish_ns: int
    message: memoryview


class Scan:
    """One pass over a file; the attributes are final when ``messages`` is exhausted.

    Attributes:
        topics: channels met so far, by number.
        metadata: metadata records, name and content, in order.
        complete: whether the file was finished.
        size: bytes of the file.
        kept: bytes up to the end of the last whole record.
        damaged: records, chunks above all, left out.
        skipped: attachments, and messages of a channel that was never announced.
        notes: a sentence on everything odd.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[int, Topic] = {}
        self.metadata: list[tuple[str, dict[str, str]]] = []
        self.complete = False
        self.size = 0
        self.kept = 0
        self.damaged = 0
        self.skipped = 0
        self.notes: list[str] = []
        self._schemas: dict[int, Schema] = {}
        self._ended = False

    def messages(self) -> Iterator[Found]:
        """Every message that is whole, in the order of the file.

        Raises:
            RecordingError: no MCAP file, or a compression that nobody knows.
        """
        try:
            self.size = self.path.stat().st_size
            stream = self.path.open("rb")
        except OSError as error:
            raise RecordingError(
                f"can't open {self.path} ({error.strerror}): name a run folder or a .mcap file"
            ) from error
        with stream:
            self._check_magic(stream)
            self._read_summary(stream)
            self._ended = False
            for opcode, body in self._records(stream):
                yield from self._take_whole(opcode, body)
        if self._ended:
            self.kept = self.size
        self.complete &= self._ended

    def _check_magic(self, stream: BinaryIO) -> None:
        start = stream.read(len(MCAP0_MAGIC))
        if start != MCAP0_MAGIC:
            raise RecordingError(
                f"{self.path} is not an MCAP file: it must start with {MCAP0_MAGIC!r}, got "
                f"{start!r}: name another file"
            )
        self.kept = stream.tell()

    def _read_summary(self, stream: BinaryIO) -> None:
        """Take the channels of a finished file from its end: their first copy may be damaged."""
        start = stream.tell()
        stream.seek(max(self.size - _TAIL, start))
        tail = stream.read()
        self.complete = tail[:1] == bytes([Opcode.FOOTER]) and tail.endswith(MCAP0_MAGIC)
        if self.complete and (summary := struct.unpack_from("<Q", tail, _RECORD.size)[0]):
            stream.seek(summary)
            for opcode, body in self._records(stream):
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    list(self._take_whole(opcode, body))
        stream.seek(start)
        self.kept = start

    def _records(self, stream: BinaryIO) -> Iterator[tuple[int, memoryview]]:
        """Records from here to the end of the section, or to the first that is not whole."""
        while len(head := stream.read(_RECORD.size)) == _RECORD.size:
            opcode, length = _RECORD.unpack(head)
            if opcode == 0 or length > self.size - stream.tell():
                return
            body = memoryview(stream.read(length))
            self.kept = stream.tell()
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                self._ended = True
                return
            yield opcode, body

    def _take_whole(self, opcode: int, body: memoryview) -> Iterator[Found]:
        try:
            yield from self._take(opcode, body)
        except _DAMAGE as error:
            self.damaged += 1
            self.notes.append(
                f"a record of {len(body)} bytes that ends at byte {self.kept} is damaged "
                f"({error}) and left out"
            )

    def _take(self, opcode: int, body: memoryview) -> Iterator[Found]:
        if opcode == Opcode.CHUNK:
            for inner, record in list(_split(_content(body))):
                yield from self._take(inner, record)
        elif opcode == Opcode.MESSAGE:
            yield from self._message(body)
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(_fields(body))
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            self._channel(Channel.read(_fields(body)))
        elif opcode == Opcode.METADATA:
            record = Metadata.read(_fields(body))
            self.metadata.append((record.name, record.metadata))
        elif opcode == Opcode.ATTACHMENT:
            self.skipped += 1

    def _message(self, body: memoryview) -> Iterator[Found]:
        channel, _, log_ns, publish_ns = _MESSAGE.unpack_from(body)
        if channel in self.topics:
            yield Found(self.topics[channel], log_ns, publish_ns, body[_MESSAGE.size :])
        else:
            self.skipped += 1

    def _channel(self, channel: Channel) -> None:
        schema = self._schemas.get(channel.schema_id, Schema(0, b"", "", ""))
        self.topics[channel.id] = Topic(
            channel.topic,
            schema.name,
            schema.data,
            schema.encoding,
            channel.message_encoding,
            channel.metadata,
        )

    def end_notes(self) -> list[str]:
        """A sentence on an end that is missing."""
        if self.complete:
            return []
        return [
            f"the file {self.path.name} was not finished: its last {self.size - self.kept} of "
            f"{self.size} bytes are no whole record and left out; 'python -m herringbone_sim "
            "recover' rebuilds its index"
        ]


def _fields(body: memoryview) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))


def _content(body: memoryview) -> memoryview:
    """Records of a chunk, decompressed; ValueError where the checksum disagrees."""
    _, _, size, crc, name_length = _CHUNK.unpack_from(body)
    start = _CHUNK.size + name_length
    compression = str(body[_CHUNK.size : start], "utf-8")
    (length,) = struct.unpack_from("<Q", body, start)
    packed = body[start + 8 : start + 8 + length]
    if compression == "":
        content: bytes | memoryview = packed
    elif compression == "lz4":
        content = lz4.frame.decompress(packed)
    elif compression == "zstd":
        content = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    else:
        raise RecordingError(
            f"chunks may be compressed with lz4, zstd or not at all, got {compression!r}: "
            "convert the file with 'mcap compress'"
        )
    if crc and zlib.crc32(content) != crc:
        raise ValueError("its checksum disagrees")
    return memoryview(content)


def _split(content: memoryview) -> Iterator[tuple[int, memoryview]]:
    at = 0
    while at < len(content):
        opcode, length = _RECORD.unpack_from(content, at)
        at += _RECORD.size
        if at + length > len(content):
            raise ValueError("a record in it is longer than the chunk")
        yield opcode, content[at : at + length]
        at += length
