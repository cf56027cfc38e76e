"""Encode the four message types of a recording, and decode all but JointState.

Every ``decode_*`` raises RecordingError for a message that is shorter than its own lengths say, or
not plain CDR.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.errors import RecordingError, shown
from herringbone_sim.recording.cdr import Buffer, CdrReader, CdrWriter, checked

# One sample must fit into 64 kB, which UDP sends in one piece.
MOST_CHANNELS = 8000
MOST_S = 2.0**31  # seconds that a stamp of ROS can hold

Value = bool | int | float | str | bytes | list[bool] | list[int] | list[float] | list[str] | None

_TYPES = ("none", "bool", "int", "float", "str", "bytes", "bools", "ints", "floats", "strs")


def encode_string(text: str) -> bytes:
    """Serialise a text as a std_msgs/String."""
    out = CdrWriter()
    out.text(text)
    return bytes(out.buffer)


@checked
def decode_string(message: Buffer) -> str:
    """Return the text of a std_msgs/String."""
    return CdrReader(message).text()


@lru_cache(maxsize=8)
def _samples_head(names: tuple[str, ...], n: int) -> bytes:
    """Serialise the part of a Float64MultiArray before its data, for n samples of the channels."""
    out, c = CdrWriter(), len(names)
    out.pack("I", 2)
    for label, size, stride in (("sample", n, n * c), (",".join(names), c, c)):
        out.text(label)
        out.pack("2I", size, stride)
    out.pack("2I", 0, n * c)
    if n:
        out.pack("0d")
    return bytes(out.buffer)


def encode_samples(names: tuple[str, ...], rows: Array) -> bytes:
    """Serialise a block of samples as a std_msgs/Float64MultiArray.

    Args:
        names: c channel names, without commas.
        rows: (n, c) samples.
    """
    content = np.ascontiguousarray(rows, dtype="<f8").reshape(-1).view(np.uint8)
    return b"".join((_samples_head(names, len(rows)), content.data))


@checked
def decode_samples(message: Buffer) -> tuple[tuple[str, ...], Array]:
    """Return channel names (c,) and samples (n, c) of a std_msgs/Float64MultiArray.

    The samples are a view of the message if it has native byte order.

    Raises:
        RecordingError: the layout is not that of the ``samples`` topic.
    """
    source = CdrReader(message)
    n_dims = source.scalar("I")
    if n_dims != 2:
        raise RecordingError(
            f"samples need a layout of 2 dimensions (sample, channels), got {n_dims}: "
            "put the channel names, separated by commas, into the label of the second"
        )
    (_, n, _), (label, c, _) = (
        (source.text(), source.scalar("I"), source.scalar("I")) for _ in "nc"
    )
    offset = source.scalar("I")
    data = source.doubles()[offset:]
    n_names = label.count(",") + 1
    if c != n_names or n * c != len(data) or c > MOST_CHANNELS:
        raise RecordingError(
            f"samples need size(sample) x size(channels) values and one name a channel, at most "
            f"{MOST_CHANNELS}, got {n} x {c}, {n_names} names and {len(data)} values: mend the "
            "layout"
        )
    return _names(label), data.reshape(n, c)


@lru_cache(maxsize=8)
def _names(label: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in label.split(","))


def encode_joint_state(
    stamp_ns: int, names: tuple[str, ...], position: Array, velocity: Array, effort: Array
) -> bytes:
    """Serialise a sensor_msgs/JointState: m meshes at one instant.

    Args:
        stamp_ns: time of the header [ns].
        names: m mesh names.
        position, velocity, effort: (m,) displacement [m], velocity [m/s], force [N].

    Raises:
        RecordingError: the arrays are not all as long as the names.
    """
    arrays = (position, velocity, effort)
    if any(len(array) != len(names) for array in arrays):
        raise RecordingError(
            f"position, velocity and effort must be as long as the {len(names)} names, got "
            f"{', '.join(str(len(array)) for array in arrays)}: give one value a mesh in each"
        )
    if not -MOST_S <= stamp_ns / 1e9 < MOST_S:
        raise RecordingError(
            f"a stamp must be below 2^31 s, got {stamp_ns / 1e9:g} s: time counts seconds"
        )
    out = CdrWriter()
    out.pack("iI", *divmod(stamp_ns, 10**9))
    out.text("")
    out.texts(names)
    for array in arrays:
        out.numbers("d", [float(value) for value in array])
    return bytes(out.buffer)


@dataclass(frozen=True)
class ParameterEvent:
    """Content of a rcl_interfaces/ParameterEvent.

    Attributes:
        stamp_ns: time of the change [ns].
        node: full name of the node.
        changed: new value by parameter name; None for a deleted or unset one.
    """

    stamp_ns: int
    node: str
    changed: Mapping[str, Value]


def _type_of(value: object) -> str:
    """Return the name in ``_TYPES`` of the ROS type of a value; RecordingError if none fits."""
    if isinstance(value, (bool, np.bool_)):
        return "bool"
    if isinstance(value, (int, np.integer)):
        return "int"
    if isinstance(value, (float, np.floating)):
        return "float"
    if isinstance(value, (bytes, str)):
        return type(value).__name__
    if isinstance(value, (list, tuple, np.ndarray)):
        kinds = {_type_of(item) for item in value}
        if kinds <= {"int", "float"}:
            return "ints" if kinds == {"int"} else "floats"
        if len(kinds) == 1 and kinds <= {"bool", "str"}:
            return f"{kinds.pop()}s"
    raise RecordingError(
        "a parameter must be a bool, int, float, str, bytes or a list of one of these kinds, "
        f"got {shown(value)}: convert it before it is recorded"
    )


def _write_value(out: CdrWriter, value: Value) -> None:
    """Append a value as a rcl_interfaces/ParameterValue; None is an unset parameter."""
    kind = "none" if value is None else _type_of(value)
    held: dict[str, Any] = {kind: value}
    out.pack("B", _TYPES.index(kind))
    out.pack("?", bool(held.get("bool", False)))
    out.pack("q", held.get("int", 0))
    out.pack("d", held.get("float", 0.0))
    out.text(str(held.get("str", "")))
    for key, code in (("bytes", "B"), ("bools", "?"), ("ints", "q"), ("floats", "d")):
        out.numbers(code, held.get(key, ()))
    out.texts(held.get("strs", ()))


def _read_value(source: CdrReader) -> Value:
    """Read a rcl_interfaces/ParameterValue; None if it is unset or of an unknown type."""
    kind = source.scalar("B")
    values: tuple[Value, ...] = (
        None,
        bool(source.scalar("B")),
        source.scalar("q"),
        float(source.array("f8", 1)[0]),
        source.text(),
        bytes(source.raw(source.scalar("I"))),
        [bool(item) for item in source.raw(source.scalar("I"))],
        [int(item) for item in source.array("i8", source.scalar("I"))],
        [float(item) for item in source.doubles()],
        source.texts(),
    )
    return values[kind] if kind < len(values) else None


def encode_parameter_event(event: ParameterEvent) -> bytes:
    """Serialise a rcl_interfaces/ParameterEvent with all values under ``changed_parameters``.

    Raises:
        RecordingError: a value that no ROS parameter can have.
    """
    out = CdrWriter()
    out.pack("iI", *divmod(event.stamp_ns, 10**9))
    out.text(event.node)
    out.pack("I", 0)
    out.pack("I", len(event.changed))
    for name, value in event.changed.items():
        out.text(name)
        _write_value(out, value)
    out.pack("I", 0)
    return bytes(out.buffer)


@checked
def decode_parameter_event(message: Buffer) -> ParameterEvent:
    """Parse a rcl_interfaces/ParameterEvent; new, changed and deleted (None) are merged."""
    source = CdrReader(message)
    stamp_ns, node = source.scalar("i") * 10**9 + source.scalar("I"), source.text()
    changed: dict[str, Value] = {}
    for deleted in (False, False, True):
        for _ in range(source.scalar("I")):
            name, value = source.text(), _read_value(source)
            changed[name] = None if deleted else value
    return ParameterEvent(stamp_ns, node, changed)
