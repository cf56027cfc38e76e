"""PlotJuggler and Foxglove layouts: well-formed, and about topics and fields that there are."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gears import make

from herringbone_sim.analysis.monitor import RegimeMonitor
from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.layout import Layout
from herringbone_sim.ros.streams import regime_status
from herringbone_sim.runtime import Delivery

CONFIG = Path(__file__).resolve().parents[2] / "config"
NODE = "/herringbone_sim"
LAYOUT = Layout(n_classes=1, numbered=False)
FIELDS = {"position": "x", "velocity": "v", "effort": "F"}
SECTION = ("t", "phase", *(f"{a}_{m}" for a in "xv" for m in LAYOUT.meshes))
TOPICS = {f"{NODE}/{name}" for name in ("state", "samples", "section", "regime")}
TOPICS.add("/diagnostics")
SERVICES = {
    f"{NODE}/{name}"
    for name in ("pause", "resume", "step", "reset", "record/start", "record/stop")
}


@pytest.fixture(scope="module")
def regime_keys() -> set[str]:
    model = make()
    stepper = Stepper(model)
    block = stepper.advance(stepper.start(tangents=1), 64)
    monitor = RegimeMonitor()
    monitor.update(block, model)
    delivery = Delivery(model=model, block=block, changes=(), restarted=False)
    status = regime_status(NODE, monitor.regime(model), model, delivery)
    assert (status.name, status.hardware_id) == (f"{NODE}: regime", NODE)
    return {value.key for value in status.values}


def plotjuggler() -> ET.Element:
    return ET.parse(CONFIG / "plotjuggler.xml").getroot()


def foxglove() -> dict[str, Any]:
    content: dict[str, Any] = json.loads((CONFIG / "foxglove.json").read_text(encoding="utf-8"))
    return content


def plotjuggler_series() -> set[str]:
    """All series that PlotJuggler makes of the node's messages (reduced model)."""
    state = {f"{NODE}/state/{m}/{field}" for m in LAYOUT.meshes for field in FIELDS}
    return state | {f"{NODE}/samples/data[{i}]" for i in range(len(LAYOUT.channels))}


def test_plotjuggler_curves_are_series_of_the_node(regime_keys: set[str]) -> None:
    regime = f"{NODE}/regime/{NODE}/{NODE}: regime/"
    known = plotjuggler_series() | {regime + key for key in regime_keys}
    names = {
        curve.get(key)
        for curve in plotjuggler().iter("curve")
        for key in ("name", "curve_x", "curve_y")
    }
    assert len(names) > 10
    assert names - {None} <= known


def test_plotjuggler_subscribes_to_what_it_plots() -> None:
    for topics in plotjuggler().iter("selected_topics"):
        asked = set(str(topics.get("value")).split(";"))
        assert asked <= TOPICS
        plotted = {str(curve.get("name")) for curve in plotjuggler().iter("curve")}
        assert all(any(name.startswith(f"{topic}/") for topic in asked) for name in plotted)


def test_plotjuggler_tabs_are_whole() -> None:
    for splitter in plotjuggler().iter("DockSplitter"):
        count = int(str(splitter.get("count")))
        assert len(splitter) == count == len(str(splitter.get("sizes")).split(";"))
    shown = [str(tab.get("tab_name")) for tab in plotjuggler().iter("Tab")]
    assert shown == ["Motion", "Section", "Steering"]


def test_foxglove_layout_shows_every_panel_once() -> None:
    content = foxglove()
    shown = list(leaves(content["layout"]))
    assert sorted(shown) == sorted(content["configById"])
    kinds = {name.partition("!")[0] for name in shown}
    assert kinds >= {"Plot", "StateTransitions", "DiagnosticSummary", "Parameters"}


def leaves(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
        return
    assert node["direction"] in ("row", "column")
    for part in ("first", "second"):
        yield from leaves(node[part])


def paths() -> list[dict[str, Any]]:
    panels = foxglove()["configById"].values()
    return [path for panel in panels for path in panel.get("paths", [])]


@pytest.mark.parametrize("path", paths(), ids=lambda path: str(path["label"]))
def test_foxglove_path_is_the_channel_that_its_label_says(
    path: dict[str, Any], regime_keys: set[str]
) -> None:
    topic, _, rest = path["value"].partition(".")
    assert topic in TOPICS
    found = re.fullmatch(r"(\w+)\[(\d+)\]", rest)
    if found is None:
        assert rest == "status[0].message" or path["label"] in regime_keys
        assert rest == "status[0].message" or f'{{key=="{path["label"]}"}}' in rest
        return
    field, index = found[1], int(found[2])
    if field in FIELDS:
        assert f"{FIELDS[field]}_{LAYOUT.meshes[index]}" == path["label"]
    else:
        names = {"samples": LAYOUT.channels, "section": SECTION}[topic.rpartition("/")[2]]
        assert field == "data"
        assert names[index] == path["label"]


def test_foxglove_section_is_velocity_over_displacement() -> None:
    panel = foxglove()["configById"]["Plot!section"]
    index = int(re.findall(r"\[(\d+)\]", panel["xAxisPath"]["value"])[0])
    assert SECTION[index] == "x_sp_L"
    assert panel["xAxisVal"] == "custom"


def test_section_columns_are_those_of_the_samples() -> None:
    keep = [0, 1, *range(5, 5 + 2 * LAYOUT.n_mesh)]
    assert tuple(np.array(LAYOUT.channels)[keep]) == SECTION


def test_foxglove_buttons_and_diagnostics_name_what_the_node_has() -> None:
    panels = foxglove()["configById"].values()
    buttons = {panel["serviceName"] for panel in panels if "serviceName" in panel}
    assert buttons
    assert buttons <= SERVICES
    assert {p["topicToRender"] for p in panels if "topicToRender" in p} == {"/diagnostics"}
