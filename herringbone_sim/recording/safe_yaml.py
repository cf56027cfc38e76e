"""Parse untrusted YAML within limits on size and aliases; the only YAML reader of this package.

Numbers are read as ROS reads them (``1e-4`` is a number, ``1:30`` and ``1_000`` are strings),
dates are strings. Limits are checked on the stream of YAML events before any object is built.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from herringbone_sim.errors import HerringboneError, shown
from herringbone_sim.recording.file_text import file_text

# A bag of 500 topics has a metadata.yaml of some 500 kB; this much takes about two seconds.
MOST_BYTES = 1 << 20
# Values and keys, with aliases expanded.
MOST_NODES = 100_000
# Metadata of rosbag2 has six levels.
MOST_LEVELS = 32
# Longest string: the QoS profiles of all publishers of a topic, 300 characters each.
MOST_CHARACTERS = 1 << 16
# A double has 17 significant digits.
MOST_DIGITS = 100
_TAG = "tag:yaml.org,2002:"


class YamlError(HerringboneError, ValueError):
    """A text that is no YAML, or exceeds the limits; the message names the line."""


class _Loader(yaml.CSafeLoader):
    """Safe YAML loader that tells strings, numbers, booleans and null apart as ROS does."""

    yaml_implicit_resolvers = {}  # noqa: RUF012


# Type, pattern of its text, and possible first characters.
_PLAIN = (
    ("bool", "(?i:yes|no|true|false|on|off)", "yYnNtTfFoO"),
    ("null", "~|null|Null|NULL|", ("~", "n", "N", "")),
    ("int", "[-+]?(0|[1-9][0-9]*|0[0-7]+|0x[0-9a-fA-F]+)", "-+0123456789"),
    (
        "float",
        r"[-+]?(([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+"
        r"|\.(inf|Inf|INF))|\.(nan|NaN|NAN)",
        "-+0123456789.",
    ),
    ("merge", "<<", "<"),
)
for _kind, _pattern, _first in _PLAIN:
    _Loader.add_implicit_resolver(f"{_TAG}{_kind}", re.compile(f"(?:{_pattern})$"), list(_first))


def read_yaml(path: Path) -> dict[Any, Any]:
    """Read the mapping in a YAML file.

    Raises:
        OSError: no such file, unreadable, or not a regular file.
        YamlError: no YAML, beyond the limits, or not a mapping.
    """
    content = parse_yaml(_text(path))
    if not isinstance(content, dict):
        raise YamlError(f"the file must hold a mapping, got {shown(content)}")
    return content


def parse_yaml(text: str) -> Any:
    """Parse a YAML text to a dict, list, str, int, float, bool or None.

    Raises:
        YamlError: no YAML, or beyond the limits on length, depth, aliases or scalars.
    """
    if len(text) > MOST_BYTES:
        raise YamlError(f"it must have {MOST_BYTES} characters at most, got {len(text)}")
    try:
        _check(yaml.parse(text, Loader=_Loader))
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise YamlError(_describe(error)) from None


def _text(path: Path) -> str:
    """Read the text of a file; YamlError if it is too long or not UTF-8."""
    try:
        return file_text(path, MOST_BYTES)
    except ValueError as error:
        raise YamlError(f"no YAML: {error}") from None


@dataclass
class _Open:
    """A list or mapping whose end event has not come: anchor, keys, numbers of nodes and entries.

    ``keys`` are those seen so far; None for a list. Each key and each value is an entry.
    """

    anchor: str | None
    keys: set[str] | None
    n_nodes: int = 1
    n_entries: int = 0

    @property
    def key_comes(self) -> bool:
        """Whether the next event is a key."""
        return self.keys is not None and self.n_entries % 2 == 0


@dataclass
class _Measure:
    """Counter of nodes in a stream of YAML events; raises YamlError where a limit is exceeded.

    Attributes:
        sizes: anchor -> number of nodes that its aliases stand for.
        open: the lists and mappings that have not ended, outermost first.
    """

    sizes: dict[str, int] = field(default_factory=dict)
    open: list[_Open] = field(default_factory=list)

    def take(self, event: Any) -> None:
        """Check one event and count its nodes."""
        if isinstance(event, yaml.AliasEvent):
            self._add(self._aliased(event))
        elif isinstance(event, yaml.ScalarEvent):
            self._scalar(event)
        elif isinstance(event, yaml.CollectionStartEvent):
            self._begin(event)
        elif isinstance(event, yaml.CollectionEndEvent):
            done = self.open.pop()
            self._store_size(done.anchor, done.n_nodes)
            self._add(done.n_nodes)
        if self.open and self.open[-1].n_nodes > MOST_NODES:
            raise _refused(event, f"at most {MOST_NODES} values may stand in it, aliases resolved")

    def _aliased(self, event: Any) -> int:
        """Return the number of nodes that an alias stands for; YamlError if it is undefined."""
        if self.open and self.open[-1].key_comes:
            raise _refused(event, "a key must be a text, got an alias")
        if event.anchor not in self.sizes:
            raise _refused(event, f"the alias {shown(event.anchor)} stands for nothing whole")
        return self.sizes[event.anchor]

    def _scalar(self, event: Any) -> None:
        """Check and count a scalar."""
        _check_tag(event)
        if len(event.value) > MOST_CHARACTERS:
            raise _refused(event, f"a text may have {MOST_CHARACTERS} characters, got more")
        if len(event.value) > MOST_DIGITS and not event.style and _is_number(event.value):
            raise _refused(event, f"a number may have {MOST_DIGITS} digits, got more")
        if self.open and self.open[-1].key_comes:
            self._key(event)
        self._store_size(event.anchor, 1)
        self._add(1)

    def _key(self, event: Any) -> None:
        """Raise YamlError if a key is repeated in its mapping."""
        keys = self.open[-1].keys
        assert keys is not None
        if event.value in keys:
            raise _refused(event, f"{shown(event.value)} stands twice: leave one out")
        keys.add(event.value)

    def _begin(self, event: Any) -> None:
        """Check the nesting depth and open a list or mapping."""
        _check_tag(event)
        if self.open and self.open[-1].key_comes:
            raise _refused(event, "a key must be a text, got a list or mapping")
        if len(self.open) == MOST_LEVELS:
            raise _refused(event, f"lists and mappings may nest {MOST_LEVELS} deep")
        mapping = isinstance(event, yaml.MappingStartEvent)
        self.sizes.pop(event.anchor, None)
        self.open.append(_Open(event.anchor, set() if mapping else None))

    def _store_size(self, anchor: str | None, n_nodes: int) -> None:
        """Store the number of nodes of an anchor, if there is one."""
        if anchor is not None:
            self.sizes[anchor] = n_nodes

    def _add(self, n_nodes: int) -> None:
        """Add nodes to the enclosing list or mapping."""
        if self.open:
            self.open[-1].n_nodes += n_nodes
            self.open[-1].n_entries += 1


def _check(events: Iterable[Any]) -> None:
    """Check all events of a text; YamlError where a limit is exceeded."""
    measure = _Measure()
    for event in events:
        measure.take(event)


def _check_tag(event: Any) -> None:
    """Raise YamlError for an explicit type tag."""
    if event.tag not in (None, "!", f"{_TAG}str", f"{_TAG}seq", f"{_TAG}map"):
        raise _refused(event, f"no type may be given to a value, got {shown(event.tag)}")


def _is_number(text: str) -> bool:
    return all(character in "0123456789abcdefABCDEFx.+-" for character in text)


def _refused(event: Any, rule: str) -> YamlError:
    """Return the error for a broken rule, with the line of the event."""
    return YamlError(f"{rule}, in line {event.start_mark.line + 1}")


def _describe(error: yaml.YAMLError) -> str:
    """Return the message of a PyYAML error in one line."""
    mark = getattr(error, "problem_mark", None)
    where = f", in line {mark.line + 1}" if mark is not None else ""
    problem = (
        getattr(error, "problem", None) or getattr(error, "reason", None) or "it has an error"
    )
    return f"no YAML: {problem}{where}"
