"""Message types of a recording as rosbag2 stores them: definition, type hash, QoS profile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import yaml

_SEPARATOR = "=" * 80
_TIME = "builtin_interfaces/Time"

_DEFINITIONS = {
    _TIME: "int32 sec\nuint32 nanosec",
    "rcl_interfaces/Parameter": "string name\nrcl_interfaces/ParameterValue value",
    "rcl_interfaces/ParameterEvent": (
        "builtin_interfaces/Time stamp\n"
        "string node\n"
        "rcl_interfaces/Parameter[] new_parameters\n"
        "rcl_interfaces/Parameter[] changed_parameters\n"
        "rcl_interfaces/Parameter[] deleted_parameters"
    ),
    "rcl_interfaces/ParameterValue": (
        "uint8 type\n"
        "bool bool_value\n"
        "int64 integer_value\n"
        "float64 double_value\n"
        "string string_value\n"
        "byte[] byte_array_value\n"
        "bool[] bool_array_value\n"
        "int64[] integer_array_value\n"
        "float64[] double_array_value\n"
        "string[] string_array_value"
    ),
    "sensor_msgs/JointState": (
        "std_msgs/Header header\n"
        "string[] name\n"
        "float64[] position\n"
        "float64[] velocity\n"
        "float64[] effort"
    ),
    "std_msgs/Float64MultiArray": "std_msgs/MultiArrayLayout layout\nfloat64[] data",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
    "std_msgs/String": "string data",
}


def _text(root: str, *dependencies: str) -> str:
    """Return the ros2msg definition of a type, followed by those of its dependencies."""
    parts = [f"{_DEFINITIONS[root]}\n"]
    parts += [f"{_SEPARATOR}\nMSG: {name}\n{_DEFINITIONS[name]}\n" for name in dependencies]
    return "".join(parts)


@dataclass(frozen=True)
class MessageType:
    """A message type of ROS 2.

    Attributes:
        name: as in ``std_msgs/msg/String``.
        text: ros2msg definition, followed by those of all types it depends on.
        type_hash: RIHS01 hash of the type description.
    """

    name: str
    text: str
    type_hash: str


STRING = MessageType(
    "std_msgs/msg/String",
    _text("std_msgs/String"),
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
)
FLOAT64_MULTI_ARRAY = MessageType(
    "std_msgs/msg/Float64MultiArray",
    _text(
        "std_msgs/Float64MultiArray", "std_msgs/MultiArrayLayout", "std_msgs/MultiArrayDimension"
    ),
    "RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
)
JOINT_STATE = MessageType(
    "sensor_msgs/msg/JointState",
    _text("sensor_msgs/JointState", "std_msgs/Header", _TIME),
    "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
)
PARAMETER_EVENT = MessageType(
    "rcl_interfaces/msg/ParameterEvent",
    _text(
        "rcl_interfaces/ParameterEvent",
        _TIME,
        "rcl_interfaces/Parameter",
        "rcl_interfaces/ParameterValue",
    ),
    "RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204",
)

_FOREVER = {"sec": 9223372036, "nsec": 854775807}


def qos_profile(depth: int, latched: bool = False) -> dict[str, Any]:
    """Return a reliable keep-last QoS profile under the keys of rosbag2 metadata version 9.

    ``latched`` makes it transient local: a late subscriber gets the last message.
    """
    return {
        "history": "keep_last",
        "depth": depth,
        "reliability": "reliable",
        "durability": "transient_local" if latched else "volatile",
        "deadline": dict(_FOREVER),
        "lifespan": dict(_FOREVER),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(_FOREVER),
        "avoid_ros_namespace_conventions": False,
    }


def dump_yaml(content: object) -> str:
    """Return content as YAML in block style, keys in their order, like that of rosbag2."""
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=False, width=10_000)
