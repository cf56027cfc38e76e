"""Read columns of a rosbag2 bag with any message types: each number of each topic, and its times.

A column is named ``TOPIC.FIELD``, such as ``/sun.data`` or ``/joints.effort[2]``, or, for blocks
of samples with named channels, ``/rig/samples.F_sp1_L``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.recording.importing.units import package
from herringbone_sim.recording.safe_yaml import YamlError, read_yaml

Values = NDArray[Any]
_Number = (bool, int, float, np.number)


def bag_columns(
    path: Path, column_names: Sequence[str]
) -> tuple[dict[str, Values], dict[str, Values], tuple[str, ...]]:
    """Read the wanted columns of a bag.

    Returns:
        Values (n,) by column, without columns that the bag does not have; stamps (n,) by column,
        datetime64[ns], of the message header, else the recording time, and none for blocks of
        samples; and the names of all columns.
    """
    rosbags = package("rosbags.highlevel", "rosbags", "rosbag2 files")
    types = package("rosbags.typesys", "rosbags", "rosbag2 files")
    typestore = types.get_typestore(types.Stores.ROS2_JAZZY)
    parts: dict[str, list[Values]] = defaultdict(list)
    stamps: dict[str, list[int]] = defaultdict(list)
    names: dict[str, None] = {}
    with rosbags.AnyReader([_folder(path)], default_typestore=typestore) as reader:
        for connection, logged_ns, raw in reader.messages():
            topic = connection.topic
            if topic in stamps and not any(
                column.startswith(f"{topic}.") for column in column_names
            ):
                continue
            message = reader.deserialize(raw, connection.msgtype)
            stamps[topic].append(_stamp(message, logged_ns))
            for field, values in _fields(message, ""):
                names[f"{topic}.{field}"] = None
                parts[f"{topic}.{field}"].append(values)
    there = {name: np.concatenate(parts[name]) for name in column_names if name in parts}
    clocks = {topic: np.array(ns, "int64").view("datetime64[ns]") for topic, ns in stamps.items()}
    of_column = {name: clocks[name.partition(".")[0]] for name in there}
    known = {n: c for n, c in of_column.items() if len(c) == len(there[n])}
    return there, known, tuple(names)


def _folder(path: Path) -> Path:
    """Return the folder of a bag that has this file alone, else the path itself."""
    metadata = path.parent / "metadata.yaml"
    if not (path.is_file() and metadata.is_file()):
        return path
    try:
        of_bag = read_yaml(metadata).get("rosbag2_bagfile_information") or {}
        names = [Path(name).name for name in of_bag.get("relative_file_paths") or ()]
    except (YamlError, AttributeError, TypeError):  # the metadata of something else
        return path
    return path.parent if names == [path.name] else path


def _stamp(message: Any, logged_ns: int) -> int:
    """Return the header stamp of a message [ns], else its log time."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return logged_ns if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _fields(message: Any, prefix: str) -> Iterator[tuple[str, Values]]:
    """Yield name and values of every number in a message, nested fields joined by dots."""
    block = _block(message)
    if block is not None:
        yield from block
        return
    for name, value in vars(message).items():
        if isinstance(value, _Number):
            yield f"{prefix}{name}", np.array([value])
        elif isinstance(value, np.ndarray) and value.dtype.itemsize > 1:  # no image bytes
            for i, number in enumerate(value):
                yield f"{prefix}{name}[{i}]", np.array([number])
        elif hasattr(value, "__dataclass_fields__") and name not in ("header", "layout"):
            yield from _fields(value, f"{prefix}{name}.")


def _block(message: Any) -> list[tuple[str, Values]] | None:
    """Return the columns of a block of samples (2-D array layout); None for other messages."""
    dimensions: Sequence[Any] = getattr(getattr(message, "layout", None), "dim", [])
    names = dimensions[1].label.split(",") if len(dimensions) == 2 else []
    if not names or len(message.data) != dimensions[0].size * len(names):
        return None
    return list(
        zip([name.strip() for name in names], message.data.reshape(-1, len(names)).T, strict=True)
    )
