"""Decompress and check the chunks of an MCAP file within limits on memory."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import BinaryIO

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode

from herringbone_sim.errors import shown

RECORD = struct.Struct("<BQ")
# Largest chunk that is decompressed; usual ones have 1 to 16 MiB.
MOST_BYTES = 256 << 20
# Largest compression ratio accepted. Samples of a gear at rest with 120 channels reach 60.
MOST_RATIO = 128
# Fewest compressed bytes per record: sequence, times and content differ between messages.
LEAST_PACKED_BYTES = 4
# Records accepted in a chunk of any size: schemas and channels.
FEW_RECORDS = 4096

_CHUNK = struct.Struct("<QQQII")
_HELD = frozenset(map(int, (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)))
# Slice that is decompressed at once: at lz4's best ratio of 255 it stays far below MOST_BYTES.
_SLICE = 1 << 16


class UnknownCompressionError(ValueError):
    """A chunk with a compression other than lz4 and zstd."""


@dataclass
class UnpackBudget:
    """Limits on the decompressed size of the chunks of a file [bytes].

    Attributes:
        per_chunk: limit for one chunk.
        remaining: limit for all chunks not read yet.
    """

    per_chunk: int
    remaining: int

    def check(self, size: int) -> None:
        """Raise ValueError if the declared size of a chunk [bytes] exceeds a limit."""
        most = min(self.per_chunk, self.remaining)
        if size > most:
            raise ValueError(f"it declares {size} bytes unpacked, at most {most} are taken")


def records(body: memoryview, budget: UnpackBudget) -> Iterator[tuple[int, memoryview]]:
    """Decompress and check a chunk; return an iterator over (opcode, content) of its records.

    Args:
        body: content of the chunk record.
        budget: limits, from which the decompressed size is subtracted.

    Raises:
        ValueError, struct.error, RuntimeError, zstandard.ZstdError: the chunk is damaged, exceeds
            the budget, or contradicts its own header.
        UnknownCompressionError: unsupported compression.
    """
    _, _, size, crc, name_length = _CHUNK.unpack_from(body)
    start = _CHUNK.size + name_length
    compression = str(body[_CHUNK.size : start], "utf-8")
    (length,) = struct.unpack_from("<Q", body, start)
    packed = body[start + 8 : start + 8 + length]
    if len(packed) != length:
        raise ValueError("it is shorter than it says")
    budget.check(size)
    content, unpacked_size = _unpacked(packed, compression, size)
    budget.remaining -= unpacked_size
    if unpacked_size != size:
        raise ValueError(f"it does not unpack to the {size} bytes that it declares")
    if crc and zlib.crc32(content) != crc:
        raise ValueError("its checksum disagrees")
    return _split(content, FEW_RECORDS + length // LEAST_PACKED_BYTES)


def _unpacked(packed: memoryview, compression: str, size: int) -> tuple[memoryview, int]:
    """Return the decompressed content and its length, more than ``size`` if it is too long."""
    if compression == "":
        return packed, len(packed)
    if compression not in _UNPACK:
        raise UnknownCompressionError(
            "chunks may be compressed with lz4, zstd or not at all, got "
            f"{shown(compression)}: convert the file with 'mcap compress'"
        )
    # Untouched pages of np.empty take no memory, so a declared size that is too large is harmless.
    content = np.empty(size, np.uint8).data
    return content, _UNPACK[compression](packed, content)


def _zstd(packed: memoryview, content: memoryview) -> int:
    """Decompress zstd into ``content``; return its length, ``len(content) + 1`` if too long."""
    length = 0
    with zstandard.ZstdDecompressor().stream_reader(BytesIO(packed)) as reader:
        while length < len(content) and (n := reader.readinto(content[length:])):
            length += n
        return length + len(reader.read(1))


def _lz4(packed: memoryview, content: memoryview) -> int:
    """Decompress lz4 into ``content``; return its length, ``len(content) + 1`` if too long."""
    length, unpack = 0, lz4.frame.LZ4FrameDecompressor()
    for at in range(0, len(packed), _SLICE):
        piece = unpack.decompress(packed[at : at + _SLICE], len(content) - length + 1)
        if length + len(piece) > len(content):
            return length + len(piece)
        content[length : length + len(piece)] = piece
        length += len(piece)
        if unpack.eof:
            break
    return length


_UNPACK = {"lz4": _lz4, "zstd": _zstd}


def _split(content: memoryview, most: int) -> Iterator[tuple[int, memoryview]]:
    """Yield opcode and content of each record; ValueError if one is invalid, or over ``most``."""
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


def checksum(stream: BinaryIO, start: int, end: int) -> int:
    """Return the CRC-32 of the bytes ``start:end`` of a file."""
    stream.seek(start)
    crc, left = 0, end - start
    while left > 0 and (piece := stream.read(min(left, 1 << 20))):
        crc, left = zlib.crc32(piece, crc), left - len(piece)
    return crc
