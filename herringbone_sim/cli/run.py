"""``run``: the ROS 2 node."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from herringbone_sim.cli.options import NO_ROS, add_file
from herringbone_sim.recording.parameter_file import ros_text
from herringbone_sim.version import VERSION

DESCRIPTION = """\
Start the simulator node; Ctrl-C ends it. All after --ros-args goes to ROS 2. The parameters, with
unit, meaning and range, are listed by the verb `parameters`.
"""
EXAMPLES = """\
python -m herringbone_sim run
python -m herringbone_sim run --ros-args -p record:=true -p record_name:=first
python -m herringbone_sim run --parameters config/paper.yaml --ros-args \\
    -p "effects:='tooth_crack@sp:depth=0.3,member=sun'"
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    text = "parameter file, also with effects as a list; what follows --ros-args wins"
    add_file(parser, "--parameters", text)
    parser.add_argument("--version", action="version", version=VERSION)
    parser.set_defaults(of_ros=[])


def run(args: argparse.Namespace) -> int:
    """Run the node until it ends; its exit code, 2 without ROS."""
    try:
        from herringbone_sim.ros.main import main
    except ImportError as error:
        print(NO_ROS.format(error=error))
        return 2
    if args.parameters is None:
        return main(["herringbone_sim", *args.of_ros])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "parameters.yaml"
        file.write_text(ros_text(args.parameters), encoding="utf-8")
        of_file = ["--ros-args", "--params-file", str(file), "--"]
        return main(["herringbone_sim", *of_file, *args.of_ros])
