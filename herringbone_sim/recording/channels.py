"""Parse and check the ``channels`` message of a run: JSON with units, parameters and state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from herringbone_sim.effects.sensors import Clock
from herringbone_sim.errors import RecordingError, shown
from herringbone_sim.recording.safe_json import JsonError, parse_json

# Twice what the largest number of channels needs, at some hundred characters a channel.
MOST_CHARACTERS = 4 << 20
# Deepest nesting accepted; this package writes five levels.
MOST_LEVELS = 32
# Longest name, unit or version [characters].
MOST_IN_A_WORD = 100
# Largest count that a double holds exactly.
MOST_COUNT = 1 << 53


@dataclass(frozen=True)
class StoredState:
    """State at the first sample, fields as in ``core.integrate.State``; every number is finite."""

    y: tuple[float, ...]
    cycle: int
    index: int
    t: float


@dataclass(frozen=True)
class Channels:
    """Content of the ``channels`` message; missing or invalid fields have their defaults.

    Attributes:
        content: the whole message as plain JSON with finite numbers.
        source: ``simulator``, or the name of the rig.
        model, version: kind of model and version of this package, if the simulator recorded it.
        units: channel name -> unit; empty for a channel without one.
        parameters: values of the gear by name, with ``effects`` if it has any.
        state: state at the first sample; None if unknown.
        clock: clock of the sensors at the first sample.
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
    """Parse a ``channels`` message; return its content and a sentence on each invalid field.

    Raises:
        RecordingError: the text is no JSON object, exceeds the limits on size or depth, or has
            numbers that are not finite.
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
    """Parse the JSON object of a message; RecordingError if it is invalid or too large."""
    if len(text) > MOST_CHARACTERS:
        raise RecordingError(
            f"it may have {MOST_CHARACTERS} characters, got {len(text)}: mend the program"
        )
    try:
        return parse_json(text, MOST_LEVELS, _finite)
    except JsonError as error:
        raise RecordingError(f"{error}: mend the program") from None


def _finite(text: str) -> float:
    """Convert a JSON number to float; ValueError if it is not finite."""
    value = float(text)
    if not isfinite(value):
        raise ValueError(f"{shown(text)}, which is no finite number")
    return value


def _word(value: Any) -> str:
    """Return a value that is a short printable text; ValueError otherwise."""
    if not isinstance(value, str) or len(value) > MOST_IN_A_WORD or not value.isprintable():
        raise ValueError("a word")
    return value


def _units(value: Any) -> dict[str, str]:
    """Return channel name -> unit; ValueError says what the value must be."""
    try:
        return {_word(entry["name"]): _word(entry.get("unit") or "") for entry in value}
    except (AttributeError, KeyError, TypeError, ValueError):
        raise ValueError("a list with a name and a unit for each channel") from None


def _mapping(value: Any) -> dict[str, Any]:
    """Return a value that is a JSON object; ValueError says what the value must be."""
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
    """Parse the state at the first sample; ValueError says what the value must be."""
    try:
        y = tuple(_number(number) for number in value["y"])
        return StoredState(y, _count(value["cycle"]), _count(value["index"]), _number(value["t"]))
    except (KeyError, TypeError):
        raise ValueError("y, a list of numbers, cycle and index, two counts, and t") from None


def _clock(value: Any) -> Clock:
    """Parse the clock of the sensors; ValueError says what the value must be."""
    try:
        return Clock(**{name: _number(time) for name, time in _mapping(value).items()})
    except (TypeError, ValueError):
        raise ValueError("t_s and shown_s, two numbers") from None


# Key in the message, field of Channels, and parser, whose ValueError says what the value must be.
_PARTS = (
    ("source", "source", _word),
    ("model", "model", _word),
    ("version", "version", _word),
    ("channels", "units", _units),
    ("parameters", "parameters", _mapping),
    ("state", "state", _state),
    ("clock", "clock", _clock),
)
