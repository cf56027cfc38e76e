"""Define the parameters of the ROS node beyond those of the model; convert and check values."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from herringbone_sim.core import parameters as core
from herringbone_sim.core.parameters import Meaning, Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import ParameterError, shown
from herringbone_sim.recording.parameter_file import EFFECTS, gear_of_values, read_values

OF_NODE: Mapping[str, tuple[Any, Meaning]] = {
    EFFECTS: (
        "",
        Meaning(
            "-",
            "effects that the nominal model leaves out, as tooth_crack@sp/1/L:depth=0.3; several "
            "joined by ';'; empty: none",
            live=True,
        ),
    ),
    "real_time_factor": (
        1.0,
        Meaning("-", "simulation over wall time; 0: as fast as possible", 0.0, 1e3, live=True),
    ),
    "publish_rate": (
        100.0,
        Meaning("Hz", "rate of ~/state in wall time", 0.1, 1e4, live=True),
    ),
    "step_cycles": (1, Meaning("-", "mesh cycles that ~/step advances", 1, 10**6, live=True)),
    "start_paused": (False, Meaning("-", "start paused: wait for ~/resume or ~/step")),
    "record": (False, Meaning("-", "start a recording with the first sample")),
    "record_dir": ("runs", Meaning("-", "folder of the recordings", live=True)),
    "record_name": ("", Meaning("-", "name of the next recording; empty: by time", live=True)),
    "record_max_mb": (
        0.0,
        Meaning(
            "MB",
            "size at which a recording goes on in its next file; 0: never; for the next recording",
            0.0,
            1e6,
            live=True,
        ),
    ),
    "record_max_s": (
        0.0,
        Meaning(
            "s",
            "simulation time after which a recording goes on in its next file; 0: never; for the "
            "next recording",
            0.0,
            1e6,
            live=True,
        ),
    ),
    "publish_clock": (False, Meaning("-", "publish /clock, unless another node does")),
    "mirror": (
        "off",
        Meaning(
            "-",
            "Rerun viewer: off, spawn, connect, serve, save",
            choices=("off", "spawn", "connect", "serve", "save"),
        ),
    ),
    "mirror_address": (
        "",
        Meaning(
            "-",
            "HOST:PORT of the viewer, or [HOST:]PORT to serve at; without HOST this machine alone",
        ),
    ),
    "mirror_path": ("mirror.rrd", Meaning("-", "file that the mirror saves to")),
    "mirror_memory": ("1GB", Meaning("-", "memory limit of the viewer")),
}

LONGEST_TEXT = 8192  # twice the longest path; /diagnostics carries it every second
LONGEST_NAME = 64  # characters of an unknown name that are compared with the known ones
ALIKE = 0.66  # similarity of a mistyped name (difflib ratio); kk and K have two thirds
# Type of a parameter -> its name in messages, and what to do where a value has another type.
_KINDS = {
    bool: ("bool", "give true or false"),
    int: ("int", "give a whole number"),
    float: ("float", "give one number"),
    str: ("a text", "put it in quotes"),
}


def default_of(name: str) -> Any:
    """Return the default value of a parameter of the node or of the model.

    Raises:
        KeyError: neither has a parameter of this name, see ``is_known``.
    """
    if name in OF_NODE:
        return OF_NODE[name][0]
    return Parameters.__dataclass_fields__[name].default


def meaning_of(name: str) -> Meaning:
    """Return unit, text and range of a parameter of the model or of the node."""
    return OF_NODE[name][1] if name in OF_NODE else core.meaning(name)


def converted(name: str, value: Any) -> Any:
    """Convert a value to the type of its parameter, where ROS tools send another type.

    For a float they send 1 as an integer and 1e-3 as a string (YAML 1.1 requires a dot), for a
    string off as a bool, and an empty list with any type. A list of numbers becomes a list of
    floats. A value that needs no conversion, or allows none, is returned unchanged.
    """
    kind = type(default_of(name)) if is_known(name) else None
    if kind is float and (number := _number(value)) is not None:
        return number
    if kind is tuple and (numbers := _numbers(value)) is not None:
        return numbers
    if kind is str and value is False and "off" in meaning_of(name).choices:
        return "off"
    return value


def _number(value: Any) -> float | None:
    """Convert a number or a numeric text to float; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return None
    try:
        return float(value)
    except ValueError:
        return None


