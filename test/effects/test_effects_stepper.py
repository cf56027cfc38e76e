"""Gears with effects, integrated: against the core, and against balances of their own."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from equations import body_accelerations
from interpreted_effects import run_by_laws
from numba import typeof

from benchmarks.reference import integrate
from herringbone_sim.arrays import Array
from herringbone_sim.core.integrate import Block, Stepper
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.numba_private import NumbaExperimentalFeatureWarning
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.assemble import assemble, by_laws
from herringbone_sim.effects.effect import Active, Locus, active
from herringbone_sim.effects.evaluate import evaluate, motion
from herringbone_sim.effects.gear import pointers_allowed
from herringbone_sim.effects.law_stepper import LawStepper
from herringbone_sim.effects.registry import effect
from herringbone_sim.effects.sensors import Sensors
from herringbone_sim.effects.stepper import simulate, stepper
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import DivergenceError, ParameterError

START = {"initial_x": (0.3, -0.2, 0.1, 0.4), "samples_per_cycle": 24}
HOT = 40.0


def rig(**values: Any) -> Model:
    return build(Parameters(**{"model": "full", "delta_T": HOT} | START | values))


def largest_difference(a: Block, b: Block) -> float:
    """Of all channels after the head, as a share of each one's largest value."""
    size = np.abs(a.rows[:, 5:]).max(axis=0)
    return float((np.abs(a.rows - b.rows)[:, 5:].max(axis=0) / size).max())


def laws(model: Model, *actives: Active) -> Stepper:
    """The gear run by the laws of its effects, whether slots hold them or not."""
    return LawStepper(by_laws(model, actives))


def run(machine: Stepper, cycles: int = 3, y: Array | None = None) -> Block:
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
        {"b": 0.0, "delta_T": 0.0, "T_1": 100.0},
    ],
)
def test_without_effects_the_motion_is_that_of_the_core(values: dict[str, Any]) -> None:
    model = rig(**values)
    assert largest_difference(run(Stepper(model)), run(laws(model))) < 1e-6


BY_LAW = (
    "tooth_friction:mu=0.08",
    "damping_law:share=0.4,power=0,depth=1e-5",
    "damping_law:share=0.4,power=0.5,depth=1e-5",
    "contact_nonlinearity:exponent=1.1",
    "ring_flexibility@rp:stiffness=3e9",
    "tooth_crack@sp:depth=0.3,member=sun,position=3.2; tooth_friction:mu=0.05",
)
PERIODIC = {"xi": 0.07, "delta_T": 90.0}  # an orbit that loses contact in every mesh cycle


def both_ways(text: str, **values: Any) -> tuple[Stepper, Stepper, Array, Array]:
    """A gear by its slots and by its laws, and the state of each after 200 mesh cycles."""
    actives = read_effects(text)
    slots = assemble(build(Parameters(**PERIODIC, **values)), actives)
    core, mine = Stepper(slots), LawStepper(by_laws(slots, actives))
    y, _ = core.advance_cycles(core.start().y, np.zeros((0, core.model.n_state)), 0, 200)
    n = slots.layout.n_state
    return core, mine, y, mine.with_added_values(run_on(mine, y[:n]), core.added_states(y))


def run_on(machine: Stepper, y: Array) -> Array:
    return np.concatenate([y, machine.start().y[len(y) :]])


@pytest.mark.parametrize("text", BY_LAW)
def test_twenty_cycles_that_lose_contact_are_exact_to_1e_6(text: str) -> None:
    """Against the slots, whose series share nothing with it, at a higher order."""
    _, mine, y, start = both_ways(text)
    fine = both_ways(text, order=16, steps_per_cycle=48)[0]
    wanted, _ = fine.advance_cycles(y, np.zeros((0, y.size)), 200, 20)
    block = mine.advance(replace(mine.start(), y=start, cycle=200), 20 * 16)
    n = mine.model.layout.n_state
    assert block.switches >= 8 * 20
    np.testing.assert_allclose(block.end.y[:n], wanted[:n], atol=1e-6, rtol=0)


