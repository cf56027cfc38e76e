"""The package as ament, colcon, pip and ROS see it."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from herringbone_sim import __version__

ROOT = Path(__file__).resolve().parents[1]
ROS_PACKAGES = {
    "rclpy",
    "builtin_interfaces",
    "diagnostic_msgs",
    "rcl_interfaces",
    "rosgraph_msgs",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
}


def manifest() -> ET.Element:
    return ET.parse(ROOT / "package.xml").getroot()


def setup_says(*questions: str) -> list[str]:
    out = subprocess.run(
        [sys.executable, "setup.py", "--quiet", *questions],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return out.stdout.split()


def entry_points() -> list[str]:
    """Entry points as written in setup.py, with its NAME filled in."""
    tree = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8"))
    joined = [node for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)]
    texts = [ast.unparse(node)[2:-1].replace("{NAME}", "herringbone_sim") for node in joined]
    return [text for text in texts if " = " in text]


def test_version_is_the_same_everywhere() -> None:
    assert manifest().findtext("version") == __version__
    assert setup_says("--name", "--version") == ["herringbone_sim", __version__]
    assert f"\n{__version__} " in (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")


def test_manifest_is_an_ament_python_package_of_format_3() -> None:
    root = manifest()
    assert root.get("format") == "3"
    assert root.findtext("name") == "herringbone_sim"
    assert root.findtext("export/build_type") == "ament_python"
    assert root.findtext("license") == "Apache-2.0"
    assert "Apache License" in (ROOT / "LICENSE").read_text(encoding="utf-8")


def test_manifest_names_every_ros_package_that_is_imported() -> None:
    imported = set()
    for path in (ROOT / "herringbone_sim").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                imported.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
    declared = {element.text for element in manifest().iter("exec_depend")}
    messages = {name for name in imported if name.endswith(("_msgs", "_srvs", "_interfaces"))}
    assert messages | (imported & {"rclpy"}) <= declared
    assert declared >= ROS_PACKAGES


def test_executables_of_ros2_run() -> None:
    names = [entry.partition(" = ")[0] for entry in entry_points()]
    assert names == ["simulator", "analyze", "chaos_control"]


@pytest.mark.parametrize("entry", entry_points())
def test_every_executable_leads_to_a_function(entry: str) -> None:
    module, _, function = entry.partition(" = ")[2].partition(":")
    assert callable(getattr(importlib.import_module(module), function))


def test_the_marker_of_the_ament_index_is_there() -> None:
    assert (ROOT / "resource" / "herringbone_sim").is_file()
