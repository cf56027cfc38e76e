"""The launch file, run with stand-ins for ``launch``; by the real one where that is installed."""

from __future__ import annotations

import importlib.util
import runpy
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from herringbone_sim.core import parameters as core
from herringbone_sim.recording.node_parameters import OF_NODE, default_of, meaning_of

FILE = Path(__file__).resolve().parents[2] / "launch" / "simulator.launch.py"
PLAIN = {"params_file", "namespace", "name", "log_level"}
TO_NODE = {
    "record": "record",
    "rerun": "mirror",
    "real_time_factor": "real_time_factor",
    "start_paused": "start_paused",
    "publish_clock": "publish_clock",
    "use_sim_time": "use_sim_time",
}


class Made:
    """Stands for anything that launch makes: keeps what it was made of."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.args, self.kwargs = args, kwargs

    def perform(self, context: Mapping[str, str]) -> str:
        return context[self.args[0]]


MODULES = {
    "launch": ("LaunchContext", "LaunchDescription"),
    "launch.actions": ("DeclareLaunchArgument", "OpaqueFunction"),
    "launch.substitutions": ("LaunchConfiguration",),
    "launch_ros": (),
    "launch_ros.actions": ("Node",),
    "launch_ros.parameter_descriptions": ("ParameterFile", "ParameterValue"),
    "ament_index_python": (),
    "ament_index_python.packages": (),
}


@pytest.fixture
def content(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Names of the launch file, where every class of launch is a kind of ``Made``."""
    for name, classes in MODULES.items():
        module = ModuleType(name)
        for one in classes:
            setattr(module, one, type(one, (Made,), {}))
        monkeypatch.setitem(sys.modules, name, module)
    packages = sys.modules["ament_index_python.packages"]
    packages.get_package_share_directory = lambda name: f"/share/{name}"  # type: ignore[attr-defined]
    return runpy.run_path(str(FILE))


def declared(content: dict[str, Any]) -> dict[str, dict[str, Any]]:
    (entities,) = content["generate_launch_description"]().args
    return {e.args[0]: e.kwargs for e in entities if type(e).__name__ == "DeclareLaunchArgument"}


def node(content: dict[str, Any], **given: str) -> dict[str, Any]:
    """What the node is made of when some arguments are given."""
    (entities,) = content["generate_launch_description"]().args
    (function,) = [e.kwargs["function"] for e in entities if type(e).__name__ == "OpaqueFunction"]
    defaults = {name: about["default_value"] for name, about in declared(content).items()}
    (made,) = function(defaults | given)
    kwargs: dict[str, Any] = made.kwargs
    return kwargs


def test_every_argument_has_a_default_and_says_what_it_is(content: dict[str, Any]) -> None:
    assert set(declared(content)) == PLAIN | set(TO_NODE)
    for name, about in declared(content).items():
        assert about["default_value"] is not None, name
        assert len(about["description"]) > 20, name
        assert about.get("choices") is None or about["default_value"] in about["choices"]


def test_a_file_stands_where_no_argument_is_given(content: dict[str, Any]) -> None:
    """A file with ``record: true`` records; launch once put its own default over it."""
    (file,) = node(content)["parameters"]
    assert file.args[0].args == ("params_file",)


@pytest.mark.parametrize("argument", sorted(TO_NODE))
def test_an_argument_is_a_parameter_of_its_type(content: dict[str, Any], argument: str) -> None:
    _, given = node(content, **{argument: "1"})["parameters"]
    ((parameter, value),) = given.items()
    assert parameter == TO_NODE[argument]
    assert value.args[0].args == (argument,)
    if parameter in OF_NODE:
        assert value.kwargs["value_type"] is type(default_of(parameter))
    else:
        assert (parameter, value.kwargs["value_type"]) == ("use_sim_time", bool)
    assert parameter not in core.names()


def test_choices_are_those_that_the_node_takes(content: dict[str, Any]) -> None:
    assert declared(content)["rerun"]["choices"][1:] == list(meaning_of("mirror").choices)


def test_the_node_is_the_executable_of_this_package_and_does_not_respawn(
    content: dict[str, Any],
) -> None:
    made = node(content)
    assert made["executable"] == "simulator"
    assert made["package"] == "herringbone_sim"
    assert [made[key].args[0] for key in ("name", "namespace")] == ["name", "namespace"]
    assert declared(content)["name"]["default_value"] == "herringbone_sim"
    option, level = made["ros_arguments"]
    assert (option, level.args[0]) == ("--log-level", "log_level")
    assert made["respawn"] is False


def test_the_real_launch_describes_it_where_installed() -> None:
    """``launch`` is not on PyPI."""
    if importlib.util.find_spec("launch_ros") is None:
        with pytest.raises(ImportError):
            runpy.run_path(str(FILE))
        return
    from launch.actions import DeclareLaunchArgument  # type: ignore[import-not-found]

    description = runpy.run_path(str(FILE))["generate_launch_description"]()
    arguments = [e for e in description.entities if isinstance(e, DeclareLaunchArgument)]
    assert {argument.name for argument in arguments} == PLAIN | set(TO_NODE)
