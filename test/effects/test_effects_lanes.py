"""Laws of one's own in lanes: each value as the same by itself, whatever it has beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.effects import load_examples
from herringbone_sim.core.batch import Batch, run_batch
from herringbone_sim.core.lanes.vector import fma, give, load, take
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import active
from herringbone_sim.effects.lanes.batch import LaneStepper
from herringbone_sim.effects.law import law
from herringbone_sim.effects.law_stepper import LawStepper
from herringbone_sim.effects.registry import effect
from herringbone_sim.effects.written import read_effects

LOSES_CONTACT = {"xi": 0.07, "samples_per_cycle": 1, "steps_per_cycle": 8}
DRAG = "squeezed_oil:drag=2e4"
BESIDE = {
    "alone": (DRAG, {}),
    "control": (DRAG, {"K": 0.1, "control_order": 0.3}),
    "harmonics": (DRAG, {"model": "full", "k_amp": (0.2, 0.1), "mesh_phase": (0.0, 0.2, 0.1) * 4}),
    "friction": (f"{DRAG}; tooth_friction:mu=0.08", {}),
    "event": (f"{DRAG}; tooth_crack@sp:depth=0.3,member=sun,position=2.2", {"model": "full"}),
    "own states": (f"{DRAG}; ring_flexibility@rp:stiffness=3e9", {}),
    "jump of the force": (f"{DRAG}; damping_law:share=0.4,power=0,depth=1e-5", {}),
}
ARRAYS = ("sections", "end", "exponents", "exponent_errors", "contact")


@pytest.fixture(autouse=True)
def examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HERRINGBONE_EFFECTS", "")  # brought back after the test
    load_examples()


def gears(text: str, n: int, **values: Any) -> list[Model]:
    """The gear at some temperatures, each on its own grid of the mesh phase."""
    return [
        build_with(Parameters(**{**LOSES_CONTACT, "delta_T": value, **values}), read_effects(text))
        for value in np.linspace(60.0, 90.0, n)
    ]


def observed(models: list[Model], **values: Any) -> Batch:
    length = {"transient": 6, "cycles": 12, "points": 3, "exponents": True}
    return run_batch(models, **{**length, **values})


@pytest.mark.parametrize("name", BESIDE)
def test_values_in_lanes_are_those_run_one_after_another(name: str) -> None:
    text, values = BESIDE[name]
    models = gears(text, 5, **values)
    assert {model.integrator for model in models} == {LaneStepper}
    lanes = observed(models)
    singly = observed([replace(model, integrator=LawStepper) for model in models])
    assert (singly.contact.min(axis=(0, 1)) < 0.9).all()
    assert not any(lanes.reasons)
    for one in ("sections", "end", "contact"):
        np.testing.assert_allclose(getattr(lanes, one), getattr(singly, one), atol=1e-8, rtol=0)
    for one in ("exponents", "exponent_errors"):
        np.testing.assert_allclose(getattr(lanes, one), getattr(singly, one), atol=1e-5, rtol=0)
    assert np.isnan(lanes.transverse).all()


def test_a_value_is_the_same_to_the_bit_among_others_and_alone() -> None:
    """More values than lanes, of different frequencies, in another order, and one by one."""
    text = f"{DRAG}; damping_law:share=0.4,power=0,depth=1e-5"
    models = [*gears(text, 10), *gears(text, 9, Omega=0.8)]
    starts = np.random.default_rng(1).normal(size=(19, 8))
    before = np.arange(19)
    whole = observed(models, starts=starts, before=before)
    order = np.random.default_rng(2).permutation(19)
    mixed = observed([models[i] for i in order], starts=starts[order], before=before[order])
    for one in ARRAYS:
        assert np.array_equal(getattr(whole, one)[order], getattr(mixed, one))
        assert not np.isnan(getattr(whole, one)).any()
    alone = observed([models[17]], starts=starts[17:18], before=before[17:18])
    for one in ARRAYS:
        assert np.array_equal(getattr(whole, one)[17:18], getattr(alone, one))


@law
def react(theta, site, gear, now, added_states, x, v, law, force, torque):
    """Drag by the rate itself."""
    for m in range(force.shape[0]):
        drag = take(theta, 0) * load(site, 0, m)
        give(force, m, fma(drag, take(v, m), take(force, m)))


def check_that_each_is_as_alone(models: list[Model]) -> None:
    together = observed(models)
    for i, model in enumerate(models):
        alone = observed([model])
        for one in ARRAYS:
            assert np.array_equal(getattr(together, one)[i], getattr(alone, one)[0])


def test_gears_with_laws_that_differ_have_their_own_beside_each_other() -> None:
    squared = effect("squeezed_oil")
    models = [
        build_with(Parameters(**LOSES_CONTACT), [active(one, values={"drag": 2e3})])
        for one in (squared, replace(squared, react=react), squared)
    ]
    check_that_each_is_as_alone(models)
    ends = observed(models).end
    assert np.array_equal(ends[0], ends[2])
    assert not np.allclose(ends[0], ends[1], atol=1e-3)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        pytest.param(f"{DRAG}; tooth_friction:mu=0.08", {}, id="laws"),
        pytest.param(f"{DRAG}; tooth_crack@sp:depth=0.3", {}, id="events"),
        pytest.param(DRAG, {"k_amp": (0.2, 0.1)}, id="harmonics"),
    ],
)
def test_gears_with_more_laws_or_constants_run_beside_others(
    text: str, values: dict[str, Any]
) -> None:
    check_that_each_is_as_alone([*gears(DRAG, 2), *gears(text, 2, **values), *gears(DRAG, 1)])


def test_a_motion_that_diverges_leaves_its_neighbours_alone() -> None:
    models = gears(DRAG, 3)
    starts = np.zeros((3, 8))
    starts[1] = 1e8
    found = observed(models, starts=starts)
    assert found.reasons == ("", "diverged", "")
    assert np.isnan(found.end[1]).all()
    assert np.isnan(found.exponents[1])
    wanted = observed([models[0], models[2]], starts=starts[::2])
    assert np.array_equal(found.end[::2], wanted.end)


def test_drag_by_the_square_of_the_rate_is_that_force() -> None:
    """The example of docs/effects.md, where its law is read for a single orbit."""
    model = build(Parameters(**LOSES_CONTACT, delta_T=90.0))
    machine = LawStepper(build_with(model.parameters, read_effects(DRAG)))
    rows = machine.advance(machine.start(), 40).rows
    plain = LawStepper(build_with(model.parameters, read_effects("squeezed_oil:drag=0")))
    n = model.layout.n_mesh
    x, v, force = (rows[-1, 5 + i * n : 5 + (i + 1) * n] for i in range(3))
    b = model.half_backlash_m
    phase = rows[-1, 1]
    k = np.repeat([1.5e9, 1.2e9], n // 2) * (1.0 + 0.25 * np.cos(phase))
    wanted = k * np.sign(x) * np.maximum(np.abs(x) - b, 0.0) + model.damping_n_s_per_m * v
    np.testing.assert_allclose(force - wanted, 2e4 * np.abs(v) * v, rtol=1e-6, atol=1e-6)
    other = plain.advance(plain.start(), 40).rows
    assert np.abs(other - rows)[-1, 5 : 5 + n].max() > 1e-3 * np.abs(x).max()
