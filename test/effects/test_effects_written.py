"""Effects in parameter files: as a list and as a text, there and back, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effect, effects
from herringbone_sim.effects.written import effects_text, parameter_values, read_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import load_gear, load_parameters, save_parameters

LIST = """
/**:
  ros__parameters:
    delta_T: 30.0
    effects:
      - effect: tooth_crack
        locus: {mesh: sp, planet: 1, side: L}
        parameters: {depth: 0.3, member: sun}
      - {effect: backlash_offset, parameters: {offset: 1e-5}}
"""
CRACK = active(effect("tooth_crack"), Locus("sp", "1", "L"), {"depth": 0.3, "member": "sun"})
WORN = active(effect("backlash_offset"), values={"offset": 1e-5})


def test_a_list_in_a_file_is_read(tmp_path: Path) -> None:
    file = tmp_path / "gear.yaml"
    file.write_text(LIST)
    parameters, actives = load_gear(file)
    assert parameters.delta_T == 30.0
    assert actives == (CRACK, WORN)


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "gear.yaml"
    save_parameters(file, Parameters(delta_T=12.0), "mine", (CRACK, WORN))
    assert load_gear(file) == (Parameters(delta_T=12.0), (CRACK, WORN))
    save_parameters(file, Parameters())
    assert load_gear(file) == (Parameters(), ())


def test_a_text_says_the_same_as_the_list() -> None:
    text = "tooth_crack@sp/1/L:depth=0.3,member=sun; backlash_offset:offset=1e-5;"
    assert read_effects(text) == (CRACK, WORN)
    assert read_effects("") == ()
    swap = read_effects("channel_swap:channels=F_sp1_L+F_sp2_L")
    assert swap[0].chosen["channels"] == ("F_sp1_L", "F_sp2_L")


@pytest.mark.parametrize("name", sorted(effects()))
def test_every_effect_goes_there_and_back(name: str) -> None:
    one = active(effect(name), effect(name).candidates(Parameters(model="full").layout)[-1])
    entry = {
        "effect": one.effect.id,
        "locus": vars(one.locus),
        "parameters": parameter_values(one),
    }
    assert read_effects([entry]) == (one,)
    assert read_effects(effects_text((one,))) == (one,)


def test_a_list_without_channels_goes_there_and_back() -> None:
    """Also where the start value is no empty list."""
    for name, written in (("sensor_gain", "gain=1.1,channels="), ("clock_drift", "ppm=100.0")):
        one = active(effect(name), values={"channels": ()})
        assert effects_text((one,)) == f"{name}@all/all/all:{written}"
        assert read_effects(effects_text((one,))) == (one,)


@pytest.mark.parametrize(
    ("text", "places"),
    [
        ("ring_flexibility@sp", "rp/all/all or rp/all/*, got 'sp/all/all'"),
        ("torque_ripple@sp/1/L", "all/all/all, got 'sp/1/L'"),
        ("torque_ripple@all/all/R", "all/all/all, got 'all/all/R'"),
    ],
)
def test_a_place_where_an_effect_cannot_act_is_refused(text: str, places: str) -> None:
    with pytest.raises(ParameterError, match=re.escape(f" acts at {places}")):
        read_effects(text)


@pytest.mark.parametrize(
    "text",
    [
        *("ring_flexibility", "ring_flexibility@rp/2", "pin_position@rp/3/R", "stagger@rp/all/R"),
        *("contact_nonlinearity@sp/1/L", "tooth_friction@sp/1", "channel_swap@sp/1"),
    ],
)
def test_a_place_wider_or_narrower_than_those_tried_is_taken(text: str) -> None:
    """The meshes of the place are those where it acts; a diagnosis writes such departures."""
    name, _, place = text.partition("@")
    (one,) = read_effects(text)
    assert (one.effect.id, one.locus) == (name, Locus(*filter(None, place.split("/"))))


def test_a_command_that_knows_no_effects_refuses_them(tmp_path: Path) -> None:
    file = tmp_path / "gear.yaml"
    file.write_text(LIST)
    with pytest.raises(ParameterError, match="tooth_crack, backlash_offset"):
        load_parameters(file)


@pytest.mark.parametrize(
    ("content", "rule"),
    [
        ("runout:amplitude", "NAME=VALUE"),
        ("runout@rp//L", "NAME=VALUE"),
        ("runout:amplitude=1e-5,amplitude=2e-5", "stands twice"),
        ("runout:amplitude=much", "must be a number"),
        ("squeak", "no effect 'squeak'"),
        ({"effect": "runout"}, "must be a text or a list"),
        (["runout"], "must be a mapping"),
        ([{"effect": "squeak"}], "no effect 'squeak'"),
        ([{"effect": "runout", "size": 1.0}], "has no size"),
        ([{"effect": "runout", "locus": {"tooth": 3}}], "a locus has no tooth"),
        ([{"effect": "runout", "locus": "sp"}], "must be mappings"),
        ([{"effect": "runout", "parameters": {"amplitude": 3.0}}], "must lie in"),
    ],
)
def test_what_is_wrong_is_named(content: object, rule: str) -> None:
    with pytest.raises(ParameterError, match=rule):
        read_effects(content)
