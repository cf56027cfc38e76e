"""Check the values in a mapping of the spec as they are read."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from typing import Any

from herringbone_sim.errors import RecordingError, listed, shown
from herringbone_sim.recording.importing.units import factor, number_of, quantity


class Entry:
    """A mapping of the spec and its path there, such as ``runs[0]``, which errors name.

    All methods that read a value raise RecordingError if it is invalid.

    Args:
        value: the mapping.
        where: path of the mapping in the spec; empty for the whole spec.
        known: keys that it may have.

    Raises:
        RecordingError: the value is no mapping, or has another key.
    """

    def __init__(self, value: Any, where: str, known: Sequence[str]) -> None:
        self.where = where
        if not isinstance(value, dict):
            raise self.wrong("", f"a mapping of {listed(known)}", value)
        self._values: dict[Any, Any] = value
        for key in value:
            if key not in known:
                near = difflib.get_close_matches(str(key), known, 1)
                hint = f"did you mean {near[0]}?" if near else "leave it out"
                raise self.wrong("", f"a mapping of {listed(known)}", key, hint)

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def wrong(
        self, key: str, rule: str, value: object, do: str = "mend the spec"
    ) -> RecordingError:
        """Return an error that names the path of a key, the rule, the value and the remedy."""
        return RecordingError(f"{self._place(key)} must be {rule}, got {shown(value)}: {do}")

    def _place(self, key: str) -> str:
        """Return the path of a key in the spec, for messages."""
        return ".".join(part for part in (self.where, key) if part) or "the spec"

    def take(self, key: str, default: Any = None) -> Any:
        """Return the value of a key, unchecked."""
        return self._values.get(key, default)

    def need(self, key: str, rule: str) -> Any:
        """Return the value of a key; RecordingError with the rule if it is missing."""
        if key not in self._values:
            raise RecordingError(f"{self._place(key)} is missing: it must be {rule}, write it")
        return self._values[key]

    def text(self, key: str, default: str | None = None) -> str:
        """Return the value of a key, a non-empty printable text."""
        rule = "a text"
        value = self.need(key, rule) if default is None else self.take(key, default)
        if not isinstance(value, str) or not value.strip() or not value.isprintable():
            raise self.wrong(key, rule, value)
        return value

    def choice(self, key: str, choices: Sequence[Any], default: Any = None) -> Any:
        """Return the value of a key, one of ``choices``."""
        rule = f"one of {listed(choices)}"
        value = self.need(key, rule) if default is None else self.take(key, default)
        if not any(
            value is allowed or (value == allowed and type(value) is type(allowed))
            for allowed in choices
        ):
            raise self.wrong(key, rule, value)
        return value

    def quantity(self, key: str, si: str, default: float | None = None) -> float:
        """Return the value of a key, a quantity, converted to the unit ``si``."""
        value = self.need(key, number_of(si)) if default is None else self.take(key, default)
        return self._converted(key, lambda: quantity(value, si))

    def factor(self, key: str, si: str) -> float:
        """Return the size in ``si`` of the unit that is the value of a key."""
        unit = self.text(key)
        return self._converted(key, lambda: factor(unit, si))

    def _converted(self, key: str, read: Callable[[], float]) -> float:
        """Return ``read()``; its ValueError becomes a RecordingError with the path of the key."""
        try:
            return read()
        except ValueError as error:
            raise RecordingError(f"{self._place(key)} must be {error}") from None

    def entries(self, key: str) -> list[Any]:
        """Return the value of a key, a non-empty list."""
        value = self.need(key, "a list")
        if not isinstance(value, list) or not value:
            raise self.wrong(key, "a list with an entry or more", value)
        return value
