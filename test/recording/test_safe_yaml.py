"""YAML from outside is measured before it is built, and no message prints more than a line."""

from __future__ import annotations

import os
import time
from itertools import pairwise

import pytest

from herringbone_sim.errors import AnalysisError, ParameterError, RecordingError, shown
from herringbone_sim.practice import seeds
from herringbone_sim.recording.campaign import read_campaign
from herringbone_sim.recording.files import BagInformation, bag_information
from herringbone_sim.recording.parameter_file import load_parameters, ros_text
from herringbone_sim.recording.safe_yaml import YamlError, parse_yaml, read_yaml

LEVELS = "abcdefghijklmnop"
BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "\n".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 10)}]" for before, name in pairwise(LEVELS)
)
MERGES = "a: &a {x: 1}\n" + "\n".join(
    f"{name}: &{name} {{<<: [{', '.join([f'*{before}'] * 10)}]}}"
    for before, name in pairwise(LEVELS)
)
HOSTILE = {
    "aliases": BOMB,
    "merges": MERGES,
    "brackets": "a: " + "[" * 3000,
    "braces": "{a: " * 3000,
    "indents": "\n".join(" " * i + "a:" for i in range(600)),
    "digits": "a: " + "1" * 5000,
    "hex": "a: 0x" + "1" * 5000,
    "itself": "a: &a [*a]",
    "nowhere": "a: *b",
    "timestamp": "a: !!timestamp 2001-99-99 99:99:99",
    "tag of a number": "a: !!int ''",
    "tag of a truth": "a: !!bool maybe",
    "object": "a: !!python/object/apply:os.system [true]",
    "twice": "a: 1\na: 2",
    "key": "? [a, b]\n: 1",
    "key of aliases": "a: &a b\n*a : 1",
    "large": "a: '" + "x" * (2 << 20) + "'",
    "scalar": "a: '" + "x" * (1 << 17) + "'",
    "many": "a: [" + "1," * 200_000 + "]",
    "documents": "a: 1\n---\nb: 2",
    "controls": "a: '\0'",
    "list": "[1, 2]",
    "text": "hello",
    "nothing": "",
}


