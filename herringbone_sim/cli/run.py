"""Start the simulator node; Ctrl-C ends it. All after --ros-args goes to ROS 2. The parameters,
with unit, meaning and range, are listed by the verb `parameters`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from herringbone_sim.cli.options import NO_ROS, File
from herringbone_sim.recording.parameter_file import ros_text
from herringbone_sim.version import VERSION

EXAMPLES = """\
python -m herringbone_sim run
python -m herringbone_sim run --ros-args -p record:=true -p record_name:=first
python -m herringbone_sim run --parameters config/paper.yaml --ros-args \\
    -p "effects:='tooth_crack@sp:depth=0.3,member=sun'"
"""


def run(
    *,
    parameters: Annotated[
        File | None, "parameter file, also with effects as a list; what follows --ros-args wins"
    ] = None,
    version: Annotated[bool, "print the version instead"] = False,
    of_ros: Annotated[Sequence[str], Parameter(parse=False)] = (),
) -> int:
    """Run the simulator node until it ends and return its exit code; 2 without ROS."""
    if version:
        print(VERSION)
        return 0
    try:
        from herringbone_sim.ros.main import main
    except ImportError as error:
        print(NO_ROS.format(error=error))
        return 2
    if parameters is None:
        return main(["herringbone_sim", *of_ros])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "parameters.yaml"
        file.write_text(ros_text(parameters), encoding="utf-8")
        of_file = ["--ros-args", "--params-file", str(file), "--"]
        return main(["herringbone_sim", *of_file, *of_ros])
