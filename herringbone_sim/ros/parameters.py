"""ROS parameters from the one table in ``core.parameters``, and those of the node itself."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from herringbone_sim.core import parameters as core
from herringbone_sim.core.parameters import Meaning, Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import EFFECTS

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
    "publish_clock": (False, Meaning("-", "publish /clock, unless another node does")),
    "mirror": (
        "off",
        Meaning(
            "-",
            "Rerun viewer: off, spawn, connect, serve, save",
            choices=("off", "spawn", "connect", "serve", "save"),
        ),
    ),
    "mirror_address": ("", Meaning("-", "HOST:PORT of the viewer, or PORT to serve at")),
    "mirror_path": ("mirror.rrd", Meaning("-", "file that the mirror saves to")),
    "mirror_memory": ("1GB", Meaning("-", "memory limit of the viewer")),
}

TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
    tuple: ParameterType.PARAMETER_DOUBLE_ARRAY,
}


def default_of(name: str) -> Any:
    """Default value of a parameter of the model or of the node."""
    if name in OF_NODE:
        return OF_NODE[name][0]
    return Parameters.__dataclass_fields__[name].default


def meaning_of(name: str) -> Meaning:
    """Unit, text and range of a parameter of the model or of the node."""
    return OF_NODE[name][1] if name in OF_NODE else core.meaning(name)


def descriptor(name: str) -> ParameterDescriptor:
    """What ``ros2 param describe`` shows."""
    about = meaning_of(name)
    kind = type(default_of(name))
    unit = "" if about.unit == "-" else f" [{about.unit}]"
    result = ParameterDescriptor(
        name=name,
        type=TYPES[kind],
        description=f"{about.text}{unit}",
        additional_constraints=f"one of {', '.join(about.choices)}" if about.choices else "",
        read_only=not about.live,
    )
    if kind is float and math.isfinite(about.low) and math.isfinite(about.high):
        limits = FloatingPointRange(from_value=about.low, to_value=about.high, step=0.0)
        result.floating_point_range = [limits]
    if kind is int and math.isfinite(about.low) and math.isfinite(about.high):
        whole = IntegerRange(from_value=int(about.low), to_value=int(about.high), step=1)
        result.integer_range = [whole]
    return result


def as_double(parameter: Parameter) -> Parameter:
    """The parameter, with integers as doubles where a double is meant (``ros2 param set K 1``)."""
    kind = type(default_of(parameter.name)) if known(parameter.name) else None
    if kind is float and parameter.type_ == Parameter.Type.INTEGER:
        return Parameter(parameter.name, Parameter.Type.DOUBLE, float(parameter.value))
    numbers = (Parameter.Type.INTEGER_ARRAY, Parameter.Type.INTEGER, Parameter.Type.DOUBLE)
    if kind is tuple and parameter.type_ in numbers:
        value = parameter.value
        many = list(value) if parameter.type_ == Parameter.Type.INTEGER_ARRAY else [value]
        return Parameter(parameter.name, Parameter.Type.DOUBLE_ARRAY, [float(v) for v in many])
    return parameter


def known(name: str) -> bool:
    """Whether a parameter is one of the model or of this node."""
    return name in OF_NODE or name in Parameters.__dataclass_fields__


def declare(node: Node) -> None:
    """Declare all parameters, with integers in overrides taken for doubles.

    Raises:
        ParameterError: an override of the wrong type, outside its range, or unknown.
    """
    overrides = node._parameter_overrides
    for name in [name for name in overrides if known(name)]:
        overrides[name] = as_double(overrides[name])
        check(name, overrides[name].value)
    strangers = [name for name in overrides if not known(name) and not foreign(name)]
    if strangers:
        raise ParameterError(
            f"no parameter {', '.join(sorted(strangers))}: ros2 param list, or config/rig.yaml, "
            "shows what there is"
        )
    for name in (*core.names(), *OF_NODE):
        value = default_of(name)
        about = descriptor(name)
        if isinstance(value, tuple) and not value:
            about.dynamic_typing = False
            initial = overrides.get(name) or Parameter(name, Parameter.Type.DOUBLE_ARRAY, [])
            node.declare_parameter(name, initial.value or [], about, ignore_override=True)
        else:
            node.declare_parameter(name, list(value) if isinstance(value, tuple) else value, about)


def foreign(name: str) -> bool:
    """Parameters that rclpy itself reads: time, QoS overrides, type descriptions."""
    return name.startswith(("use_sim_time", "qos_overrides.", "start_type_description_service"))


def check(name: str, value: Any) -> None:
    """Check one value of the node; those of the model are checked as a set when it is built.

    Raises:
        ParameterError: what is wrong with it.
    """
    if name not in OF_NODE:
        core.coerce(name, value)
        return
    default, about = OF_NODE[name]
    if isinstance(default, str):
        if not isinstance(value, str):
            raise ParameterError(f"{name} must be a text, got {value!r}: put it in quotes")
        if name == EFFECTS:
            read_effects(value)
        if about.choices and value not in about.choices:
            raise ParameterError(
                f"{name} must be one of {', '.join(about.choices)}, got {value!r}"
            )
        return
    if isinstance(default, bool) or isinstance(value, (str, bool)):
        if type(default) is not type(value):
            kind = type(default).__name__
            raise ParameterError(f"{name} must be {kind}, got {value!r}: see ros2 param describe")
        return
    if not math.isfinite(value) or not about.low <= value <= about.high:
        raise ParameterError(
            f"{name} [{about.unit}] must be finite and lie in {about.low:g} .. {about.high:g}, "
            f"got {value!r}"
        )


def read_model(node: Node) -> Parameters:
    """The model's parameters as declared; ParameterError as when built."""
    return core.from_mapping({name: node.get_parameter(name).value for name in core.names()})


def read_actives(node: Node) -> tuple[Active, ...]:
    """The effects as declared; ParameterError when there are none such."""
    return read_effects(node.get_parameter(EFFECTS).value)


def plain(parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Names and plain values of ROS parameters."""
    return {p.name: p.value for p in parameters}
