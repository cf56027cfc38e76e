"""Columns, the derivatives by parameters, against central differences of whole runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gears import make, state_at

from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.cache import on_compiling
from herringbone_sim.core.integrate import Stepper, simulate, stepper
from herringbone_sim.core.sensitivity import Directions, in_units_of
from herringbone_sim.effects import sensitivity
from herringbone_sim.effects.assemble import build_with, by_laws
from herringbone_sim.effects.gear import acting
from herringbone_sim.effects.registry import effects
from herringbone_sim.effects.sensitivity import STEP, directions
from herringbone_sim.effects.trajectory import trajectory
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import ParameterError

LOOSE = {"delta_T": 90.0, "Omega": 1.05, "xi": 0.07}  # loses contact in every mesh cycle
BEFORE = 20  # mesh cycles run before the columns begin

GEAR = (
    "delta_T xi K T_1 Omega k_factor k_factor[2] c_factor[1] e_m e_mean e_offset[3] e_factor[0] "
    "phi_a phi_b[1] mesh_phase[2] k_amp[0] k_m_sp k_m_rp b b_c b_offset[0] beta m_n I_s I_p I_c "
    "m_p I_p_factor[1] I_s_factor[0] control_phase gamma"
)
EVENTS = (
    "tooth_crack@sp:depth=0.3,member=sun,position=21.2,width=1.3; runout@rp:member=ring,"
    "amplitude=5e-6; tooth_spall@rp:height=4e-6,member=ring,position=22.3; torque_ripple:"
    "amplitude=0.2,order=3"
)
KINDS = {  # gears with effects, and what is differentiated in each
    "events": (
        EVENTS,
        "tooth_crack@sp:depth tooth_crack@sp:position tooth_crack@sp:width runout@rp:amplitude "
        "runout@rp:phase tooth_spall@rp:height torque_ripple:amplitude torque_ripple:phase T_1",
    ),
    "harmonics": (
        "mean_stiffness@sp:factor=1.2; thermal_stiffness:rate=0.001; backlash_offset@rp:offset="
        "4e-6; stiffness_harmonic@sp:order=2,cos=0.05,sin=0.03; thermal_backlash:rate=3e-8; "
        "planet_phase:phase=0.2; pin_position:offset=3e-6; profile_error:order=3,cos=2e-6,"
        "sin=1e-6; stagger@all/all/L:phase=0.2",
        "mean_stiffness@sp:factor thermal_stiffness:rate backlash_offset@rp:offset "
        "stiffness_harmonic@sp:cos stiffness_harmonic@sp:sin thermal_backlash:rate "
        "planet_phase:phase pin_position:offset profile_error:cos profile_error:sin "
        "stagger@all/all/L:phase",
    ),
    "friction": ("tooth_friction:mu=0.08", "tooth_friction:mu T_1 k_factor[0]"),
    "jumps": (
        "damping_law:share=0.4,power=0,depth=1e-5",
        "damping_law:share delta_T e_m b Omega k_factor[0]",
    ),
    "powers": (
        "damping_law:share=0.4,power=0.5,depth=1e-5; contact_nonlinearity:exponent=1.1",
        "damping_law:share damping_law:power damping_law:depth contact_nonlinearity:exponent",
    ),
    "ring": (
        "ring_flexibility@rp:stiffness=3e9",
        "ring_flexibility@rp:stiffness ring_flexibility@rp:damping b_c k_m_sp Omega",
    ),
    "bearing": (
        "bearing_clearance:clearance=5e-6",
        "bearing_clearance:clearance bearing_clearance:stiffness bearing_clearance:damping b_c",
    ),
    "rounded": (
        "bearing_clearance:clearance=5e-6,softness=0.1",
        "bearing_clearance:clearance bearing_clearance:softness b_c",
    ),
}


def gear(text="", **values):
    return build_with(make(**LOOSE | values).parameters, read_effects(text))


def begin(model, directions=()):
    """Stepper with columns, and a state on the orbit."""
    plain, stepper = Stepper(model), Stepper(model, directions)
    end = plain.advance(plain.start(), BEFORE * model.parameters.samples_per_cycle).end
    return stepper, replace(stepper.start(), y=end.y, cycle=BEFORE)


def differences(model, names, start, cycles):
    """Central differences (p, n_state) of whole runs with two steps, their square taken off."""
    once, half = (one_difference(model, names, start, cycles, step) for step in (STEP, 0.5 * STEP))
    return (4.0 * half - once) / 3.0


def one_difference(model, names, start, cycles, step):
    """Central differences in the units of the model, over a step in parts of the sizes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sensitivity, "STEP", step)
        wanted = directions(model, names)[1]
    found = []
    for one in wanted:
        ends = []
        for other in (one.plus, one.minus):
            state = replace(state_at(in_units_of(other, model, start.y)), cycle=BEFORE)
            n = cycles * model.parameters.samples_per_cycle
            ends.append(in_units_of(model, other, Stepper(other).advance(state, n).end.y))
        found.append((ends[0] - ends[1]) / (2.0 * one.step))
    return np.array(found)


