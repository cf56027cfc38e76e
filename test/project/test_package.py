"""The package as ament, colcon, pip and ROS see it."""

from __future__ import annotations

import ast
import importlib
import runpy
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import setuptools
import yaml
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.changelog_generator import FORTHCOMING_LABEL
from catkin_pkg.package import parse_package
from catkin_pkg.package_version import get_forthcoming_label, rename_section

from herringbone_sim import __version__
from herringbone_sim.__main__ import EXECUTABLES, VERBS

# Where the key of rosdep is not python3-NAME, and where the name for pip is another.
ROSDEP = {
    "catkin_pkg": "python3-catkin-pkg-modules",
    "mcap": "mcap-ros2-support",
    "mcap_ros2": "mcap-ros2-support",
    "rosbags": "python3-rosbags-pip",
}
BY_PIP = {"rerun": "rerun-sdk"}
ROOT = Path(__file__).resolve().parents[2]
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


def packed(folder: Path) -> set[str]:
    """Files of an sdist, as setuptools lists them before it packs them."""
    words = [sys.executable, "setup.py", "-q", "egg_info", "--egg-base", str(folder)]
    subprocess.run(words, cwd=ROOT, check=True, capture_output=True)
    return set((folder / "herringbone_sim.egg-info" / "SOURCES.txt").read_text().splitlines())


def entry_points() -> list[str]:
    found: list[str] = distribution().entry_points["console_scripts"]
    return found


def test_version_is_the_same_everywhere() -> None:
    assert manifest().findtext("version") == __version__
    assert (distribution().name, distribution().version) == ("herringbone_sim", __version__)
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (cited["title"], cited["version"]) == ("herringbone_sim", __version__)
    assert cited["license"] == distribution().license == manifest().findtext("license")


def test_the_changelog_becomes_that_of_a_release_as_ros_tools_do_it(tmp_path: Path) -> None:
    """As ``catkin_prepare_release``: find what is to come, name it, and read it again."""
    text = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    assert get_forthcoming_label(text) == FORTHCOMING_LABEL
    path = tmp_path / "CHANGELOG.rst"
    path.write_text(rename_section(text, FORTHCOMING_LABEL, f"{__version__} (2026-01-31)"))
    released = get_changelog_from_path(str(path), "herringbone_sim")
    assert [heading for heading, _, _ in released.foreach_version()] == [__version__]
    (bullets,) = released.get_content_of_version(__version__)
    assert len(list(bullets)) > 20


def test_the_manifest_is_one_that_ros_tools_read() -> None:
    found: list[str] = []
    package = parse_package(str(ROOT / "package.xml"), warnings=found)
    package.validate(warnings=found)
    assert found == []
    assert package.urls
    assert package.authors
    assert all(url.url.startswith("https://") for url in package.urls)


def test_manifest_is_an_ament_python_package_of_format_3() -> None:
    root = manifest()
    assert root.get("format") == "3"
    assert root.findtext("name") == "herringbone_sim"
    assert root.findtext("export/build_type") == "ament_python"
    assert root.findtext("license") == "Apache-2.0"
    assert "Apache License" in (ROOT / "LICENSE").read_text(encoding="utf-8")


def test_manifest_names_every_ros_package_that_is_imported() -> None:
    imported = imported_by((ROOT / "herringbone_sim").rglob("*.py"))
    declared = {element.text for element in manifest().iter("exec_depend")}
    messages = {name for name in imported if name.endswith(("_msgs", "_srvs", "_interfaces"))}
    assert messages | (imported & {"rclpy"}) <= declared
    assert declared >= ROS_PACKAGES


def imported_by(paths: Iterable[Path]) -> set[str]:
    """Top names of all that files import."""
    found = set()
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
    return found


def test_what_the_tests_import_is_installed_by_what_is_documented() -> None:
    """``rosdep install`` and the line of pip in docs/ros2.md, before ``colcon test``."""
    tests = list((ROOT / "test").rglob("*.py"))
    own = {path.stem for path in tests} | {"herringbone_sim", "benchmarks", "faults"}
    others = imported_by(tests) - own - set(sys.stdlib_module_names)
    declared = {
        element.text
        for kind in ("exec_depend", "test_depend")
        for element in manifest().iter(kind)
    }
    installed = (ROOT / "docs" / "ros2.md").read_text(encoding="utf-8")
    lacking = {
        name
        for name in others
        if name not in declared
        and ROSDEP.get(name, f"python3-{name}") not in declared
        and f"{BY_PIP.get(name, name)}" not in installed
    }
    assert lacking == set()
    assert "python3-pytest-timeout" in declared  # pytest knows the option `timeout` by it


