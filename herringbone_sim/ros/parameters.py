"""ROS parameters of the node: those of the model (``core.parameters``) and of the node alone."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
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
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.node_parameters import (
    OF_NODE,
    check,
    converted,
    default_of,
    is_known,
    is_unset,
    meaning_of,
    warning_of,
)
from herringbone_sim.recording.parameter_file import EFFECTS

TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
    tuple: ParameterType.PARAMETER_DOUBLE_ARRAY,
}


def path_of(name: str, text: str) -> Path:
    """Path in a parameter, with ``~`` replaced by the home folder.

    Raises:
        RecordingError: the home folder of an unknown user.
    """
    try:
        return Path(text).expanduser()
    except RuntimeError as error:
        raise RecordingError(f"{name} {text!r}: {error}") from error


def descriptor(name: str) -> ParameterDescriptor:
    """Descriptor of a parameter (type, unit, meaning, range) for ``ros2 param describe``."""
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


def adapted(parameter: Parameter) -> Parameter:
    """The parameter converted to its declared type, where a ROS tool sent another type."""
    name = parameter.name
    value = converted(name, parameter.value)
    if value is parameter.value:
        return parameter
    return Parameter(name, Parameter.Type(TYPES[type(default_of(name))]), value)


def declare(node: Node) -> None:
    """Declare all parameters with their overrides; an empty override leaves the default.

    An override of an unknown name is ignored; warnings are logged.

    Raises:
        ParameterError: an override of the wrong type, or outside its range.
    """
    overrides = node._parameter_overrides
    for name, override in list(overrides.items()):
        warning = warning_of(name, override.value)
        if warning:
            node.get_logger().warning(warning)
        if not is_known(name):
            continue
        if is_unset(override.value):
            del overrides[name]
        else:
            overrides[name] = adapted(override)
            check(name, overrides[name].value)
    for name in (*core.names(), *OF_NODE):
        value, about = default_of(name), descriptor(name)
        if value == () and name not in overrides:
            _declare_empty(node, about)
        else:
            first = list(value or [0.0]) if isinstance(value, tuple) else value
            node.declare_parameter(name, first, about)


def _declare_empty(node: Node, about: ParameterDescriptor) -> None:
    """Declare a parameter that is an empty list of numbers.

    It gets a number first, as rclpy infers the type from the first value.
    """
    node.declare_parameter(about.name, [0.0])
    node.set_parameters([Parameter(about.name, Parameter.Type.DOUBLE_ARRAY, [])])
    node.set_descriptor(about.name, about)


def read_model(node: Node) -> Parameters:
    """Read the model's parameters from the node; ParameterError if no gear can have them."""
    return core.from_mapping({name: node.get_parameter(name).value for name in core.names()})


def read_actives(node: Node) -> tuple[Active, ...]:
    """Read the effects from the node's parameters; ParameterError for an unknown effect."""
    return read_effects(node.get_parameter(EFFECTS).value)


def is_unchanged(node: Node, parameter: Parameter) -> bool:
    """Whether a parameter is read-only and is to be set to the value that it has already."""
    if not node.describe_parameter(parameter.name).read_only:
        return False
    now = node.get_parameter(parameter.name)
    if hasattr(now.value, "__len__") and hasattr(parameter.value, "__len__"):
        return list(now.value) == list(parameter.value)
    return bool(now.type_ == parameter.type_ and now.value == parameter.value)


def plain(parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Values of ROS parameters by name."""
    return {p.name: p.value for p in parameters}
