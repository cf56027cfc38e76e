"""Gears with effects, integrated: against the core, and against balances of their own."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from herringbone_sim.core.integrate import Block, State, Stepper
from herringbone_sim.core.model import Model, body_accelerations, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active, Locus, active
from herringbone_sim.effects.evaluate import motion, torques
from herringbone_sim.effects.registry import effect
from herringbone_sim.effects.stepper import EffectStepper, simulate, stepper
from herringbone_sim.errors import AnalysisError, DivergenceError

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")
Array = NDArray[np.float64]
START = {"initial_x": (0.3, -0.2, 0.1, 0.4), "samples_per_cycle": 24}
HOT = 40.0


def rig(**values: Any) -> Model:
    return build(Parameters(**{"model": "full", "delta_T": HOT} | START | values))


def largest_difference(a: Block, b: Block) -> float:
    """Of all channels after the head, as a share of each one's largest value."""
    size = np.abs(a.rows[:, 5:]).max(axis=0)
    return float((np.abs(a.rows - b.rows)[:, 5:].max(axis=0) / size).max())


def run(machine: Stepper | EffectStepper, cycles: int = 3, y: Array | None = None) -> Block:
    start = machine.start()
    state = start if y is None else replace(start, y=np.concatenate([y, start.y[len(y) :]]))
    return machine.advance(state, cycles * machine.model.parameters.samples_per_cycle)


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"model": "reduced", "K": 0.2, "projection": "torque"},
        {"T_1": 2000.0, "Omega": 0.35, "control_phase": 1.0, "K": 0.1, "mesh_phase": (0.2,)},
        {"k_amp": (0.25, 0.1), "e_amp": (1.0, -0.3), "e_mean": 0.1, "phi_a": (0.4,)},
    ],
)
def test_without_effects_the_motion_is_that_of_the_core(values: dict[str, Any]) -> None:
    model = rig(**values)
    assert largest_difference(run(Stepper(model)), run(EffectStepper(model, []))) < 1e-4


def test_the_order_is_four_where_there_are_no_kinks() -> None:
    model = rig(b=0.0, delta_T=0.0)
    exact = run(Stepper(model))
    errors = [largest_difference(exact, run(EffectStepper(model, [], n))) for n in (48, 96, 192)]
    slopes = np.diff(np.log2(errors))
    np.testing.assert_allclose(slopes, -4.0, atol=0.4)


def mask(place: Locus, value: float, rest: float) -> tuple[float, ...]:
    on = place.mask(rig().layout) > 0.0
    return tuple(np.where(on, value, rest))


SUN_2 = Locus("sp", "2", "L")
PLANET_3 = Locus("all", "3", "all")
RIGHT = Locus("all", "all", "R")
RING = Locus("rp")
ALL = Locus()
OTHER_PARAMETERS = {
    "mean_stiffness": (SUN_2, {"factor": 1.2}, {"k_factor": mask(SUN_2, 1.2, 1.0)}),
    "stagger": (RIGHT, {"phase": 0.3}, {"mesh_phase": mask(RIGHT, 0.3, 0.0)}),
    "planet_phase": (PLANET_3, {"phase": -0.2}, {"mesh_phase": mask(PLANET_3, -0.2, 0.0)}),
    "pin_position": (PLANET_3, {"offset": 1e-5}, {"e_offset": mask(PLANET_3, -1e-5, 0.0)}),
    "backlash_offset": (RING, {"offset": 5e-6}, {"b_offset": mask(RING, 5e-6, 0.0)}),
    "thermal_backlash": (RING, {"rate": 1e-7}, {"b_offset": mask(RING, HOT * 1e-7, 0.0)}),
    "thermal_stiffness": (RING, {"rate": 1e-3}, {"k_factor": mask(RING, 1.0 - HOT * 1e-3, 1.0)}),
    "stiffness_harmonic": (ALL, {"cos": 0.1, "sin": 0.0, "order": 2}, {"k_amp": (0.25, 0.1)}),
    "profile_error": (ALL, {"cos": 0.0, "sin": -7e-6, "order": 2}, {"e_amp": (1.0, 0.2)}),
}


