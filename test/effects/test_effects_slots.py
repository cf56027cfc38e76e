"""Effects in slots of the gear's own kernel: as their laws, exact, in lanes, with tangents.

Expected numbers come from the effects' own laws, which share nothing with the slots, from DOP853
with located events, and from differences of neighbouring motions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reference import Reference, in_si, integrate
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.integrate import State, Stepper
from herringbone_sim.core.mirror import has_equal_halves, state_mirror
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.packed import make_work, of_one_type
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.right_hand_side import rk4_step
from herringbone_sim.dynamics.flow import GearFlow, settle
from herringbone_sim.effects.assemble import assemble
from herringbone_sim.effects.gear import pointers_allowed
from herringbone_sim.effects.law_stepper import LawStepper
from herringbone_sim.effects.registry import effects
from herringbone_sim.effects.written import read_effects

PERIODIC = {"xi": 0.07, "delta_T": 90.0}  # an orbit that loses contact in every mesh cycle

# One of each effect that acts on the machine, of a size that a diagnosis would find.
TEXTS = (
    "backlash_offset@rp:offset=4e-6",
    "thermal_backlash:rate=3e-8",
    "mean_stiffness@sp:factor=1.2",
    "thermal_stiffness:rate=0.001",
    "stiffness_harmonic@sp:order=2,cos=0.05,sin=0.03",
    "pin_position:offset=3e-6",
    "profile_error:order=3,cos=2e-6,sin=1e-6",
    "stagger@all/all/L:phase=0.2",
    "planet_phase:phase=0.2",
    "runout@rp:member=ring,amplitude=5e-6,phase=0.3",
    "tooth_crack@sp:depth=0.3,member=sun,position=3.2,width=1.5",
    "tooth_spall@rp/all/L:height=4e-6,member=ring,position=5.3,width=1.1",
    "torque_ripple:amplitude=0.2,phase=0.4,order=3",
    "tooth_friction:mu=0.08",
    "damping_law:share=0.4,power=0,depth=1e-5",
    "damping_law:share=0.4,power=0.5,depth=1e-5",
    "contact_nonlinearity:exponent=1.1",
    "ring_flexibility@rp:stiffness=3e9,damping=0.05",
    "bearing_clearance:clearance=5e-6",
    "bearing_clearance:clearance=5e-6,softness=0.1",
    "damping_law:share=1,power=0,depth=1e-5; tooth_friction:mu=0.08",
    "ring_flexibility@rp:stiffness=3e9; bearing_clearance:clearance=5e-6",
    "contact_nonlinearity:exponent=1.1; bearing_clearance:clearance=2e-6",
    "tooth_crack@sp:depth=0.3,member=sun,position=3.2; tooth_friction:mu=0.05",
)
# A crack weakens the whole stiffness, wherever it stands in the list.
CRACKED = (
    "tooth_crack@sp:depth=0.3,member=sun,position=3.2,width=1.9; stiffness_harmonic@sp:cos=0.2",
    "tooth_crack@sp:depth=0.3,member=sun,position=3.2,width=1.9; stagger@all/all/L:phase=0.8",
    "stiffness_harmonic@sp:cos=0.2; tooth_crack@sp:depth=0.3,member=sun,position=3.2,width=1.9",
)


def gear(text: str, **values: object) -> Model:
    return assemble(build(Parameters(**{**PERIODIC, **values})), read_effects(text))


def test_every_effect_on_the_machine_is_here() -> None:
    named = {text.split("@")[0].split(":")[0] for text in TEXTS}
    assert named == {name for name, one in effects().items() if one.level != "sensor"}


@pytest.mark.parametrize("kind", ["reduced", "full"])
@pytest.mark.parametrize("text", [*TEXTS, *CRACKED])
def test_the_slots_give_the_accelerations_of_the_laws(text: str, kind: str) -> None:
    if kind == "full":
        text = text.replace("planet_phase:", "planet_phase@all/2/all:")
        text = text.replace("bearing_clearance:", "bearing_clearance@all/1/all:")
    model, actives = gear(text, model=kind), read_effects(text)
    law = Reference(model, actives)
    layout, rng = model.layout, np.random.default_rng(3)
    work = make_work(layout.n_mesh, layout.n_coordinate, model.n_added_coordinates)
    n, h = layout.n_state, 1e-9
    for cycle in (0, 3, 5, 40):
        y = rng.normal(size=model.n_state) * 4.0
        y[n:] *= 0.1
        tau = 2 * np.pi / model.packed.Omega * (cycle + rng.uniform())
        with pointers_allowed():
            wanted = law.slope(tau, in_si(model, y, law.n_added_states))[:n]
        found, turn = y.copy(), tau * model.packed.Omega / (2 * np.pi)
        phase = 2 * np.pi * (turn - cycle)
        rk4_step(of_one_type(model.packed), work, found, phase, cycle, h)
        np.testing.assert_allclose((found - y)[:n] / h, wanted, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    ("text", "neutral"),
    [
        ("contact_nonlinearity; contact_nonlinearity@sp:exponent=1.2", "exponent=1.0"),
        ("damping_law; damping_law@sp:power=1", "share=0.0"),
    ],
)
def test_a_law_that_is_bent_twice_on_a_mesh_runs_by_laws(text: str, neutral: str) -> None:
    """By their laws two add up, which no slot holds; a neutral one bends nothing."""
    assert gear(text).integrator is LawStepper
    assert gear(text.replace(";", "@rp;")).integrator is None
    bends, also_bends = text.split("; ")
    bends_nothing = f"{also_bends.partition(':')[0]}:{neutral}"
    assert gear(f"{bends}; {bends_nothing}").integrator is None
    assert gear(f"{bends_nothing}; {bends}").integrator is None


@pytest.mark.parametrize("text", TEXTS)
def test_twenty_cycles_are_exact_to_1e_8(text: str) -> None:
    """The default order against a higher one with three times the steps."""
    stepper = Stepper(gear(text))
    start = stepper.advance(stepper.start(), 40 * 16).end
    default = stepper.advance(start, 20 * 16).end.y
    fine = Stepper(gear(text, order=16, steps_per_cycle=48)).advance(start, 20 * 16).end.y
    assert np.abs(default - fine).max() < 1e-8


@pytest.mark.parametrize("text", TEXTS)
def test_an_independent_method_confirms_a_mesh_cycle(text: str) -> None:
    """DOP853 with located events; ``benchmarks.effects --reference`` does so for twenty."""
    model, actives = gear(text), read_effects(text)
    stepper = Stepper(model)
    start = stepper.advance(stepper.start(), 200 * 16).end
    found = stepper.advance(start, 16)
    assert found.switches > 0
    n_added_states = Reference(model, actives).n_added_states
    wanted = integrate(model, actives, in_si(model, start.y, n_added_states), start.cycle, 1)
    np.testing.assert_allclose(
        in_si(model, found.end.y, n_added_states)[: model.layout.n_state],
        wanted[: model.layout.n_state],
        atol=1e-9,
    )


@pytest.mark.parametrize("text", TEXTS)
def test_lanes_go_as_the_stepper_does(text: str) -> None:
    gears = [gear(text, delta_T=value) for value in (88.0, 92.0)]
    batch = run_batch(gears, transient=10, cycles=10, points=5, before=np.array([3, 3]))
    for one, end, reason in zip(gears, batch.end, batch.reasons, strict=True):
        stepper = Stepper(one)
        start = replace(stepper.start(), cycle=3)
        assert reason == ""
        np.testing.assert_allclose(end, stepper.advance(start, 20 * 16).end.y, atol=1e-9)


@pytest.mark.parametrize("text", TEXTS)
def test_tangents_are_differences_of_neighbours(text: str) -> None:
    """Over a mesh cycle with switches, by central differences of 1e-6."""
    model = gear(text)
    stepper, n = Stepper(model), model.n_state
    start = stepper.advance(stepper.start(), 203 * 16).end
    rng = np.random.default_rng(1)
    z = rng.normal(size=n)
    z /= np.linalg.norm(z)

    def after(y: np.ndarray, tangents: np.ndarray) -> State:
        begin = replace(start, y=y, tangents=tangents, growth=np.zeros(len(tangents)))
        return stepper.advance(begin, 15).end

    found = after(start.y, z[None].copy()).tangents[0]
    none = np.zeros((0, n))
    apart = after(start.y + 1e-6 * z, none).y - after(start.y - 1e-6 * z, none).y
    np.testing.assert_allclose(found, apart / 2e-6, atol=2e-4 * np.abs(found).max())


def test_halves_that_an_effect_makes_unlike_are_integrated_both() -> None:
    assert has_equal_halves(gear("mean_stiffness@sp:factor=1.2"))
    assert has_equal_halves(gear("tooth_friction:mu=0.08"))
    assert has_equal_halves(gear("ring_flexibility@rp:stiffness=3e9"))
    assert not has_equal_halves(gear("ring_flexibility@rp/all/L:stiffness=3e9"))
    assert has_equal_halves(gear("bearing_clearance:clearance=5e-6"))
    assert not has_equal_halves(gear("bearing_clearance@all/all/L:clearance=5e-6"))
    assert not has_equal_halves(gear("stagger@all/all/L:phase=0.2"))
    assert not has_equal_halves(
        gear("torque_ripple:amplitude=0.2; pin_position@all/all/R:offset=1e-6")
    )


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # one batch has no spread
@pytest.mark.parametrize(
    "text",
    [
        "tooth_friction:mu=0.08",
        "damping_law:share=0.4,power=0,depth=1e-5",
        "ring_flexibility@rp:stiffness=3e9",
        "bearing_clearance:clearance=5e-6",
        "bearing_clearance:clearance=5e-6; tooth_friction:mu=0.08; contact_nonlinearity",
    ],
)
def test_one_half_grows_as_the_whole_does(text: str) -> None:
    """Growth of perturbations within symmetry and across it, by the map of the whole gear."""
    model = gear(text)
    flow = GearFlow(model, 1)
    y = settle(flow, flow.start(), 3)
    batch = run_batch([model], y[None], 0, 1, 1, True, before=np.array([3]))
    _, tangents = flow.advance(y, np.eye(flow.n), 3)
    mirror = state_mirror(model)
    half = np.unique(np.minimum(mirror, np.arange(flow.n)))
    z = np.random.default_rng(0).normal(size=len(half))
    for sign, found in ((1.0, batch.within), (-1.0, batch.transverse)):
        whole = np.zeros(flow.n)
        whole[half] = z
        if sign < 0.0:
            whole[mirror == np.arange(flow.n)] = 0.0
        start = whole[half].copy()
        whole[mirror[half]] = sign * start
        growth = np.linalg.norm((tangents.T @ whole)[half]) / np.linalg.norm(start)
        wanted = np.log(growth) / flow.period
        np.testing.assert_allclose(found[0], wanted, atol=1e-9)
