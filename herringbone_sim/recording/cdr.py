"""CDR, the wire form of ROS 2 messages: fields to bytes and back, without ROS.

Written little endian; either order is read. Alignment counts from the end of the four bytes of
encapsulation.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import wraps
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.errors import RecordingError

Array = NDArray[np.float64]
Buffer = bytes | bytearray | memoryview

T = TypeVar("T")

ENCAPSULATION = b"\x00\x01\x00\x00"
_ORDERS = {0: ">", 1: "<"}


class CdrWriter:
    """Appends fields with their padding."""

    def __init__(self) -> None:
        self.buffer = bytearray(ENCAPSULATION)

    def pack(self, code: str, *values: object) -> None:
        """Values of the struct format ``code``, aligned to its last letter."""
        width = struct.calcsize(f"<{code[-1]}")
        self.buffer += bytes(-(len(self.buffer) - 4) % width)
        self.buffer += struct.pack(f"<{code}", *values)

    def text(self, value: str) -> None:
        raw = value.encode() + b"\0"
        self.pack("I", len(raw))
        self.buffer += raw

    def texts(self, values: Sequence[str]) -> None:
        self.pack("I", len(values))
        for value in values:
            self.text(value)

    def numbers(self, code: str, values: Sequence[float]) -> None:
        self.pack("I", len(values))
        if len(values):
            self.pack(f"{len(values)}{code}", *values)


class CdrReader:
    """Takes fields off a message, in the byte order of its encapsulation."""

    def __init__(self, message: Buffer) -> None:
        self.data = memoryview(message)
        if len(self.data) < 4 or self.data[0] != 0 or self.data[1] not in _ORDERS:
            raise RecordingError(
                "a message must start with the encapsulation 00 00 or 00 01 (plain CDR), got "
                f"{bytes(self.data[:2]).hex(' ') or 'nothing'}: record it with serialization cdr"
            )
        self.order = _ORDERS[self.data[1]]
        self.at = 4

    def align(self, width: int) -> None:
        self.at += -(self.at - 4) % width

    def one(self, code: str) -> int:
        self.align(struct.calcsize(f"<{code}"))
        (value,) = struct.unpack_from(f"{self.order}{code}", self.data, self.at)
        self.at += struct.calcsize(f"<{code}")
        return int(value)

    def double(self) -> float:
        return float(self.array("f8", 1)[0])

    def raw(self, size: int) -> memoryview:
        if self.at + size > len(self.data):
            raise struct.error(f"{size} bytes wanted at {self.at} of {len(self.data)}")
        self.at += size
        return self.data[self.at - size : self.at]

    def text(self) -> str:
        return str(self.raw(self.one("I")), "utf-8").rstrip("\0")

    def texts(self) -> list[str]:
        return [self.text() for _ in range(self.one("I"))]

    def array(self, dtype: str, count: int) -> NDArray[np.generic]:
        kind = np.dtype(self.order + dtype)
        if count:
            self.align(kind.itemsize)
        return np.frombuffer(self.raw(count * kind.itemsize), dtype=kind)

    def doubles(self) -> Array:
        """A view of a sequence; a copy where the byte order is foreign."""
        return self.array("f8", self.one("I")).astype(np.float64, copy=False)


def checked(decode: Callable[[Buffer], T]) -> Callable[[Buffer], T]:
    """Turn what a cut or foreign message provokes in ``decode`` into RecordingError."""

    @wraps(decode)
    def guarded(message: Buffer) -> T:
        try:
            return decode(message)
        except (struct.error, UnicodeDecodeError) as error:
            raise RecordingError(
                f"a message of {len(message)} bytes doesn't hold what its own lengths say "
                f"({error}): it was cut or written by a faulty program, record it again"
            ) from error

    return guarded
