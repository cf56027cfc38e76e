"""What assembling a gear with effects refuses, and how it divides the steps of the grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.lanes.packed import _parts_of_step
from herringbone_sim.core.model import build, mesh_phases
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Locus, Option
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.effects.sensors import check_effects
from herringbone_sim.effects.site import revolutions, whole_cycles
from herringbone_sim.effects.slots import Slots
from herringbone_sim.effects.written import effects_text, read_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.grid import with_sweep_steps


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "text",
    [
        "stiffness_harmonic:order=8",
        "profile_error:order=8",
        "tooth_crack@sp/1:width=0.2",
        "bearing_clearance:clearance=5e-6,stiffness=3e11",
        "ring_flexibility@rp:stiffness=1e12",
    ],
)
def test_steps_are_short_enough_for_what_effects_add(text: str) -> None:
    # The reference has series of order 20 and 16 to 32 times as many steps.
    p = Parameters(delta_T=90.0, model="full" if "/" in text else "reduced")
    fine = p.changed({"order": 20, "steps_per_cycle": 256})
    ends = []
    for one in (p, with_sweep_steps(p, {}), fine):
        stepper = Stepper(build_with(one, read_effects(text)))
        start = stepper.start()
        ends.append(stepper.advance_cycles(start.y, start.tangents, 0, 1)[0])
    assert np.abs(ends[0] - ends[2]).max() < 1e-7
    assert np.abs(ends[1] - ends[2]).max() < 1e-7


def test_a_gear_takes_an_effect_of_bodies_at_one_place() -> None:
    model = build(Parameters(model="full"))
    both = read_effects("bearing_clearance@all/1; bearing_clearance@all/2")
    with pytest.raises(ParameterError, match="one place, got all/1/all and all/2/all"):
        check_effects(model, both)
    check_effects(model, read_effects("bearing_clearance@all/1; ring_flexibility@rp"))


def test_what_fill_refuses_is_refused_before_it_is_set() -> None:
    def fill(slots: Slots, *_: object) -> None:
        if not slots.model.layout.numbered:
            raise ParameterError("needs model: full")

    named = replace(known_effects()["mean_stiffness"], fill=fill)
    active = replace(read_effects("mean_stiffness:factor=0.9")[0], effect=named)
    check_effects(build(Parameters(model="full")), [active])
    with pytest.raises(ParameterError, match="needs model: full"):
        check_effects(build(Parameters()), [active])


def test_choices_that_are_no_text_are_read_back(monkeypatch: pytest.MonkeyPatch) -> None:
    named = known_effects()["mean_stiffness"]
    twice = replace(named, options=(*named.options, Option("twice", "", False, (False, True))))
    monkeypatch.setattr("herringbone_sim.effects.written.effect", lambda name: twice)
    for value in (False, True):
        actives = read_effects([{"effect": "mean_stiffness", "parameters": {"twice": value}}])
        assert read_effects(effects_text(actives)) == actives
        assert actives[0].chosen["twice"] is value


def test_spaces_in_a_list_of_channels_mean_nothing() -> None:
    close, apart = (
        read_effects(f"sensor_gain:gain=1.1,channels=F_sp_L{plus}F_sp_R") for plus in ("+", " + ")
    )
    assert close == apart


@pytest.mark.filterwarnings("ignore")
def test_a_tooth_enters_every_mesh_at_the_same_phase_of_its_stiffness() -> None:
    p = Parameters(model="full", phasing="geometric", planet_angle=(0.0, 117.0, 242.0))
    model = build(p)
    mask = Locus("sp").mask(model.layout)
    late = whole_cycles(model, mask, {"member": "sun"})[2]
    ahead = mesh_phases(p) / (2.0 * np.pi)
    assert np.abs(late + ahead - np.rint(late + ahead))[mask > 0].max() < 1e-9
    turn = revolutions(model, mask, {"member": "sun"})[2]
    assert np.abs(late - turn)[mask > 0].max() <= 0.5 + 1e-9


@pytest.mark.parametrize(
    ("text", "parts", "in_sweeps"),
    [
        ("", 1, 1),
        ("stiffness_harmonic:order=1", 1, 1),
        ("profile_error:order=2", 1, 1),
        ("profile_error:order=3", 1, 2),
        ("profile_error:order=4", 2, 2),
        ("profile_error:order=8", 3, 4),
        ("ring_flexibility@rp:stiffness=3e9", 1, 1),
        ("bearing_clearance:clearance=5e-6", 1, 2),
    ],
)
def test_only_what_effects_add_divides_a_step(text: str, parts: int, in_sweeps: int) -> None:
    """By hand: order o turns by 2 pi o / 16 in a step, and a series of order 12 leaves out 1e-8 at
    1.37 rad; in sweeps it turns by 2 pi o / 8, and one of order 14 by 1.88 rad."""
    p, effects = Parameters(), read_effects(text)
    assert _parts_of_step(build_with(p, effects)) == parts
    assert _parts_of_step(build_with(with_sweep_steps(p, {}), effects)) == in_sweeps


def test_a_low_order_is_the_users_choice_for_the_gear_s_own_harmonics() -> None:
    p = Parameters(order=4)
    for text, parts in (("", 1), ("stiffness_harmonic:order=1", 1)):
        assert _parts_of_step(build_with(p, read_effects(text))) == parts
