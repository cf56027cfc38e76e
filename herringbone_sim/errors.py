"""The errors of this package: what is wrong, by which rule, the value got, what to do."""

from __future__ import annotations

import reprlib
from collections.abc import Collection

# About what fits into a line beside the words of a message.
_WIDTH = 120
# The channels of a gear with three planets fit in.
_NAMES_WIDTH = 4 * _WIDTH


class HerringboneError(Exception):
    """Base of every error that a user of this package can provoke."""


class ParameterError(HerringboneError, ValueError):
    """A parameter, or a set of them, that no gear or no integrator can have."""


class RecordingError(HerringboneError, OSError):
    """A recording that can't be written, read or recovered."""


class RecordingLostError(RecordingError):
    """A file of a recording that no longer is what was written, while the recording runs."""


class AnalysisError(HerringboneError, ValueError):
    """Data from which the wanted result can't be had."""


class DivergenceError(HerringboneError, ArithmeticError):
    """An integration that left the range of any physical motion."""


class _Short(reprlib.Repr):
    """Looks at the first few parts of a value alone, however large it is."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxdict, self.maxlist, self.maxtuple = 3, 4, 6, 6
        self.maxstring = self.maxother = _WIDTH

    def repr_int(self, x: int, level: int) -> str:
        del level
        bits = x.bit_length()
        return repr(x) if bits <= 4 * _WIDTH else f"<a number of {bits} bits>"

    def repr_bytes(self, x: bytes, level: int) -> str:
        del level
        return repr(x[:_WIDTH]) + ("..." if len(x) > _WIDTH else "")


_SHORT = _Short()


def shown(value: object) -> str:
    """A value as it stands in a message: its ``repr`` in a line, cut where it is long.

    Takes no longer and no more memory for a large value, or one that holds itself many times.
    """
    text = _SHORT.repr(value)
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 3]}..."


def listed(names: Collection[object]) -> str:
    """Names from outside in a line of a message: the first of them, and how many there are."""
    first, room = list[str](), _NAMES_WIDTH
    for name in names:
        text = str(name)
        room -= len(text) + 2
        if room < 0 and first:
            break
        first.append(text if len(text) <= _WIDTH else f"{text[: _WIDTH - 3]}...")
    more = len(names) - len(first)
    return ", ".join(first) + (f", ... ({more} more)" if more else "")
