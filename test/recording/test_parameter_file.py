"""Parameter files: the two that ship, the round trip, and what is refused in which words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from gears import UNEVEN
from hypothesis import given
from hypothesis import strategies as st

from herringbone_sim.core.parameters import Parameters, meaning, names
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import (
    load_parameters,
    parameter_text,
    ros_text,
    save_parameters,
)

CONFIG = Path(__file__).resolve().parents[2] / "config"
PAPER = {
    "m_n": 0.003845,
    "gamma": 1.2e-5,
    "alpha_w": 20.74,
    "projection": "torque",
    "thermal_rp": "sun",
}
UNTYPED = ("planet_angle",)


@pytest.fixture
def written(tmp_path):
    """Writer of a file with some text; returns its path."""

    def write(text):
        path = tmp_path / "some.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def parameters(text):
    return f"/**:\n  ros__parameters:\n    {text}\n"


def test_rig_file_is_the_nominal_rig():
    assert load_parameters(CONFIG / "rig.yaml") == Parameters()


def test_paper_file_is_the_natural_reading():
    assert load_parameters(CONFIG / "paper.yaml") == Parameters(**PAPER)


def test_rig_file_holds_the_data_sheet():
    p = load_parameters(CONFIG / "rig.yaml")
    assert (p.z_s, p.z_p, p.z_r, p.n_planets) == (27, 25, 77, 3)
    assert (p.m_n, p.alpha_n, p.beta, p.alpha_w) == (4e-3, 20.0, 16.0, 20.0)
    assert (p.I_s, p.I_p, p.I_c, p.I_r, p.m_p) == (0.008, 0.007, 0.22, 0.125, 4.485)
    assert (p.k_m_sp, p.k_m_rp, p.k_amp, p.xi) == (1.5e9, 1.2e9, (0.25,), 0.07)
    assert (p.b_c, p.b, p.e_m, p.gamma, p.T_1) == (1e-4, 0.6, 0.35, 1.18e-5, 220.0)


@pytest.mark.parametrize("file", ["rig.yaml", "paper.yaml"])
def test_shipped_files_explain_every_parameter(file):
    lines = (CONFIG / file).read_text().splitlines()
    for name in names():
        (line,) = [one for one in lines if one.strip("# ").startswith(f"{name}:")]
        about = meaning(name)
        assert f"# [{about.unit}] {about.text}" in line
        assert ("; live" in line) is about.live


@pytest.mark.parametrize("file", ["rig.yaml", "paper.yaml"])
def test_shipped_files_are_typed_for_ros(file):
    """ROS wants a dot in every double and no empty list; any YAML reader sees the same types."""
    document = yaml.safe_load((CONFIG / file).read_text())
    assert list(document) == ["/**"]
    values = document["/**"]["ros__parameters"]
    for name in set(names()) - set(UNTYPED):
        default = getattr(Parameters, name)
        expected = list if isinstance(default, tuple) else type(default)
        assert type(values[name]) is expected, name
        if expected is list:
            assert values[name]
            assert {type(one) for one in values[name]} == {float}


def test_a_set_goes_through_a_file_unchanged(tmp_path):
    p = Parameters(**UNEVEN, K=1e-7, T_1=-3.5e6, seed=7)
    save_parameters(tmp_path / "p.yaml", p, "Two lines\nof title")
    assert load_parameters(tmp_path / "p.yaml") == p
    assert (tmp_path / "p.yaml").read_text().startswith("# Two lines\n# of title\n/**:\n")


@given(
    value=st.floats(-1e7, 1e7),
    shares=st.lists(st.floats(-1e-3, 1e-3), min_size=1, max_size=5),
)
def test_doubles_go_through_to_the_bit_and_keep_their_dot(value, shares):
    text = parameter_text(Parameters(T_1=value, e_amp=tuple(shares)))
    values = yaml.safe_load(text)["/**"]["ros__parameters"]
    assert values["T_1"] == value
    assert values["e_amp"] == shares
    (line,) = [one for one in text.splitlines() if one.strip().startswith("T_1:")]
    assert "." in line.split("#")[0]


def test_empty_lists_become_what_ros_can_type(tmp_path):
    save_parameters(tmp_path / "p.yaml", Parameters(k_amp=(), e_amp=()))
    assert "[]" not in (tmp_path / "p.yaml").read_text()
    again = load_parameters(tmp_path / "p.yaml")
    assert (again.k_amp, again.e_amp, again.planet_angle) == ((0.0,), (0.0,), ())


def test_numbers_are_read_as_ros_reads_them(written):
    """PyYAML alone takes an exponent without a dot or a sign for text."""
    text = "b_c: 2e-4\n    k_m_sp: 1.5e9\n    K: 1\n    order: 14\n    k_amp: [1e-1, 0]"
    p = load_parameters(written(parameters(text)))
    assert (p.b_c, p.k_m_sp, p.K, p.order, p.k_amp) == (2e-4, 1.5e9, 1.0, 14, (0.1, 0.0))
    assert np.isclose(p.xi, 0.07)


@pytest.mark.parametrize(
    "node", ["/**", "herringbone_sim", "/herringbone_sim", "/a/herringbone_sim"]
)
def test_nodes_that_are_this_one(written, node):
    path = written(f"{node}:\n  ros__parameters:\n    xi: 0.1\n")
    assert load_parameters(path).xi == 0.1


def test_the_own_node_comes_on_top_of_all(written):
    path = written(
        "/**:\n  ros__parameters: {xi: 0.1, K: 0.2}\n"
        "herringbone_sim:\n  ros__parameters: {xi: 0.3}\n"
    )
    p = load_parameters(path)
    assert (p.xi, p.K) == (0.3, 0.2)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("", "the file must hold a mapping, got None"),
        ("- 1\n", r"the file must hold a mapping, got \[1\]"),
        ("xi: 0.1\n", "'xi' is not this node"),
        ("camera:\n  ros__parameters:\n    xi: 0.1\n", "'camera' is not this node"),
        ("/**:\n  xi: 0.1\n", r"'/\*\*' must hold ros__parameters alone"),
        ("/**:\n", r"'/\*\*' must hold ros__parameters alone"),
        ("/**:\n  ros__parameters:\n", "must hold names and values"),
        ("/**:\n  ros__parameters: 3\n", "must hold names and values"),
        ("/**:\n  ros__parameters: {1: 2}\n", "must hold names and values"),
        ("/**: {ros__parameters: [\n", "no YAML: "),
        (parameters("xi: 0.1\n    xi: 0.2"), "'xi' stands twice"),
        (parameters("delta_t: 20.0"), "no parameter 'delta_t'; there are model"),
        (parameters("xi: lots"), "xi must be float, got 'lots'"),
        (parameters("xi: -0.1"), r"xi \[-\] must lie in 0 .. 2, got -0.1"),
        (parameters("xi: .nan"), r"xi \[-\] must be finite, got nan"),
        (parameters("z_r: 20"), "the ring must be larger than the sun"),
    ],
)
def test_errors_name_the_file_and_the_rule(written, text, rule):
    path = written(text)
    with pytest.raises(ParameterError, match=rule) as caught:
        load_parameters(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ParameterError, match=r"none\.yaml: No such file"):
        load_parameters(tmp_path / "none.yaml")


def test_a_file_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "p.yaml").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(ParameterError, match=r"p\.yaml: no YAML"):
        load_parameters(tmp_path / "p.yaml")


@pytest.mark.parametrize("text", ["1e5", "1e-3", "0x1F", "on", "null", "~", "7", "1_000", "a: b"])
def test_texts_that_look_like_something_else_stay_quoted_for_ros(written, text):
    values = ros_text(written(parameters(f"record_name: '{text}'")))
    (line,) = [line.strip() for line in values.splitlines() if "record_name" in line]
    assert line.endswith(f'"{text}"')
    again = written(values)
    assert ros_text(again) == values


def test_what_is_empty_is_left_out_for_ros(written):
    values = ros_text(
        written(parameters("K:\n    record_name:\n    planet_angle: []\n    b: 0.5"))
    )
    assert values.splitlines()[2:] == ['    "b": 0.5']