def assert_close(columns, expected, rel):
    size = np.abs(expected).max(axis=-1)
    assert (size > 0.0).all()
    assert (np.abs(columns - expected).max(axis=-1) <= rel * size).all()


def check(model, names, cycles, rel):
    """Stepper against differences, and lanes against the stepper.

    Where laws have powers the tangent series hold less far than those of the motion, to some 1e-6.
    """
    base, wanted = directions(model, names)
    stepper, start = begin(base, wanted)
    block = stepper.advance(start, cycles * base.parameters.samples_per_cycle)
    assert block.switches >= 4 * cycles
    columns = block.end.columns
    assert_close(columns, differences(model, names, start, cycles), rel)
    along, before = [Directions(base, wanted)], np.array([BEFORE])
    batch = run_batch(along, start.y[None], 0, cycles, 1, before=before)
    assert_close(batch.columns[0], columns, 3e-7)


@pytest.mark.parametrize("model", ["reduced", "full"])
def test_columns_of_gear_parameters_are_differences_of_runs(model):
    check(gear(model=model, K=0.1), GEAR.split(), 4, 1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_columns_of_effects_are_differences_of_runs(kind):
    text, names = KINDS[kind]
    check(gear(text), names.split(), 3, 5e-6 if kind in ("powers", "rounded") else 1e-6)


def test_every_effect_of_the_machine_is_checked():
    checked = {one.effect.id for text, _ in KINDS.values() for one in acting(read_effects(text))}
    assert checked == {one.id for one in effects().values() if one.level != "sensor"}


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("mean_stiffness@sp/1/L:factor", "full"),
        ("tooth_crack@sp:member=sun,position=21.0,depth", "full"),
        ("profile_error@rp:order=3,sin", "full"),
        ("tooth_friction:mu", "full"),
        ("damping_law:power=0.5,share", "reduced"),  # those with powers are long to compile
        ("contact_nonlinearity:exponent", "reduced"),
    ],
)
def test_column_of_an_effect_that_the_gear_lacks_is_its_onset(name, kind):
    """What a small one does to a run, for each unit of its size."""
    model = gear(model=kind)
    base, (one,) = directions(model, [name])
    stepper, start = begin(model, ())
    n = 2 * model.parameters.samples_per_cycle
    along = Stepper(base, [one])
    column = along.advance(replace(along.start(), y=start.y, cycle=BEFORE), n).end.columns[0]
    (there,) = acting(one.plus.effects)
    size = 1e-4 * there.effect.start[0]
    without = stepper.advance(start, n).end.y
    moved = np.flatnonzero(np.array(one.plus.effects[0].theta) != base.effects[0].theta)[0]
    theta = there.effect.neutral.copy()
    given = np.array(base.effects[0].theta)
    theta = np.where([p.neutral is None for p in there.effect.parameters], given, theta)
    theta[moved] += size
    small = build_with(model.parameters, [there.with_theta(theta)])
    run = Stepper(small).advance(replace(state_at(start.y), cycle=BEFORE), n).end.y
    expected = (run - without) / size
    assert np.abs(column - expected).max() < 2e-3 * np.abs(expected).max()


def test_columns_do_not_change_the_motion_and_carry_over_between_blocks():
    model = gear(K=0.1)
    base, wanted = directions(model, ["delta_T", "Omega"])
    assert base is model
    stepper, start = begin(model, wanted)
    whole = stepper.advance(start, 32).end
    first = stepper.advance(start, 11).end
    parts = stepper.advance(first, 21).end
    alone = Stepper(model).advance(start, 32).end
    assert np.array_equal(whole.y, alone.y)
    assert parts.columns == pytest.approx(whole.columns, rel=1e-9, abs=1e-12)


def test_alike_halves_stay_one_half_where_the_parameter_keeps_them_alike():
    """Values of both kinds in one batch: the second parameter tells left and right apart."""
    model = gear()
    starts = begin(model)[1].y[None]
    for name in ("T_1", "k_factor[0]"):
        _, wanted = directions(model, [name])
        along, before = [Directions(model, wanted)], np.array([BEFORE])
        batch = run_batch(along, starts, 0, 2, 1, True, before)
        alike = np.array_equal(batch.columns[0, 0, [0, 2]], batch.columns[0, 0, [1, 3]])
        assert alike == (name == "T_1")
        assert np.isfinite(batch.exponents[0])


def test_lanes_are_compiled_once_for_columns_of_any_number():
    """One column, many, and those of several gears are arrays of one type."""
    model = gear()
    y = begin(model)[1].y[None]

    def run(n_models, names):
        _, wanted = directions(model, names)
        starts, before = np.repeat(y, n_models, axis=0), np.full(n_models, BEFORE)
        run_batch([Directions(model, wanted)] * n_models, starts, 0, 1, 1, before=before)

    run(1, ["T_1"])
    with on_compiling(lambda: pytest.fail("compiled once more")):
        run(1, ["T_1", "delta_T"])
        run(2, ["T_1", "delta_T"])


