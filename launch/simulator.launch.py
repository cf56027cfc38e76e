"""Launch the simulator: ``ros2 launch herringbone_sim simulator.launch.py --show-args``."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue

PACKAGE = "herringbone_sim"


def generate_launch_description() -> LaunchDescription:
    """The simulator with a parameter file; arguments given here win over the file."""
    rig = Path(get_package_share_directory(PACKAGE)) / "config" / "rig.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file",
                default_value=str(rig),
                description="YAML file with the parameters of the gear and of the node",
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="namespace of the node, as gear_1"
            ),
            DeclareLaunchArgument(
                "record",
                default_value="false",
                choices=["true", "false"],
                description="record a bag with every sample from the first on",
            ),
            DeclareLaunchArgument(
                "rerun",
                default_value="off",
                choices=["off", "spawn", "connect", "serve", "save"],
                description="mirror to the Rerun viewer: start one, connect to one, serve to "
                "those that connect, or save to a file",
            ),
            DeclareLaunchArgument(
                "real_time_factor",
                default_value="1.0",
                description="simulation over wall time: 1 is the machine's own time, "
                "0.001 is for the eye, 0 is as fast as possible",
            ),
            simulator(),
        ]
    )


def simulator() -> Node:
    """The node; one that ends is not started again, as its recording would be a new one."""
    return Node(
        package=PACKAGE,
        executable="simulator",
        name="herringbone_sim",
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            ParameterFile(LaunchConfiguration("params_file"), allow_substs=True),
            {
                "record": ParameterValue(LaunchConfiguration("record"), value_type=bool),
                "mirror": ParameterValue(LaunchConfiguration("rerun"), value_type=str),
                "real_time_factor": ParameterValue(
                    LaunchConfiguration("real_time_factor"), value_type=float
                ),
            },
        ],
        output="screen",
        emulate_tty=True,
        respawn=False,
    )
