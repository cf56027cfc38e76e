"""JSON files from outside, spoiled or of another form, are one short error and never hang."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import pytest
from sweep_support import small

from herringbone_sim.errors import AnalysisError, HerringboneError
from herringbone_sim.gap.report_file import read_report
from herringbone_sim.practice.bench import read_json as read_bench_json
from herringbone_sim.practice.bench import read_seals
from herringbone_sim.practice.label import read_label
from herringbone_sim.practice.outcome import outcome
from herringbone_sim.recording.safe_json import MOST_BYTES, JsonError, read_json
from herringbone_sim.sweeps.store import load_store

HOSTILE = {
    "empty": "",
    "brackets": "[" * 5000,
    "deep": '{"a": ' * 100 + "1" + "}" * 100,
    "deeper": '{"a": ' * 50000 + "1" + "}" * 50000,
    "list": "[1]",
    "digits": '{"a": ' + "1" * 5000 + "}",
    "large": " " * (MOST_BYTES + 1),
}


def sweep(file: Path) -> Any:
    return load_store(file.rename(file.with_name("sweep.json")).parent)


def cases(file: Path) -> Any:
    label = file.with_name("labels") / "a.json"
    place = file.with_name("a")
    for folder in (label.parent, place):
        folder.mkdir()
    label.write_text("{}")
    file.rename(place / "report.json")
    sealed = read_label(label, hashlib.sha256(b"{}").hexdigest())
    return outcome(sealed, read_bench_json(place / "report.json"), "a")


READERS = [read_json, sweep, read_report, read_label, read_bench_json, cases]


@pytest.mark.parametrize("kind", HOSTILE)
@pytest.mark.parametrize("read", READERS)
def test_a_spoiled_file_is_one_short_error(tmp_path: Path, read: Any, kind: str) -> None:
    file = tmp_path / "one.json"
    file.write_text(HOSTILE[kind], encoding="utf-8")
    with pytest.raises(HerringboneError) as caught:
        read(file)
    assert len(str(caught.value)) < 600
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("read", READERS)
def test_bytes_that_are_no_text_are_refused(tmp_path: Path, read: Any) -> None:
    file = tmp_path / "one.json"
    file.write_bytes(b'{"a": "\xff"}')
    with pytest.raises(HerringboneError, match="not UTF-8"):
        read(file)


@pytest.mark.parametrize("read", READERS)
def test_a_pipe_is_no_file(tmp_path: Path, read: Any) -> None:
    file = tmp_path / "one.json"
    os.mkfifo(file)
    with pytest.raises((HerringboneError, OSError), match="not a file"):
        read(file)


@pytest.mark.parametrize(
    "content",
    [
        {"gap": [1]},
        {"gap": {"metric": []}},
        {"gap": {"metric": "force_law"}},
        {"gap": {"metric": "force_law", "senses": [1]}, "effects": []},
        {"gap": {"metric": "force_law"}, "effects": [1], "campaign": "c", "verdict": "none"},
    ],
)
def test_a_report_of_another_form_is_refused(tmp_path: Path, content: object) -> None:
    file = tmp_path / "report.json"
    file.write_text(json.dumps(content))
    with pytest.raises(AnalysisError, match="is no report of a gap"):
        read_report(file)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("axes", 1),
        ("axes", [1]),
        ("axes", [{"name": [1], "values": [1.0]}]),
        ("axes", [{"name": "K", "values": "12"}]),
        ("axes", [{"name": "K", "values": [10**300]}]),
        ("base", [1]),
        ("chunk", 1.5),
        ("chunk", "1"),
        ("start", []),
        ("effects", 1),
        ("observation", []),
        ("observation", {"transient": 1.5}),
        ("observation", {"mesh": 1}),
        ("observation", {"no_such": 1}),
    ],
)
def test_a_sweep_of_another_form_is_refused(tmp_path: Path, name: str, value: object) -> None:
    file = tmp_path / "sweep.json"
    file.write_text(json.dumps(json.loads(small().to_json()) | {name: value}))
    with pytest.raises(AnalysisError, match="no description of a sweep"):
        load_store(tmp_path)


@pytest.mark.parametrize(
    "report",
    [
        {"verdict": "none", "causes": 1},
        {"verdict": "none", "causes": [1]},
        {"verdict": "none", "causes": []},
        {"verdict": "none", "causes": [{"effect": "none", "probability": [1]}]},
        {"verdict": [], "causes": [{"effect": "none", "probability": 1}]},
    ],
)
def test_a_report_or_label_of_another_form_is_not_scored(report: dict[str, Any]) -> None:
    for label in ({"truth": ["none"], "effects": []}, {"truth": 1}, {}):
        with pytest.raises(AnalysisError):
            outcome(label, report)


def test_seals_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "seals.json").write_text("[" * 5000)
    with pytest.raises(AnalysisError, match="seals"):
        read_seals(tmp_path)


def test_an_object_is_read_as_it_stands(tmp_path: Path) -> None:
    file = tmp_path / "one.json"
    file.write_text('{"a": [1, 2.5, "x", null, true, {"b": 1e-3}]}')
    assert read_json(file) == {"a": [1, 2.5, "x", None, True, {"b": 1e-3}]}
    file.write_text("{")
    with pytest.raises(JsonError, match="must be JSON"):
        read_json(file)
