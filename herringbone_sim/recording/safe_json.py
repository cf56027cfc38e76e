"""Parse untrusted JSON within limits on size and depth; make values plain that become JSON.

This is the only JSON reader of this package.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from herringbone_sim.errors import HerringboneError
from herringbone_sim.recording.file_text import file_text

# Thirty times the longest file that this package writes; parsing takes up to 400 MiB.
MOST_BYTES = 16 << 20
# This package writes twenty levels; the recursion limit of Python is far higher.
MOST_LEVELS = 64


class JsonError(HerringboneError, ValueError):
    """A text that is no JSON object, or exceeds the limits."""


def read_json(path: Path) -> dict[str, Any]:
    """Read the JSON object in a file.

    Raises:
        OSError: no such file, unreadable, or not a regular file.
        JsonError: as ``parse_json``, or the file has more than ``MOST_BYTES`` or is not UTF-8.
    """
    return parse_json(json_text(path))


def json_text(path: Path) -> str:
    """Read the text of a file for ``parse_json`` without parsing it.

    Raises:
        OSError: no such file, unreadable, or not a regular file.
        JsonError: more than ``MOST_BYTES`` bytes, or not UTF-8.
    """
    return file_text(path, MOST_BYTES, JsonError, "no JSON: ")


def parse_json(
    text: str, levels: int = MOST_LEVELS, number: Callable[[str], float] = float
) -> dict[str, Any]:
    """Parse the JSON object in a text.

    Args:
        text: JSON; an integer may have at most 20 characters.
        levels: largest nesting depth.
        number: converts the text of a float, ``NaN`` or ``Infinity``, or raises ValueError.

    Raises:
        JsonError: the text is no JSON object, nested too deeply, or has an invalid number.
    """
    try:
        content = json.loads(text, parse_int=_integer, parse_float=number, parse_constant=number)
    except (ValueError, RecursionError) as error:
        reason = "too many brackets" if isinstance(error, RecursionError) else error
        raise JsonError(f"it must be JSON, got {reason}") from None
    if not isinstance(content, dict):
        raise JsonError(f"it must be a JSON object, got {type(content).__name__}")
    level: list[Any] = [content]
    for _ in range(levels):
        level = [
            child for parent in level for child in _held(parent) if isinstance(child, (dict, list))
        ]
    if level:
        raise JsonError(f"its brackets may nest {levels} deep")
    return content


def plain_numbers(value: Any) -> Any:
    """Copy of nested plain data with None for numbers that are not finite, and bytes as lists."""
    if isinstance(value, dict):
        return {key: plain_numbers(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_numbers(item) for item in value]
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _held(value: Any) -> Any:
    return value.values() if isinstance(value, dict) else value


def _integer(text: str) -> int:
    if len(text) > len(str(-(1 << 63))):
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)
