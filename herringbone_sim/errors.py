"""Exceptions, and texts of values for their messages.

A message says what is wrong, by which rule, which value was received, and what to do.
"""

from __future__ import annotations

import reprlib
from collections.abc import Collection

# Characters of one value in a message: it fits into a line beside the words.
_WIDTH = 120
# Characters of a list of names; the channels of a gear with three planets fit in.
_NAMES_WIDTH = 4 * _WIDTH


class HerringboneError(Exception):
    """Base class of all exceptions that a user's input or data can cause."""


class ParameterError(HerringboneError, ValueError):
    """Invalid value, or invalid combination, of parameters, options or names."""


class RecordingError(HerringboneError, OSError):
    """A recording can't be written, read or recovered."""


class RecordingLostError(RecordingError):
    """A file of a recording was removed or changed from outside during the recording."""


class AnalysisError(HerringboneError, ValueError):
    """The given data or options do not allow the requested result."""


class DivergenceError(HerringboneError, ArithmeticError):
    """The integrated motion left the range of any physical motion."""


class _Short(reprlib.Repr):
    """``repr`` of the first few items and characters of a value.

    Fast for large texts, bytes, numbers, lists and tuples. Keys of dicts and members of sets are
    sorted first, and other types give their whole ``repr``.
    """

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
    """Return the ``repr`` of a value for a message, in one line, cut at 120 characters.

    The value may contain itself. Large values are cut before they become text, see ``_Short``.
    """
    text = _SHORT.repr(value)
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 3]}..."


def listed(names: Collection[object]) -> str:
    """Join names with commas for a message; from about 480 characters on, count the rest."""
    first, room = list[str](), _NAMES_WIDTH
    for name in names:
        text = str(name)
        room -= len(text) + 2
        if room < 0 and first:
            break
        first.append(text if len(text) <= _WIDTH else f"{text[: _WIDTH - 3]}...")
    more = len(names) - len(first)
    return ", ".join(first) + (f", ... ({more} more)" if more else "")