@pytest.mark.parametrize("name", OTHER_PARAMETERS)
def test_an_effect_that_is_another_parameter_gives_that_motion(name: str) -> None:
    place, values, other = OTHER_PARAMETERS[name]
    core = Stepper(rig(**other))
    mine = EffectStepper(rig(), [active(effect(name), place, values)])
    a, b = run(core), run(mine, y=core.start().y)
    plain = run(Stepper(rig()), y=core.start().y)
    here = slice(5 + 24, None)  # forces and bodies: x and v of a recording hold the nominal error
    size = np.abs(a.rows[:, here]).max(axis=0)
    assert (np.abs(a.rows - b.rows)[:, here] / size).max() < 3e-4
    assert (np.abs(a.rows - plain.rows)[:, here] / size).max() > 1e-2


@pytest.mark.parametrize("name", ["runout", "contact_nonlinearity", "tooth_friction"])
def test_halving_the_step_changes_little(name: str) -> None:
    one = Active(effect(name), tuple(effect(name).start), Locus("sp"))
    coarse, fine = (run(EffectStepper(rig(), [one], n)) for n in (48, 96))
    assert largest_difference(fine, coarse) < 3e-3


def test_an_effect_of_no_size_leaves_the_motion_alone_to_the_bit() -> None:
    none = [
        Active(effect(name), tuple(effect(name).neutral), Locus("rp"))
        for name in ("mean_stiffness", "profile_error", "ring_flexibility", "tooth_friction")
    ]
    a, b = run(EffectStepper(rig(), [])), run(EffectStepper(rig(), none))
    assert np.array_equal(a.rows, b.rows)


def test_blocks_of_any_size_give_the_same_samples_to_the_bit() -> None:
    machine = EffectStepper(rig(), [active(effect("ring_flexibility"), RING)])
    whole = machine.advance(machine.start(), 96)
    first = machine.advance(machine.start(), 31)
    second = machine.advance(first.end, 65)
    assert np.array_equal(whole.rows, np.concatenate([first.rows, second.rows]))
    assert np.array_equal(whole.end.y, second.end.y)


def second_derivative(values: Array, h: float) -> Array:
    found: Array = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / h**2
    return found


@pytest.mark.parametrize("name", ["tooth_friction", "torque_ripple"])
def test_the_bodies_obey_forces_and_torques(name: str) -> None:
    model = rig(samples_per_cycle=2048, b=0.0, delta_T=0.0, T_1=5000.0)
    values = {"mu": 0.2} if name == "tooth_friction" else {"amplitude": 2.0, "order": 30}
    one = active(effect(name), values=values)
    series, _ = simulate(model, [one], 1)
    forces = series.columns(tuple(f"F_{m}" for m in model.layout.meshes))
    push = torques(model, [one], motion(model, series))
    s = model.scales
    mass = np.array([s.M_s, s.M_s, s.M_c, *[s.M_p] * 6])
    of_mesh = np.stack([body_accelerations(model, row) for row in forces])
    wanted = of_mesh + push / mass
    h = float(series.times[1] - series.times[0])
    for side, planet in (("L", 0), ("R", 3)):
        u_s, u_c, u_p = (series[f"u_{b}_{side}" if b != "c" else "u_c"] for b in ("s", "c", "p1"))
        found = second_derivative(u_s - u_c - u_p, h)
        a = wanted[:, 0 if side == "L" else 1] - wanted[:, 2] - wanted[:, 3 + planet]
        without = of_mesh[:, 0 if side == "L" else 1] - of_mesh[:, 2] - of_mesh[:, 3 + planet]
        wrong = np.quantile(np.abs(found - a[1:-1]), 0.98)  # friction jumps
        assert wrong < 2e-2 * np.abs(a - without).max()


def test_where_no_effect_acts_the_core_runs() -> None:
    gain = active(effect("sensor_gain"), values={"gain": 2.0})
    assert isinstance(stepper(rig(), [gain]), Stepper)
    shown, _ = simulate(rig(), [gain], 1)
    true, _ = simulate(rig(), [], 1)
    np.testing.assert_allclose(shown["F_sp1_L"], 2.0 * true["F_sp1_L"])


def test_tangents_and_divergence_are_refused() -> None:
    machine = EffectStepper(rig(), [active(effect("mean_stiffness"), ALL)])
    with pytest.raises(AnalysisError, match="no tangent flow"):
        machine.start(tangents=2)
    start = machine.start()
    far = State(1e7 + start.y, 0, 0, 0.0, start.tangents, start.growth)
    with pytest.raises(DivergenceError, match="mean_stiffness"):
        simulate(rig(), [active(effect("mean_stiffness"), ALL)], 1, far)
