"""Launch the simulator: ``ros2 launch herringbone_sim simulator.launch.py --show-args``."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue

PACKAGE = "herringbone_sim"
AS_IN_FILE = ""
YES_NO = [AS_IN_FILE, "true", "false"]

# argument, parameter of the node, type, choices, meaning; one that is not given leaves the file be
OF_NODE = (
    ("record", "record", bool, YES_NO, "record a bag with every sample from the first on"),
    (
        "rerun",
        "mirror",
        str,
        [AS_IN_FILE, "off", "spawn", "connect", "serve", "save"],
        "mirror to the Rerun viewer: start one, connect to one, serve to those that connect, or "
        "save to a file",
    ),
    (
        "real_time_factor",
        "real_time_factor",
        float,
        None,
        "simulation over wall time: 1 is the machine's own time, 0.001 is for the eye, 0 is as "
        "fast as possible",
    ),
    ("start_paused", "start_paused", bool, YES_NO, "start paused: wait for resume or step"),
    ("publish_clock", "publish_clock", bool, YES_NO, "publish simulation time on /clock"),
    (
        "use_sim_time",
        "use_sim_time",
        bool,
        YES_NO,
        "stamp diagnostics, regime and parameter events by /clock, as other nodes of a simulation "
        "do; the pace stays that of real_time_factor",
    ),
)


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
                "name", default_value=PACKAGE, description="name of the node, prefix of its topics"
            ),
            DeclareLaunchArgument(
                "log_level",
                default_value="info",
                choices=["debug", "info", "warn", "error", "fatal"],
                description="least severity of what is logged",
            ),
            *(
                DeclareLaunchArgument(
                    argument, default_value=AS_IN_FILE, choices=choices, description=text
                )
                for argument, _, _, choices, text in OF_NODE
            ),
            OpaqueFunction(function=simulator),
        ]
    )


def simulator(context: LaunchContext) -> list[Node]:
    """The node; one that ends is not started again, as its recording would be a new one."""
    given = {
        parameter: ParameterValue(LaunchConfiguration(argument), value_type=kind)
        for argument, parameter, kind, _, _ in OF_NODE
        if LaunchConfiguration(argument).perform(context) != AS_IN_FILE
    }
    file = ParameterFile(LaunchConfiguration("params_file"), allow_substs=True)
    return [
        Node(
            package=PACKAGE,
            executable="simulator",
            name=LaunchConfiguration("name"),
            namespace=LaunchConfiguration("namespace"),
            parameters=[file, given] if given else [file],
            ros_arguments=["--log-level", LaunchConfiguration("log_level")],
            output="screen",
            emulate_tty=True,
            respawn=False,
        )
    ]