def _numbers(value: Any) -> list[float] | None:
    """Convert a number, a list or a text like ``[1, 2]`` to floats; None if impossible."""
    if isinstance(value, str) and value.startswith("[") and value.endswith("]"):
        value = value[1:-1].split(",")
    many = [value] if isinstance(value, (int, float, str)) else value
    if many is None:
        return None
    numbers = [number for entry in many if (number := _number(entry)) is not None]
    return numbers if len(numbers) == len(many) else None


def is_known(name: str) -> bool:
    """Whether the model or the node has a parameter of that name."""
    return name in OF_NODE or name in Parameters.__dataclass_fields__


def is_unset(value: Any) -> bool:
    """Whether a value in a file means unset: None or an empty list, which has no type in ROS."""
    return value is None or (
        not isinstance(value, str) and hasattr(value, "__len__") and len(value) == 0
    )


def unknown_message(name: str) -> str:
    """Return the message for an unknown parameter name, with the most similar known name."""
    own = {own.lower(): own for own in (*OF_NODE, *core.names())}
    near = difflib.get_close_matches(name[:LONGEST_NAME].lower(), own, n=1, cutoff=ALIKE)
    hint = f"did you mean {own[near[0]]}?" if near else "ros2 param list shows what there is"
    return f"no parameter {name}: {hint}"


def read_by_rclpy(name: str) -> bool:
    """Whether rclpy itself uses the parameter: time, QoS overrides, type descriptions."""
    return name.startswith(("use_sim_time", "qos_overrides.", "start_type_description_service"))


def check(name: str, value: Any) -> None:
    """Check the type and range of a parameter of the node, or the type of one of the model.

    Ranges of model parameters are checked together when ``Parameters`` is made.

    Raises:
        ParameterError: the value is not allowed.
    """
    if name not in OF_NODE:
        core.coerce(name, value)
        return
    default, about = OF_NODE[name]
    kind = type(default)
    if type(value) is not kind and not (kind is float and type(value) is int):
        rule, advice = _KINDS[kind]
        raise ParameterError(f"{name} must be {rule}, got {shown(value)}: {advice}")
    if kind is str:
        if len(value) > LONGEST_TEXT:
            raise ParameterError(
                f"{name} must have at most {LONGEST_TEXT} characters, got {len(value)}: shorten it"
            )
        if name == EFFECTS:
            read_effects(value)
    if kind is not str or about.choices:
        core.check_value(name, value, about)


def gear_of_node(path: Path) -> tuple[Parameters, tuple[Active, ...], list[str]]:
    """Return parameters, effects and warnings of a node that starts with a parameter file.

    Raises:
        ParameterError: the node would not start with the file; the message begins with the file.
    """
    taken: dict[str, Any] = {}
    notes = []
    try:
        for name, value in _dotted(read_values(path)):
            warning = warning_of(name, value)
            if warning:
                notes.append(warning)
            if is_known(name) and not is_unset(value):
                taken[name] = converted(name, value)
                if name != EFFECTS:  # a list of them is turned into a text
                    check(name, taken[name])
        own = {name: value for name, value in taken.items() if name not in OF_NODE}
        effects = {EFFECTS: taken[EFFECTS]} if EFFECTS in taken else {}
        return (*gear_of_values(own | effects), notes)
    except ParameterError as error:
        said = str(error)
        raise ParameterError(said if said.startswith(f"{path}: ") else f"{path}: {said}") from None


def _dotted(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (name, value) pairs, with the names of nested mappings joined by dots as in ROS."""
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from _dotted(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def warning_of(name: str, value: Any) -> str:
    """Return the warning for a value at the start of a node: unknown or unset; else empty."""
    if not is_known(name):
        return "" if read_by_rclpy(name) else f"{unknown_message(name)}; it is ignored"
    if is_unset(value) and default_of(name) != ():
        return (
            f"{name} is empty and has its default {default_of(name)!r}: leave it out, or give a "
            "value (a list of none is [0.0])"
        )
    return ""
