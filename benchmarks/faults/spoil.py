"""Ways to spoil the bytes of an MCAP file: chance, its own fields, and bombs."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from functools import lru_cache

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

ODD = (0, 1, 255, 2**16, 2**31, 2**32 - 1, 2**32, 2**53, 2**63 - 1, 2**63, 2**64 - 1)
# Unpacked; above and below what a reader takes at once.
BOMB_BYTES = (300 << 20, 200 << 20)
_HEAD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")

Rng = np.random.Generator
Spoil = Callable[[bytes, Rng], bytes]


def record_starts(content: bytes) -> list[tuple[int, int, int]]:
    """Start, opcode and length of the records of a whole file."""
    at, found = len(MCAP0_MAGIC), []
    while at + _HEAD.size <= len(content) - len(MCAP0_MAGIC):
        opcode, length = _HEAD.unpack_from(content, at)
        found.append((at, opcode, length))
        at += _HEAD.size + length
    return found


def _put(content: bytes, at: int, new: bytes) -> bytes:
    return content[:at] + new + content[at + len(new) :]


def _odd(rng: Rng, size: int) -> bytes:
    value = ODD[rng.integers(len(ODD))] if rng.random() < 0.7 else int(rng.integers(2**62))
    return (value % 256**size).to_bytes(size, "little")


def _one(content: bytes, rng: Rng, *opcodes: int) -> tuple[int, int, int]:
    every = [one for one in record_starts(content) if not opcodes or one[1] in opcodes]
    return every[rng.integers(len(every))]


def flip_bits(content: bytes, rng: Rng) -> bytes:
    spoilt = bytearray(content)
    for at in rng.integers(len(content), size=rng.integers(1, 20)):
        spoilt[at] ^= 1 << int(rng.integers(8))
    return bytes(spoilt)


def truncate(content: bytes, rng: Rng) -> bytes:
    return content[: rng.integers(len(content))]


def cut_out(content: bytes, rng: Rng) -> bytes:
    start, end = sorted(rng.integers(len(content), size=2))
    return content[:start] + content[end:]


def repeat(content: bytes, rng: Rng) -> bytes:
    start, end = sorted(rng.integers(len(content), size=2))
    return content[:end] + content[start:]


def blank(content: bytes, rng: Rng) -> bytes:
    start = int(rng.integers(len(content)))
    length = min(int(rng.integers(1, 5000)), len(content) - start)
    return _put(content, start, bytes([0, 255][rng.integers(2)] for _ in range(1)) * length)


def record_length(content: bytes, rng: Rng) -> bytes:
    return _put(content, _one(content, rng)[0] + 1, _odd(rng, 8))


def opcode(content: bytes, rng: Rng) -> bytes:
    return _put(content, _one(content, rng)[0], bytes([rng.integers(256)]))


def fields(content: bytes, rng: Rng) -> bytes:
    """An odd number anywhere in a record other than a chunk."""
    others = [code for code in Opcode if code != Opcode.CHUNK]
    at, _, length = _one(content, rng, *others)
    size = int(rng.choice([1, 2, 4, 8]))
    place = at + _HEAD.size + int(rng.integers(max(1, length - size)))
    return _put(content, place, _odd(rng, size))


def chunk_header(content: bytes, rng: Rng) -> bytes:
    at = _one(content, rng, Opcode.CHUNK, Opcode.MESSAGE)[0] + _HEAD.size
    place, size = [(0, 8), (8, 8), (16, 8), (24, 4), (28, 4), (32, 1), (36, 8)][rng.integers(7)]
    return _put(content, at + place, _odd(rng, size))


def footer(content: bytes, rng: Rng) -> bytes:
    at = len(content) - len(MCAP0_MAGIC) - 20
    return _put(content, at + int(rng.choice([0, 8])), _odd(rng, 8))


def _chunk(size: int, crc: int, compression: str, packed: bytes) -> bytes:
    name = compression.encode()
    body = _CHUNK.pack(0, 0, size, crc, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    return _HEAD.pack(Opcode.CHUNK, len(body)) + body


@lru_cache
def _bomb(size: int, compression: str, small: bool) -> tuple[int, bytes]:
    """Checksum and packed bytes of so many bytes of messages: one large, or of 31 bytes each."""
    length = 22 if small else size - _HEAD.size
    head = _HEAD.pack(Opcode.MESSAGE, length) + struct.pack("<HIQQ", 2, 0, 0, 0)
    content = head * (size // len(head)) if small else head + bytes(size - len(head))
    pack = lz4.frame.compress if compression == "lz4" else zstandard.ZstdCompressor(1).compress
    return zlib.crc32(content), pack(content)


def bomb(content: bytes, rng: Rng) -> bytes:
    """Chunks that unpack to far more than they take, honest or not, before the first record."""
    size, small = int(rng.choice(BOMB_BYTES)), bool(rng.integers(2))
    compression = ["lz4", "zstd"][rng.integers(2)]
    crc, packed = _bomb(size, compression, small)
    told = [size, 4096, size // 2, 2**40, 2**64 - 1, 200 << 20][rng.integers(6)]
    one = _chunk(told, [crc, 0][rng.integers(2)], compression, packed)
    times = int(min(rng.choice([1, 2, 40]), (19 << 20) // len(one))) or 1
    at = record_starts(content)[1][0]
    return content[:at] + one * times + content[at:]


def nested(content: bytes, rng: Rng) -> bytes:
    """A chunk within a chunk within a chunk."""
    inner = b""
    for _ in range(int(rng.integers(2, 1500))):
        inner = _chunk(len(inner), 0, "", inner)
    at = record_starts(content)[1][0]
    return content[:at] + inner + content[at:]


def crumbs(content: bytes, rng: Rng) -> bytes:
    """Records without content by the thousand."""
    code = int(rng.choice([Opcode.MESSAGE, Opcode.METADATA, Opcode.CHUNK, Opcode.SCHEMA, 77]))
    at = record_starts(content)[1][0]
    return content[:at] + _HEAD.pack(code, 0) * 20_000 + content[at:]


SPOILS: tuple[Spoil, ...] = (
    *(flip_bits, truncate, cut_out, repeat, blank, record_length, opcode, fields, chunk_header),
    *(footer, bomb, nested, crumbs),
)