@pytest.mark.parametrize(
    ("text", "error"), [*((text, 1e-7) for text in ("", BY_LAW[1], BY_LAW[4])), (BY_LAW[0], 1e-4)]
)
def test_tangents_are_those_of_the_slots(text: str, error: float) -> None:
    """Monodromy matrix of a mesh cycle with switches; own states in pairs by laws."""
    core, mine, y, start = both_ways(text)
    n, size = core.model.layout.n_state, y.size
    order = [*range(n), *(n + np.arange(size - n).reshape(-1, 2).T.ravel())]
    _, wanted = core.advance_cycles(y, np.eye(size), 200, 1)
    _, found = mine.advance_cycles(start, np.eye(size), 200, 1)
    np.testing.assert_allclose(found[np.ix_(order, order)], wanted, atol=error)


def test_an_independent_method_confirms_a_law_that_no_slot_holds() -> None:
    """Eight mesh cycles, each with losses of contact, against DOP853 with located events."""
    thin = replace(effect("damping_law"), fill=None)
    actives = [Active(thin, (0.4, 0.0, 1e-5))]
    machine = stepper(build(Parameters(**PERIODIC)), actives)
    assert type(machine) is LawStepper
    start = machine.advance(machine.start(), 100 * 16).end
    found = machine.advance(start, 8 * 16)
    assert found.switches >= 8 * 8
    wanted = integrate(machine.model, actives, start.y, start.cycle, 8, tolerance=1e-11)
    np.testing.assert_allclose(found.end.y, wanted, atol=1e-7, rtol=0)


def test_what_knows_no_plain_gear_is_compiled_once_for_all() -> None:
    """Runge-Kutta and the laws take gears with friction and without for one type."""
    friction = read_effects("tooth_friction:mu=0.08")
    for method, one_kernel in (("rk4", True), ("taylor", False)):
        model = rig(method=method)
        assert Stepper(model).alike(Stepper(assemble(model, friction))) == one_kernel
    gears = [LawStepper(by_laws(rig(), some)).gear.p for some in ((), friction)]
    assert typeof(gears[0]) == typeof(gears[1])


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
    "pin_position": (PLANET_3, {"offset": 1e-5}, {"e_offset": mask(PLANET_3, 1e-5, 0.0)}),
    "backlash_offset": (RING, {"offset": 5e-6}, {"b_offset": mask(RING, 5e-6, 0.0)}),
    "thermal_backlash": (RING, {"rate": 1e-7}, {"b_offset": mask(RING, HOT * 1e-7, 0.0)}),
    "thermal_stiffness": (RING, {"rate": 1e-3}, {"k_factor": mask(RING, 1.0 - HOT * 1e-3, 1.0)}),
    "stiffness_harmonic": (ALL, {"cos": 0.1, "sin": 0.0, "order": 2}, {"k_amp": (0.25, 0.1)}),
    "profile_error": (ALL, {"cos": 0.0, "sin": 7e-6, "order": 2}, {"e_amp": (1.0, 0.2)}),
}


@pytest.mark.parametrize("name", OTHER_PARAMETERS)
def test_an_effect_that_is_another_parameter_gives_that_motion(name: str) -> None:
    place, values, other = OTHER_PARAMETERS[name]
    core = Stepper(rig(**other))
    mine = laws(rig(), active(effect(name), place, values))
    a, b = run(core), run(mine, y=core.start().y)
    plain = run(Stepper(rig()), y=core.start().y)
    here = slice(5 + 24, None)  # forces and bodies: x and v of a recording hold the nominal error
    size = np.abs(a.rows[:, here]).max(axis=0)
    assert (np.abs(a.rows - b.rows)[:, here] / size).max() < 1e-6
    assert (np.abs(a.rows - plain.rows)[:, here] / size).max() > 1e-2


