"""A mapping of the spec whose values are checked as they are read."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from typing import Any

from herringbone_sim.errors import RecordingError, listed, shown
from herringbone_sim.recording.importing.units import factor, number_of, quantity


class Entry:
    """A mapping of the spec and its place there, such as ``runs[0]``; errors name the place."""

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
        """Error that names place, rule, value and remedy."""
        return RecordingError(f"{self._place(key)} must be {rule}, got {shown(value)}: {do}")

    def _place(self, key: str) -> str:
        """Place of a key in the spec."""
        return ".".join(part for part in (self.where, key) if part) or "the spec"

    def take(self, key: str, default: Any = None) -> Any:
        """Value of a key, unchecked."""
        return self._values.get(key, default)

    def need(self, key: str, rule: str) -> Any:
        """Value of a key; RecordingError if it is missing."""
        if key not in self._values:
            raise RecordingError(f"{self._place(key)} is missing: it must be {rule}, write it")
        return self._values[key]

    def text(self, key: str, default: str | None = None) -> str:
        """A non-empty printable text."""
        rule = "a text"
        value = self.need(key, rule) if default is None else self.take(key, default)
        if not isinstance(value, str) or not value.strip() or not value.isprintable():
            raise self.wrong(key, rule, value)
        return value

    def choice(self, key: str, choices: Sequence[Any], default: Any = None) -> Any:
        """One of the given values."""
        rule = f"one of {listed(choices)}"
        value = self.need(key, rule) if default is None else self.take(key, default)
        if not any(value is one or (value == one and type(value) is type(one)) for one in choices):
            raise self.wrong(key, rule, value)
        return value

    def quantity(self, key: str, si: str, default: float | None = None) -> float:
        """A number converted to the unit ``si``."""
        value = self.need(key, number_of(si)) if default is None else self.take(key, default)
        return self._converted(key, lambda: quantity(value, si))

    def factor(self, key: str, si: str) -> float:
        """Factor from the unit named by the key to ``si``."""
        unit = self.text(key)
        return self._converted(key, lambda: factor(unit, si))

    def _converted(self, key: str, read: Callable[[], float]) -> float:
        """Result of ``read``; RecordingError with the place instead of ValueError."""
        try:
            return read()
        except ValueError as error:
            raise RecordingError(f"{self._place(key)} must be {error}") from None

    def entries(self, key: str) -> list[Any]:
        """A non-empty list."""
        value = self.need(key, "a list")
        if not isinstance(value, list) or not value:
            raise self.wrong(key, "a list with an entry or more", value)
        return value