def test_executables_of_ros2_run() -> None:
    names = [entry.partition(" = ")[0] for entry in entry_points()]
    assert names == [
        "herringbone_sim",
        *("simulator", "analyze", "gap", "info", "recover", "replay", "show"),
        "chaos_control",
    ]
    assert {EXECUTABLES.get(name, name) for name in names[1:-1]} <= set(VERBS)


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


def test_an_sdist_holds_what_setup_py_reads_and_what_the_tests_need(tmp_path: Path) -> None:
    found = distribution()
    shared = {name for _, names in found.data_files for name in names}
    data = {
        str(path.relative_to(ROOT))
        for package, names in found.package_data.items()
        for name in names
        for path in ROOT.joinpath(*package.split(".")).glob(name)
    }
    assert "herringbone_sim/views/pages/templates/gap.html" in data
    wanted = {str(path.relative_to(ROOT)) for path in ROOT.glob("requirements*.txt")}
    wanted |= {"README.md", "LICENSE", "CHANGELOG.rst", "CITATION.cff", "CONTRIBUTING.md"}
    wanted |= {"herringbone_sim/version.py", "test/data/evidence.jsonl", "scripts/setup.sh"}
    there = packed(tmp_path)
    assert wanted | shared | data <= there
    for folder in ("herringbone_sim", "test", "docs", "benchmarks"):
        files = ROOT.joinpath(folder).rglob("*.[pm][yd]")
        assert {str(path.relative_to(ROOT)) for path in files} <= there


def test_the_page_of_a_release_is_the_readme() -> None:
    found = distribution()
    assert found.long_description == (ROOT / "README.md").read_text(encoding="utf-8")
    assert found.long_description_content_type == "text/markdown"
    supported = [c.rpartition(" ")[2] for c in found.classifiers if ":: 3." in c]
    assert supported == ["3.10", "3.11", "3.12", "3.13"]


def test_hooks_of_pre_commit_are_the_quick_checks_of_the_suite() -> None:
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    (local,) = yaml.safe_load(text)["repos"]
    assert local["repo"] == "local"  # nothing is fetched
    commands = {
        hook["entry"].removeprefix(".venv/bin/").split(" --")[0] for hook in local["hooks"]
    }
    suite = (ROOT / "scripts" / "test.sh").read_text(encoding="utf-8")
    assert commands == {"ruff check", "ruff format", "mypy", "lint-imports"}
    assert all(f'" {command}' in suite for command in commands)


def test_tests_are_not_installed() -> None:
    assert all(name.startswith("herringbone_sim") for name in distribution().packages)


def test_ros_stays_an_extra_for_pip() -> None:
    found = distribution()
    assert not [line for line in found.install_requires if line.startswith("ros-")]
    assert [line for line in found.extras_require["ros"] if "rclpy[fastrtps]" in line]
    assert [line for line in found.install_requires if line.startswith("rerun-sdk==0.41.*")]


# Decorators of compiled code: those of ``core/packed.py``, and Numba's own.
COMPILED = {"compiled", "inlined", "called", "exposed", "embedded", "law", "njit"}


def test_files_and_signatures_stay_short() -> None:
    """300 lines a file, unless its docstring says why; seven arguments, in compiled code more."""
    for path in (ROOT / "herringbone_sim").rglob("*.py"):
        text = path.read_text()
        tree = ast.parse(text)
        reason = "Over 300 lines" in (ast.get_docstring(tree) or "")
        assert len(text.splitlines()) <= 300 or reason, path
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                every = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
                names = [argument.arg for argument in every if argument.arg not in ("self", "cls")]
                marks = {ast.unparse(mark).partition("(")[0] for mark in node.decorator_list}
                assert len(names) <= 7 or marks & COMPILED, (path, node.name)