def test_an_effect_of_no_size_leaves_the_motion_alone_to_the_bit() -> None:
    none = [
        Active(effect(name), tuple(effect(name).neutral), Locus("rp"))
        for name in ("mean_stiffness", "profile_error", "ring_flexibility", "tooth_friction")
    ]
    cut_alike = none[-1]  # where a law reads forces, steps end where they change sign
    a, b = run(laws(rig(), cut_alike)), run(laws(rig(), *none))
    assert np.array_equal(a.rows, b.rows)
    assert largest_difference(run(laws(rig())), b) < 1e-6


def test_blocks_of_any_size_give_the_same_samples_to_the_bit() -> None:
    machine = laws(rig(), active(effect("ring_flexibility"), RING))
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
    push = evaluate(model, [one], motion(model, series)).torque
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


def test_divergence_is_told() -> None:
    for machine in (laws(rig(), active(effect("mean_stiffness"), ALL)), laws(rig())):
        start = machine.start()
        far = replace(start, y=1e7 + start.y)
        assert machine.advance(far, 4).diverged
        y, _ = machine.advance_cycles(far.y * 1e8, np.zeros((0, far.y.size)), 0, 1)
        assert not np.isfinite(y).all()
    with pytest.raises(DivergenceError, match="mean_stiffness"):
        simulate(rig(), [active(effect("mean_stiffness"), ALL)], 1, far)


def test_warning_filters_are_restored_whoever_leaves_first() -> None:
    """Threads compile side by side, and the filters are those of the process."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        before, first = list(warnings.filters), ExitStack()
        first.enter_context(pointers_allowed())
        with pointers_allowed():
            first.close()
            warnings.warn("a pointer", NumbaExperimentalFeatureWarning, stacklevel=1)
        assert list(warnings.filters) == before


def test_the_interpreter_reads_what_is_compiled(tmp_path: Path) -> None:
    here = Path(__file__).resolve().parents[1]
    path = os.pathsep.join([str(here), str(here.parent)])
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path}
    code = "import numpy, interpreted_effects as i; numpy.save('out.npy', i.run_by_laws())"
    command = [sys.executable, "-W", "ignore", "-c", code]
    subprocess.run(command, env=environment, check=True, timeout=200, cwd=tmp_path)
    read = np.load(tmp_path / "out.npy")
    np.testing.assert_allclose(run_by_laws(), read, rtol=1e-6, atol=1e-9)


def test_a_tangent_of_zero_stays_zero_where_the_force_jumps() -> None:
    p = Parameters(delta_T=30.0, samples_per_cycle=4, steps_per_cycle=8)
    gear = by_laws(build(p), read_effects("damping_law:share=0.4,power=0,depth=1e-5"))
    y = np.linspace(-0.4, 0.4, gear.n_state)
    _, tangents = LawStepper(gear).advance_cycles(y, np.zeros((1, gear.n_state)), 0, 2)
    np.testing.assert_array_equal(tangents, 0.0)


def test_states_by_laws_are_not_read_as_samples() -> None:
    gear = by_laws(build(Parameters()), read_effects("mean_stiffness:factor=1.1"))
    with pytest.raises(ParameterError, match="samples of states"):
        LawStepper(gear).read(np.zeros((1, gear.n_state)), np.zeros((1, 2), dtype=int))


def test_samples_before_a_delay_do_not_depend_on_the_blocks() -> None:
    """A delay that is switched on later shows what was before, however the run was cut."""
    gear, shown = stepper(build(Parameters()), ()), []
    delay = read_effects("sensor_delay:delay=2e-4,channels=x_sp_L")
    for size in (4, 64):
        sensors, state = Sensors(gear, ()), gear.start()
        for _ in range(64 // size):
            block = gear.advance(state, size)
            sensors.show(block)
            state = block.end
        later = sensors.followed(gear, delay, state.t)
        shown.append(later.show(gear.advance(state, 16)).rows)
    np.testing.assert_array_equal(*shown)
