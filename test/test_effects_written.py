"""Effects in parameter files: as a list and as a text, there and back, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effect, effects
from herringbone_sim.effects.written import effects_text, read_effects, write_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import load_gear, load_parameters, save_parameters

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")
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


@pytest.mark.parametrize("name", sorted(effects()))
def test_every_effect_goes_there_and_back(name: str) -> None:
    one = active(effect(name), Locus("sp", "2", "R"))
    assert read_effects(write_effects((one,))) == (one,)
    assert read_effects(effects_text((one,))) == (one,)


def test_a_command_that_knows_no_effects_refuses_them(tmp_path: Path) -> None:
    file = tmp_path / "gear.yaml"
    file.write_text(LIST)
    with pytest.raises(ParameterError, match="tooth_crack, backlash_offset"):
        load_parameters(file)


@pytest.mark.parametrize(
    ("content", "rule"),
    [
        ("{", "must be JSON"),
        ({"effect": "runout"}, "must be a list"),
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
