"""Unpack a chunk of an MCAP file, into no more memory than it declares and is allowed."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode

from herringbone_sim.errors import shown

RECORD = struct.Struct("<BQ")
# What is unpacked at once of a chunk: programs make chunks of 1 to 16 MiB.
MOST_BYTES = 256 << 20
# The rows of a gear at rest differ by time and phase alone, so 120 channels pack 60 to 1.
MOST_RATIO = 128
# Sequence, two times and content differ from message to message, so none packs below this.
LEAST_PACKED_BYTES = 4
# Schemas and channels that stand in one chunk, whatever it packs to.
FEW_RECORDS = 4096

_CHUNK = struct.Struct("<QQQII")
_HELD = frozenset(map(int, (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)))
# lz4 packs 255 to 1 at best, so what a slice unpacks to stays small beside MOST_BYTES.
_SLICE = 1 << 16


class UnknownCompressionError(ValueError):
    """A chunk in a compression that is neither lz4 nor zstd."""


@dataclass
class Room:
    """Bytes that may still be unpacked of a file.

    Attributes:
        chunk: most of one chunk.
        left: of all that are to come.
    """

    chunk: int
    left: int

    def check(self, size: int) -> None:
        """ValueError where a chunk declares more than it may hold."""
        most = min(self.chunk, self.left)
        if size > most:
            raise ValueError(f"it declares {size} bytes unpacked, at most {most} are taken")


def records(body: memoryview, room: Room) -> Iterator[tuple[int, memoryview]]:
    """Opcode and content of the records of a chunk; takes what it unpacks off the room.

    Raises:
        ValueError, struct.error, RuntimeError, zstandard.ZstdError: the chunk is damaged, larger
            than there is room, or says something else of itself than what it holds.
        UnknownCompressionError: nobody can unpack it.
    """
    _, _, size, crc, name_length = _CHUNK.unpack_from(body)
    start = _CHUNK.size + name_length
    compression = str(body[_CHUNK.size : start], "utf-8")
    (length,) = struct.unpack_from("<Q", body, start)
    packed = body[start + 8 : start + 8 + length]
    if len(packed) != length:
        raise ValueError("it is shorter than it says")
    room.check(size)
    content, found = _unpacked(packed, compression, size)
    room.left -= found
    if found != size:
        raise ValueError(f"it does not unpack to the {size} bytes that it declares")
    if crc and zlib.crc32(content) != crc:
        raise ValueError("its checksum disagrees")
    return _split(content, FEW_RECORDS + length // LEAST_PACKED_BYTES)


def _unpacked(packed: memoryview, compression: str, size: int) -> tuple[memoryview, int]:
    """Content, and bytes found: more than ``size`` where there are more to come."""
    if compression == "":
        return packed, len(packed)
    if compression not in _UNPACK:
        raise UnknownCompressionError(
            "chunks may be compressed with lz4, zstd or not at all, got "
            f"{shown(compression)}: convert the file with 'mcap compress'"
        )
    # Memory that nothing is written to costs nothing, so a chunk may declare too much.
    content = np.empty(size, np.uint8).data
    return content, _UNPACK[compression](packed, content)


def _zstd(packed: memoryview, content: memoryview) -> int:
    found = 0
    with zstandard.ZstdDecompressor().stream_reader(BytesIO(packed)) as reader:
        while found < len(content) and (n := reader.readinto(content[found:])):
            found += n
        return found + len(reader.read(1))


def _lz4(packed: memoryview, content: memoryview) -> int:
    found, unpack = 0, lz4.frame.LZ4FrameDecompressor()
    for at in range(0, len(packed), _SLICE):
        piece = unpack.decompress(packed[at : at + _SLICE], len(content) - found + 1)
        if found + len(piece) > len(content):
            return found + len(piece)
        content[found : found + len(piece)] = piece
        found += len(piece)
        if unpack.eof:
            break
    return found


_UNPACK = {"lz4": _lz4, "zstd": _zstd}


def _split(content: memoryview, most: int) -> Iterator[tuple[int, memoryview]]:
    at, n = 0, 0
    while at < len(content):
        opcode, length = RECORD.unpack_from(content, at)
        at, n = at + RECORD.size, n + 1
        if at + length > len(content):
            raise ValueError("a record in it is longer than the chunk")
        if opcode not in _HELD or n > most:
            raise ValueError(f"record {n} in it, with opcode {opcode}, belongs into no chunk")
        yield opcode, content[at : at + length]
        at += length