@pytest.fixture
def written(tmp_path):
    """Writer of a file of some name; returns its path."""

    def write(text, name="some.yaml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_text_is_one_short_error_soon(written, kind):
    began = time.monotonic()
    with pytest.raises(YamlError) as caught:
        read_yaml(written(HOSTILE[kind]))
    assert time.monotonic() - began < 10
    assert len(str(caught.value)) < 300
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", HOSTILE)
@pytest.mark.parametrize("read", [load_parameters, ros_text])
def test_parameter_files_refuse_it(written, kind, read):
    path = written(HOSTILE[kind])
    with pytest.raises(ParameterError) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize("kind", HOSTILE)
def test_campaigns_bags_and_thresholds_refuse_it(written, kind, monkeypatch):
    folder = written(HOSTILE[kind], "campaign.yaml").parent
    with pytest.raises(RecordingError, match=r"campaign\.yaml") as caught:
        read_campaign(folder)
    assert len(str(caught.value)) < 600
    written(HOSTILE[kind], "metadata.yaml")
    information = bag_information(folder)
    assert information == BagInformation(notes=information.notes)
    assert "metadata.yaml can't be read" in information.notes[0]
    monkeypatch.setattr(seeds, "FILE", written(HOSTILE[kind], "calibration.json"))
    with pytest.raises(AnalysisError, match="seeds") as wrong:
        seeds.frozen()
    assert len(str(wrong.value)) < 600


def test_a_line_and_the_rule_are_told():
    with pytest.raises(YamlError, match=r"'b' stands twice: leave one out, in line 3"):
        parse_yaml("a: 1\nb: 1\nb: 2\n")
    with pytest.raises(YamlError, match="nest 32 deep, in line 1"):
        parse_yaml("[" * 40)
    with pytest.raises(YamlError, match="nest"):  # libyaml may have a limit of its own, of 1000
        parse_yaml("[" * 3000)


def test_what_only_looks_like_a_number_stays_a_text():
    text = "[2001-01-01, 2001-01-01 12:00:00, 12:30:45, 1_000, 1e, '7']"
    assert parse_yaml(text) == [
        "2001-01-01", "2001-01-01 12:00:00", "12:30:45", "1_000", "1e", "7",
    ]  # fmt: skip


def test_values_are_what_ros_takes_them_for():
    text = "{i: -3, x: 0x1F, f: 1e-4, g: +.5, h: 2., inf: -.inf, t: true, o: Off, none: ~, e: }"
    assert parse_yaml(text) == {
        "i": -3, "x": 31, "f": 1e-4, "g": 0.5, "h": 2.0, "inf": float("-inf"), "t": True,
        "o": False, "none": None, "e": None,
    }  # fmt: skip
    assert parse_yaml("a: !!str 12") == {"a": "12"}


def test_aliases_and_merges_of_sensible_size_are_taken():
    text = "a: &a {K: 0, T_1: 1}\nb: {<<: *a, K: 2}\nc: [*a, *a]\n"
    assert parse_yaml(text)["b"] == {"K": 2, "T_1": 1}
    assert parse_yaml(text)["c"] == [{"K": 0, "T_1": 1}] * 2


@pytest.mark.timeout(20)
def test_a_pipe_is_no_file(tmp_path):
    os.mkfifo(tmp_path / "some.yaml")
    with pytest.raises(ParameterError, match="it is not a file"):
        load_parameters(tmp_path / "some.yaml")


def test_values_in_messages_are_a_line_however_large_they_are():
    aliased = ["x"] * 10
    for _ in range(30):
        aliased = [aliased] * 10
    itself: list[object] = []
    itself.append(itself)
    for value in (
        aliased,
        itself,
        "x" * 10**8,
        b"x" * 10**8,
        1 << 10**6,
        dict.fromkeys(range(9**6)),
    ):
        text = shown(value)
        assert len(text) <= 120
        assert "\n" not in text


def test_short_values_are_shown_as_they_are():
    for value in (1.5, "a\nb", [1, 2], {"a": None}, b"ab", (), -7, True):
        assert shown(value) == repr(value)


@pytest.mark.parametrize("value", ["[" + "1.0," * 50_000 + "]", "'" + "x" * 60_000 + "'"])
@pytest.mark.parametrize("name", ["K", "k_amp", "model", "effects", "nonsense"])
def test_a_refused_value_is_not_printed_whole(written, name, value):
    with pytest.raises(ParameterError) as caught:
        load_parameters(written(f"/**: {{ros__parameters: {{{name}: {value}}}}}"))
    assert len(str(caught.value)) < 1500


def test_names_from_outside_are_not_printed_whole(written):
    long = "x" * 60_000
    for text in (
        f"? {long}\n: {{ros__parameters: {{K: 1}}}}",
        f"/**:\n  ros__parameters:\n    ? {long}\n    : 1",
        f"/**: {{ros__parameters: {{effects: '{long}@sp'}}}}",
        f"/**: {{ros__parameters: {{effects: [{{effect: runout, locus: {{mesh: '{long}'}}}}]}}}}",
    ):
        with pytest.raises(ParameterError) as caught:
            load_parameters(written(text))
        assert len(str(caught.value)) < 1500


@pytest.mark.parametrize("name", ["[a, b]", "'" + "x" * 60_000 + "'", "true", '"\\e[2J"'])
def test_names_in_a_campaign_are_texts_of_a_line(written, name):
    point = "role: fit, delta_T: 1, K: 0, T_1: 1, Omega: 1"
    good = f"{{path: good, {point}}}"
    folder = written(f"rig: r\nruns: [{good}, {{path: {name}, {point}}}]", "campaign.yaml").parent
    campaign = read_campaign(folder)
    assert [run.path.name for run in campaign.runs] == ["good"]
    assert len(str(campaign.faults)) < 800
    with pytest.raises(RecordingError, match="a name must be a text") as caught:
        read_campaign(written(f"rig: {name}\nruns: [{good}]", "campaign.yaml").parent)
    assert len(str(caught.value)) < 800
