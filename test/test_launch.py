"""The launch file, read as text; and run by the real ``launch`` where that is installed."""

from __future__ import annotations

import ast
import importlib.util
import runpy
from pathlib import Path
from typing import Any

import pytest

from herringbone_sim.core import parameters as core
from herringbone_sim.ros.parameters import OF_NODE, default_of, meaning_of

FILE = Path(__file__).resolve().parents[1] / "launch" / "simulator.launch.py"
ARGUMENTS = {"params_file", "namespace", "record", "rerun", "real_time_factor"}


def calls(name: str) -> list[ast.Call]:
    tree = ast.parse(FILE.read_text(encoding="utf-8"), str(FILE))
    found = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return [call for call in found if isinstance(call.func, ast.Name) and call.func.id == name]


def keyword(call: ast.Call, name: str) -> Any:
    return next((item.value for item in call.keywords if item.arg == name), None)


def literal(node: Any) -> Any:
    return ast.literal_eval(node)


def declared() -> dict[str, ast.Call]:
    return {literal(call.args[0]): call for call in calls("DeclareLaunchArgument")}


def overrides() -> dict[str, ast.Call]:
    """ROS parameter -> its ParameterValue(LaunchConfiguration(argument), value_type=...)."""
    (parameters,) = [keyword(call, "parameters") for call in calls("Node")]
    (table,) = [item for item in parameters.elts if isinstance(item, ast.Dict)]
    return {literal(k): v for k, v in zip(table.keys, table.values, strict=True)}


def test_it_compiles() -> None:
    compile(FILE.read_text(encoding="utf-8"), str(FILE), "exec")


def test_every_argument_has_a_default_and_says_what_it_is() -> None:
    assert set(declared()) == ARGUMENTS
    for name, call in declared().items():
        assert keyword(call, "default_value") is not None, name
        assert len(literal(keyword(call, "description"))) > 20, name


def test_every_argument_is_used_and_every_use_is_declared() -> None:
    assert {literal(call.args[0]) for call in calls("LaunchConfiguration")} == ARGUMENTS


def test_parameters_are_those_of_the_node_with_their_types() -> None:
    assert set(overrides()) == {"record", "mirror", "real_time_factor"}
    for name, call in overrides().items():
        assert name in OF_NODE
        assert keyword(call, "value_type").id == type(default_of(name)).__name__


def test_choices_and_defaults_are_those_that_the_node_takes() -> None:
    assert literal(keyword(declared()["rerun"], "choices")) == list(meaning_of("mirror").choices)
    assert literal(keyword(declared()["rerun"], "default_value")) == default_of("mirror")
    factor = float(literal(keyword(declared()["real_time_factor"], "default_value")))
    assert factor == default_of("real_time_factor")
    assert not set(overrides()) & set(core.names())


def test_the_node_is_the_executable_of_this_package_and_does_not_respawn() -> None:
    (node,) = calls("Node")
    assert literal(keyword(node, "executable")) == "simulator"
    assert literal(keyword(node, "name")) == "herringbone_sim"
    assert literal(keyword(node, "respawn")) is False


def test_the_real_launch_describes_it_where_installed() -> None:
    """Without ``launch`` (it is not on PyPI) the imports must at least be those it has."""
    source = FILE.read_text(encoding="utf-8")
    assert "from launch import LaunchDescription" in source
    if importlib.util.find_spec("launch_ros") is None:
        with pytest.raises(ImportError):
            runpy.run_path(str(FILE))
        return
    from launch.actions import DeclareLaunchArgument  # type: ignore[import-not-found]

    description = runpy.run_path(str(FILE))["generate_launch_description"]()
    arguments = [e for e in description.entities if isinstance(e, DeclareLaunchArgument)]
    assert {argument.name for argument in arguments} == ARGUMENTS
