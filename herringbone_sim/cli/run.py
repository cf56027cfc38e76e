"""``run``: the ROS 2 node."""

from __future__ import annotations

import argparse

DESCRIPTION = """\
Start the simulator node. All after --ros-args goes to ROS 2, for example

  python -m herringbone_sim run --ros-args --params-file config/paper.yaml -p record:=true

The parameters, with unit, meaning and range: python -m herringbone_sim parameters
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``run``."""
    parser = subparsers.add_parser(
        "run",
        help="start the simulator node (needs ROS 2, also from PyPI)",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(func=run, rest=[])


def run(args: argparse.Namespace) -> int:
    """Exit code of the node."""
    try:
        from herringbone_sim.ros.main import main
    except ImportError as error:
        print(
            f"no ROS 2 here ({error}): source /opt/ros/jazzy/setup.bash, or "
            "pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces"
        )
        return 2
    return main(["herringbone_sim", *args.rest])
