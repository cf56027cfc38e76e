"""The ``channels`` message of a run: JSON from outside, checked once into what is known of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from herringbone_sim.effects.sensors import Clock
from herringbone_sim.errors import RecordingError, shown
from herringbone_sim.recording.safe_json import JsonError, parse_json

# Some hundred characters a channel, of as many channels as fit into a message, leave half of it.
MOST_CHARACTERS = 4 << 20
# Written by this package it nests five deep.
MOST_LEVELS = 32
# A name, a unit or a version stands in a line.
MOST_IN_A_WORD = 100
# Counts beyond this are no longer told apart as doubles.
MOST_COUNT = 1 << 53


@dataclass(frozen=True)
class StoredState:
    """State at the first sample, as ``core.integrate.State`` has it; every number is finite."""

    y: tuple[float, ...]
    cycle: int
    index: int
    t: float


@dataclass(frozen=True)
class Channels:
    """What the ``channels`` message says; what it leaves out, or says wrongly, is empty.

    Attributes:
        content: all of it, as plain JSON with finite numbers.
        source, model, version: who recorded the run.
        units: by channel name.
        parameters: by name, of the gear.
        state: at the first sample; None if it is not known.
        clock: of the sensors at the first sample.
    """

    content: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    model: str = ""
    version: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    state: StoredState | None = None
    clock: Clock = field(default_factory=Clock)


def read_channels(text: str) -> tuple[Channels, list[str]]:
    """What a ``channels`` message says, and a sentence on each part of it that is wrong.

    Raises:
        RecordingError: it is no JSON object, larger or deeper than any can be, or holds numbers
            that JSON does not have.
    """
    content = _parsed(text)
    parts: dict[str, Any] = {}
    notes = []
    for name, field_name, read in _PARTS:
        if content.get(name) is not None:
            try:
                parts[field_name] = read(content[name])
            except ValueError as error:
                notes.append(
                    f"{name} in the channels message must be {error}, got "
                    f"{shown(content[name])}: it is not used"
                )
    return Channels(content, **parts), notes


def _parsed(text: str) -> dict[str, Any]:
    if len(text) > MOST_CHARACTERS:
        raise RecordingError(
            f"it may have {MOST_CHARACTERS} characters, got {len(text)}: mend the program"
        )
    try:
        return parse_json(text, MOST_LEVELS, _finite)
    except JsonError as error:
        raise RecordingError(f"{error}: mend the program") from None


def _finite(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise ValueError(f"{shown(text)}, which is no finite number")
    return value


def _word(value: Any) -> str:
    if not isinstance(value, str) or len(value) > MOST_IN_A_WORD or not value.isprintable():
        raise ValueError("a word")
    return value


def _units(value: Any) -> dict[str, str]:
    try:
        return {_word(entry["name"]): _word(entry.get("unit") or "") for entry in value}
    except (AttributeError, KeyError, TypeError, ValueError):
        raise ValueError("a list with a name and a unit for each channel") from None


def _mapping(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError("names and values")
    return value


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(value)
    return float(value)


def _count(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MOST_COUNT:
        raise TypeError(value)
    return value


def _state(value: Any) -> StoredState:
    try:
        y = tuple(_number(one) for one in value["y"])
        return StoredState(y, _count(value["cycle"]), _count(value["index"]), _number(value["t"]))
    except (KeyError, TypeError):
        raise ValueError("y, a list of numbers, cycle and index, two counts, and t") from None


def _clock(value: Any) -> Clock:
    try:
        return Clock(**{name: _number(one) for name, one in _mapping(value).items()})
    except (TypeError, ValueError):
        raise ValueError("t_s and shown_s, two numbers") from None


# Name in the message, name of the field, and what reads it or raises ValueError with its rule.
_PARTS = (
    ("source", "source", _word),
    ("model", "model", _word),
    ("version", "version", _word),
    ("channels", "units", _units),
    ("parameters", "parameters", _mapping),
    ("state", "state", _state),
    ("clock", "clock", _clock),
)