def test_trajectory_has_the_derivatives_of_every_sample():
    """Rows, transition and columns against other starts and other gears."""
    model = gear(EVENTS)
    names = ["delta_T", "runout@rp:amplitude", "k_m_sp", "beta", "K"]
    start = begin(model)[1]
    found = trajectory(model, start.y, 40, names, cycle=BEFORE, sample=5)
    again = trajectory(model, found.states[16], 8, cycle=BEFORE + 1, sample=5)
    assert np.array_equal(again.states[0], found.states[16])
    chained = again.transition @ found.transition[16]
    assert_close(chained, found.transition[16:24], 1e-9)
    d = 1e-5
    unit = np.eye(model.n_state)[3]
    pair = [trajectory(model, start.y + s * d * unit, 40, (), BEFORE, 5) for s in (1, -1)]
    by_start = (pair[0].rows - pair[1].rows) / (2.0 * d)
    scale = np.abs(by_start).max(axis=0)[5:]
    assert (np.abs(found.by_start[:, 5:, 3] - by_start[:, 5:]) < 1e-3 * scale).all()
    for i, one in enumerate(found.directions):
        rows = []
        for other in (one.plus, one.minus):
            y = in_units_of(other, model, start.y)
            rows.append(trajectory(other, y, 40, (), BEFORE, 5).rows)
        expected = (rows[0] - rows[1]) / (2.0 * one.step)
        scale = np.abs(expected).max(axis=0)
        assert (np.abs(found.by_parameters[..., i] - expected) <= 1e-4 * scale + 1e-12).all()


def test_rows_of_a_trajectory_are_the_samples_of_a_run():
    model = gear(EVENTS)
    series, _ = simulate(model, 3)
    found = trajectory(model, Stepper(model).start().y, 48)
    assert found.rows[:, 1:] == pytest.approx(series.data[:, 1:], rel=1e-12, abs=1e-15)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("n_planets", "choice, a whole number"),
        ("model", "choice, a whole number"),
        ("initial_x", "start value"),
        ("control_order", "frequency"),
        ("stiffness", "no parameter 'stiffness'"),
        ("delta_T[0]", "one number"),
        ("k_factor[9]", "4 entries"),
        ("k_factor[x]", "no parameter"),
        ("T_2", "stands for its rule"),
        ("mean_stiffness@sp:size", "has factor"),
        ("sensor_gain:gain", "changes no motion"),
        ("no_effect:size", "no effect"),
        ("ring_flexibility@rp:stiffness", "first"),
        ("runout@rp:member=ring,amplitude", "2 effects"),
    ],
)
def test_what_has_no_derivative_is_refused_with_the_reason(name, reason):
    twice = "runout@rp:member=ring,amplitude=5e-6; runout@rp:member=ring,amplitude=2e-6"
    with pytest.raises(ParameterError, match=reason):
        directions(gear(twice), [name])


def test_a_corner_that_is_sharp_has_no_derivative_by_its_rounding():
    base, wanted = directions(
        gear("bearing_clearance:clearance=5e-6"), ["bearing_clearance:softness"]
    )
    with pytest.raises(ParameterError, match="a rounded corner"):
        Stepper(base, wanted)


def test_derivatives_need_series():
    model = make(method="rk4")
    with pytest.raises(ParameterError, match="method: taylor"):
        Stepper(model, directions(model, ["xi"])[1])
    with pytest.raises(ParameterError, match="method: taylor"):
        trajectory(model, np.zeros(model.n_state), 4)


def test_a_gear_by_its_effects_own_laws_has_no_derivatives_by_parameters():
    """Series of its slots would leave the effect out."""
    nominal, effect = make(), read_effects("mean_stiffness@sp:factor=1.2")
    law = by_laws(nominal, effect)
    y, wanted = np.zeros(law.n_state), directions(nominal, ["xi"])[1]
    with pytest.raises(ParameterError, match="fill slots"):
        trajectory(law, y, 4)
    with pytest.raises(ParameterError, match="fill slots"):
        stepper(law).trace(stepper(law).start(), 4)
    with pytest.raises(ParameterError, match="fill slots"):
        Directions(law, wanted)
    with pytest.raises(ParameterError, match="stepper"):
        Stepper(law)


def test_the_example_of_the_docs_runs() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "effects.md").read_text(
        encoding="utf-8"
    )
    blocks = [text.split("```")[0] for text in page.split("```python\n")[1:]]
    names: dict[str, Any] = {}
    exec(next(text for text in blocks if "trajectory(" in text), names)
    assert names["path"].columns.shape == (24, 4, names["model"].n_state)
    assert np.abs(names["path"].columns[-1]).max(axis=1).min() > 0.0
