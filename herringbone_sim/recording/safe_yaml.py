"""Parse untrusted YAML within limits on size and aliases; the only YAML reader of this package.

Numbers are read as ROS reads them (``1e-4`` is a number, ``1:30`` and ``1_000`` are strings),
dates are strings. Limits are checked on the stream of YAML events before any object is built.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
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
    content = parse_yaml(file_text(path, MOST_BYTES, YamlError, "no YAML: "))
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


def _check(events: Iterator[Any]) -> None:
    """Check all events of a text; YamlError where a limit is exceeded."""
    sizes: dict[str, int] = {}
    for event in events:
        if isinstance(event, yaml.NodeEvent):
            _count(event, events, sizes)


def _count(event: Any, events: Iterator[Any], sizes: dict[str, int], level: int = 0) -> int:
    """Check a value and return its number of nodes, aliases resolved; YamlError beyond a limit.

    Args:
        event: first event of the value.
        events: the events after it; those of the value are taken.
        sizes: anchor -> number of nodes that its aliases stand for; those of the value are added.
        level: number of lists and mappings around the value.
    """
    if isinstance(event, yaml.AliasEvent):
        if event.anchor not in sizes:
            raise _refused(event, f"the alias {shown(event.anchor)} stands for nothing whole")
        return sizes[event.anchor]
    _check_tag(event)
    n_nodes = 1
    if isinstance(event, yaml.ScalarEvent):
        _check_length(event)
    else:
        if level == MOST_LEVELS:
            raise _refused(event, f"lists and mappings may nest {MOST_LEVELS} deep")
        sizes.pop(event.anchor, None)
        keys: set[str] | None = set() if isinstance(event, yaml.MappingStartEvent) else None
        for number, inner in enumerate(events):
            if isinstance(inner, yaml.CollectionEndEvent):
                break
            if keys is not None and number % 2 == 0:
                _check_key(inner, keys)
            n_nodes += _count(inner, events, sizes, level + 1)
            if n_nodes > MOST_NODES:
                rule = f"at most {MOST_NODES} values may stand in it, aliases resolved"
                raise _refused(inner, rule)
    if event.anchor is not None:
        sizes[event.anchor] = n_nodes
    return n_nodes


def _check_key(event: Any, keys: set[str]) -> None:
    """Add a key to those of its mapping; YamlError if it is no text, or there already."""
    if isinstance(event, yaml.AliasEvent):
        raise _refused(event, "a key must be a text, got an alias")
    _check_tag(event)
    if not isinstance(event, yaml.ScalarEvent):
        raise _refused(event, "a key must be a text, got a list or mapping")
    if event.value in keys:
        raise _refused(event, f"{shown(event.value)} stands twice: leave one out")
    keys.add(event.value)


def _check_length(event: Any) -> None:
    """Raise YamlError for a scalar that is too long."""
    if len(event.value) > MOST_CHARACTERS:
        raise _refused(event, f"a text may have {MOST_CHARACTERS} characters, got more")
    if len(event.value) > MOST_DIGITS and not event.style and _is_number(event.value):
        raise _refused(event, f"a number may have {MOST_DIGITS} digits, got more")


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
