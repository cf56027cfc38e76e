"""Serialise and parse CDR, the byte format of ROS 2 messages, without ROS.

Messages are written little endian; both byte orders are read. Alignment is counted from the end of
the encapsulation header, which has four bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import wraps
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.errors import RecordingError

Buffer = bytes | bytearray | memoryview

T = TypeVar("T")

ENCAPSULATION = b"\x00\x01\x00\x00"
_ORDERS = {0: ">", 1: "<"}


class CdrWriter:
    """Serialise fields one after the other, with their padding, into ``buffer``."""

    def __init__(self) -> None:
        self.buffer = bytearray(ENCAPSULATION)

    def pack(self, code: str, *values: object) -> None:
        """Append values of the struct format ``code``, aligned to the width of its last type."""
        width = struct.calcsize(f"<{code[-1]}")
        self.buffer += bytes(-(len(self.buffer) - 4) % width)
        self.buffer += struct.pack(f"<{code}", *values)

    def text(self, value: str) -> None:
        """Append a string."""
        raw = value.encode() + b"\0"
        self.pack("I", len(raw))
        self.buffer += raw

    def texts(self, values: Sequence[str]) -> None:
        """Append a sequence of strings."""
        self.pack("I", len(values))
        for value in values:
            self.text(value)

    def numbers(self, code: str, values: Sequence[float]) -> None:
        """Append a sequence of numbers of the struct type ``code``, preceded by its length."""
        self.pack("I", len(values))
        if len(values):
            self.pack(f"{len(values)}{code}", *values)


class CdrReader:
    """Parse the fields of a message one after the other, in its byte order.

    A message that is cut or not UTF-8 raises errors that ``checked`` turns into RecordingError.

    Raises:
        RecordingError: the message does not start with the header of plain CDR.
    """

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
        """Skip padding up to a multiple of ``width`` bytes."""
        self.at += -(self.at - 4) % width

    def scalar(self, code: str) -> int:
        """Read one integer of the struct type ``code``."""
        self.align(struct.calcsize(f"<{code}"))
        (value,) = struct.unpack_from(f"{self.order}{code}", self.data, self.at)
        self.at += struct.calcsize(f"<{code}")
        return int(value)

    def raw(self, size: int) -> memoryview:
        """Read ``size`` bytes; struct.error if the message is shorter."""
        if self.at + size > len(self.data):
            raise struct.error(f"{size} bytes wanted at {self.at} of {len(self.data)}")
        self.at += size
        return self.data[self.at - size : self.at]

    def text(self) -> str:
        """Read a string."""
        return str(self.raw(self.scalar("I")), "utf-8").rstrip("\0")

    def texts(self) -> list[str]:
        """Read a sequence of strings."""
        return [self.text() for _ in range(self.scalar("I"))]

    def array(self, dtype: str, count: int) -> NDArray[np.generic]:
        """Read ``count`` numbers of a NumPy type such as ``f8``, as a view of the message."""
        kind = np.dtype(self.order + dtype)
        if count:
            self.align(kind.itemsize)
        return np.frombuffer(self.raw(count * kind.itemsize), dtype=kind)

    def doubles(self) -> Array:
        """Read a sequence of float64, as a view if the message has native byte order."""
        return self.array("f8", self.scalar("I")).astype(np.float64, copy=False)


def checked(decode: Callable[[Buffer], T]) -> Callable[[Buffer], T]:
    """Decorate a decoder: for a message that is cut or not UTF-8 it raises RecordingError."""

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
