"""The package as ament, colcon, pip and ROS see it."""

from __future__ import annotations

import ast
import importlib
import runpy
import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import setuptools

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


def distribution() -> Any:
    """What setup.py says, without building anything."""
    said: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(setuptools, "setup", lambda **values: said.update(values))
        runpy.run_path(str(ROOT / "setup.py"))
    return SimpleNamespace(**said)


def entry_points() -> list[str]:
    found: list[str] = distribution().entry_points["console_scripts"]
    return found


def test_version_is_the_same_everywhere() -> None:
    assert manifest().findtext("version") == __version__
    assert (distribution().name, distribution().version) == ("herringbone_sim", __version__)
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
    assert names == ["simulator", "analyze", "gap", "chaos_control"]


@pytest.mark.parametrize("entry", entry_points())
def test_every_executable_leads_to_a_function(entry: str) -> None:
    module, _, function = entry.partition(" = ")[2].partition(":")
    assert callable(getattr(importlib.import_module(module), function))


def test_the_marker_of_the_ament_index_is_there() -> None:
    assert (ROOT / "resource" / "herringbone_sim").is_file()


def test_share_holds_what_ros_users_look_for() -> None:
    shared = {name for _, names in distribution().data_files for name in names}
    assert shared >= {
        "package.xml",
        "resource/herringbone_sim",
        "launch/simulator.launch.py",
        "config/rig.yaml",
        "config/paper.yaml",
        "config/plotjuggler.xml",
        "config/foxglove.json",
    }
    assert all((ROOT / name).is_file() for name in shared)


def test_tests_are_not_installed() -> None:
    assert all(name.startswith("herringbone_sim") for name in distribution().packages)


def test_ros_stays_an_extra_for_pip() -> None:
    found = distribution()
    assert not [line for line in found.install_requires if line.startswith("ros-")]
    assert [line for line in found.extras_require["ros"] if "rclpy[fastrtps]" in line]
    assert [line for line in found.install_requires if line.startswith("rerun-sdk==0.41.*")]
