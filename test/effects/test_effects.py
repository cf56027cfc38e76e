"""Effects: found by scanning, neutral sizes change nothing, sensors change the recording alone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import distort, names_of, on_channels
from herringbone_sim.effects.effect import Active, Effect, Locus, active
from herringbone_sim.effects.evaluate import Motion, evaluate, forces, motion
from herringbone_sim.effects.registry import VARIABLE, effect, effects
from herringbone_sim.effects.sensors import check_sensors
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import AnalysisError, ParameterError

CATALOGUE = {
    *("mean_stiffness", "stiffness_harmonic", "stagger", "planet_phase", "tooth_crack"),
    *("tooth_spall", "runout", "pin_position", "backlash_offset", "thermal_backlash"),
    *("thermal_stiffness", "tooth_friction", "contact_nonlinearity", "damping_law"),
    *("profile_error", "ring_flexibility", "bearing_clearance", "torque_ripple"),
    *("sensor_gain", "sensor_bias", "sensor_delay", "clock_drift", "channel_swap"),
}
MACHINE = sorted(name for name in CATALOGUE if effect(name).level != "sensor")
OWN = '''
from herringbone_sim.effects.effect import Effect, Parameter
from herringbone_sim.effects.law import DAMPING, law


@law
def excite(theta, site, gear, now, added_states, law):
    """c times the factor."""
    for m in range(law.shape[1]):
        if site[0, m] != 0.0:
            law[DAMPING, m] *= theta[0]


EFFECT = Effect(
    id="{name}",
    text="damping off by a factor",
    level="mesh",
    parameters=(Parameter("factor", "-", "c over its own", 0.0, 9.0, 1.1, neutral=1.0),),
    excite=excite,
)
'''


@pytest.fixture(scope="module")
def rig() -> Model:
    return build(Parameters(model="full", delta_T=40.0, mesh_phase=(0.0, 0.3, 0.0) * 4))


@pytest.fixture(scope="module")
def series(rig: Model) -> TimeSeries:
    return simulate(rig, 40)[0]


@pytest.fixture(scope="module")
def moved(rig: Model, series: TimeSeries) -> Motion:
    return motion(rig, series)


def at_start(name: str, model: Model) -> Active:
    one = effect(name)
    place = one.candidates(model.layout)[0]
    place = Locus("sp", "1", "L") if "tooth_" in name and name != "tooth_friction" else place
    return Active(one, tuple(one.start), place)


def test_the_catalogue_is_that_of_the_contract() -> None:
    assert set(effects()) == CATALOGUE


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_every_effect_is_told_and_bounded(name: str, rig: Model) -> None:
    one = effect(name)
    low, high = one.bounds
    assert one.text
    assert np.all((low <= one.start) & (one.start <= high))
    assert len(set(one.candidates(rig.layout))) == len(one.candidates(rig.layout)) > 0


def test_without_effects_the_forces_are_those_of_the_model(rig: Model, moved: Motion) -> None:
    found = evaluate(rig, [], moved)
    np.testing.assert_allclose(found.force, moved.force, atol=1e-9 * np.abs(found.force).max())
    assert not found.torque.any()


@pytest.mark.parametrize("name", MACHINE)
def test_an_effect_of_no_size_changes_nothing_to_the_bit(
    name: str, rig: Model, moved: Motion
) -> None:
    one = at_start(name, rig)
    plain, none = (
        evaluate(rig, [], moved),
        evaluate(rig, [one.with_theta(one.effect.neutral)], moved),
    )
    some = evaluate(rig, [one], moved)
    assert np.array_equal(plain.force, none.force)
    assert not none.torque.any()
    assert (some.force != plain.force).any() or some.torque.any()


@pytest.mark.parametrize("name", MACHINE)
def test_an_effect_stays_at_its_place(name: str, rig: Model, moved: Motion) -> None:
    one = at_start(name, rig)
    touched = (forces(rig, [one], moved) != forces(rig, [], moved)).any(axis=0)
    assert not np.any(touched & (one.locus.mask(rig.layout) == 0.0))


def test_two_effects_act_together(rig: Model, moved: Motion) -> None:
    stiff = active(effect("mean_stiffness"), Locus("sp"), {"factor": 1.2})
    worn = active(effect("backlash_offset"), Locus("rp"), {"offset": 1e-5})
    both = forces(rig, [stiff, worn], moved)
    assert np.array_equal(both[:, :6], forces(rig, [stiff], moved)[:, :6])
    assert np.array_equal(both[:, 6:], forces(rig, [worn], moved)[:, 6:])


def test_own_states_need_measured_forces(rig: Model, series: TimeSeries) -> None:
    names = tuple(name for name in series.names if not name.startswith("F_"))
    blind = motion(rig, TimeSeries(series.times, series.columns(names), names))
    with pytest.raises(AnalysisError, match="measured forces"):
        evaluate(rig, [at_start("ring_flexibility", rig)], blind)


def test_a_users_file_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rig: Model, moved: Motion
) -> None:
    file = tmp_path / "damping_factor.py"
    file.write_text(OWN.format(name="damping_factor"))
    monkeypatch.setenv(VARIABLE, str(file))
    mine = active(effect("damping_factor"), values={"factor": 2.0})
    more = forces(rig, [mine], moved) - forces(rig, [], moved)
    c_v = rig.damping_n_s_per_m * moved.v
    np.testing.assert_allclose(more, c_v, rtol=0, atol=1e-9 * np.abs(moved.force).max())


@pytest.mark.parametrize(
    ("text", "rule"),
    [("EFFECT = 1", "must hold EFFECT"), (OWN.format(name="runout"), "two effects are named")],
)
def test_a_users_file_that_is_none_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, rule: str
) -> None:
    file = tmp_path / "wrong.py"
    file.write_text(text)
    monkeypatch.setenv(VARIABLE, str(file))
    with pytest.raises(ParameterError, match=rule):
        effects()


@pytest.mark.parametrize(
    ("name", "values", "rule"),
    [
        ("mean_stiffness", {"factor": 99.0}, "must lie in"),
        ("mean_stiffness", {"depth": 0.1}, "it has factor"),
        ("mean_stiffness", {"factor": "much"}, "a number"),
        ("mean_stiffness", {"factor": True}, "a number"),
        ("mean_stiffness", {"factor": np.True_}, "a number"),
        ("runout", {"member": "carrier"}, "one of"),
    ],
)
def test_a_wrong_value_is_refused(name: str, values: dict[str, object], rule: str) -> None:
    with pytest.raises(ParameterError, match=rule):
        active(effect(name), values=values)


@pytest.mark.parametrize("number", [np.int64(1), np.float32(1.5), 1])
def test_any_kind_of_number_is_taken(number: Any) -> None:
    (factor,) = active(effect("mean_stiffness"), values={"factor": number}).theta
    assert (type(factor), factor) == (float, float(number))


def test_a_place_that_the_gear_lacks_is_refused(rig: Model, moved: Motion) -> None:
    with pytest.raises(ParameterError, match="planet of a locus"):
        forces(rig, [active(effect("mean_stiffness"), Locus("sp", "7", "L"))], moved)
    with pytest.raises(ParameterError, match="set its mesh to sp"):
        forces(rig, [active(effect("runout"), Locus("rp"))], moved)


def test_gain_bias_delay_swap_and_drift_change_what_they_say(series: TimeSeries) -> None:
    place = Locus("rp", "2", "R")
    gain = active(effect("sensor_gain"), place, {"gain": 1.3})
    bias = active(effect("sensor_bias"), place, {"bias": 5.0})
    swap = active(effect("channel_swap"), values={"channels": ("x_sp1_L", "v_rp2_R")})
    drift = active(effect("clock_drift"), values={"ppm": -200.0})
    found = distort(series, (gain, bias, swap, drift))
    np.testing.assert_allclose(found["F_rp2_R"], 1.3 * series["F_rp2_R"] + 5.0)
    assert np.array_equal(found["x_sp1_L"], series["v_rp2_R"])
    assert np.array_equal(found["v_rp2_R"], series["x_sp1_L"])
    np.testing.assert_allclose(found["t"], series.times * (1.0 - 2e-4))
    assert np.array_equal(found.times, found["t"])
    same = [n for n in series.names if n not in ("t", "F_rp2_R", "x_sp1_L", "v_rp2_R")]
    assert all(np.array_equal(found[n], series[n]) for n in same)


def test_a_clock_of_some_channels_needs_the_whole_recording(series: TimeSeries) -> None:
    """A stream is asked for samples ever further away: it says so; a recording shows them."""
    layout = Parameters(model="full").layout
    drift = active(effect("clock_drift"), values={"ppm": 300.0, "channels": ("x_sp1_L",)})
    with pytest.raises(ParameterError, match="clock_drift of x_sp1_L"):
        check_sensors(layout, (drift,))
    check_sensors(layout, (active(effect("clock_drift")),))
    found = distort(series, (drift,))
    same = [n for n in series.names if n != "x_sp1_L"]
    assert all(np.array_equal(found[n], series[n]) for n in same)
    assert not np.array_equal(found["x_sp1_L"], series["x_sp1_L"])


def test_a_delay_shows_the_past() -> None:
    times = np.linspace(0.0, 1.0, 400)
    wave = TimeSeries(times, np.stack([times, np.sin(9.0 * times)], axis=1), ("t", "F_sp_L"))
    late = active(effect("sensor_delay"), values={"delay": 7e-4})
    found = distort(wave, (late,))["F_sp_L"]
    np.testing.assert_allclose(found[1:], np.sin(9.0 * (times[1:] - 7e-4)), atol=2e-5)


def test_a_sensor_effect_leaves_the_machine_alone(rig: Model, moved: Motion) -> None:
    gain = active(effect("sensor_gain"), values={"gain": 2.0})
    assert np.array_equal(forces(rig, [gain], moved), forces(rig, [], moved))


def test_a_channel_that_is_not_there_is_named(series: TimeSeries) -> None:
    swap = active(effect("channel_swap"), values={"channels": ("F_sp1_L", "F_sp9_L")})
    with pytest.raises(ParameterError, match="F_sp9_L"):
        distort(series, (swap,))


def test_the_page_of_the_docs_names_every_effect_and_its_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rig: Model, moved: Motion
) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "effects.md").read_text(
        encoding="utf-8"
    )
    assert all(f"`{name}`" in page for name in CATALOGUE)
    file = tmp_path / "thermal_damping.py"
    blocks = [text.split("```")[0] for text in page.split("```python\n")[1:]]
    file.write_text(next(text for text in blocks if "EFFECT =" in text), encoding="utf-8")
    monkeypatch.setenv(VARIABLE, str(file))
    oil = active(effect("thermal_damping"), Locus("sp"), {"rate": -0.004})
    less = forces(rig, [oil], moved) - forces(rig, [], moved)
    wanted = -0.004 * 40.0 * rig.damping_n_s_per_m * moved.v
    np.testing.assert_allclose(less[:, :6], wanted[:, :6], rtol=0, atol=1e-9 * np.abs(less).max())
    assert not less[:, 6:].any()


def test_the_interpreter_reads_what_is_compiled(
    rig: Model, series: TimeSeries, tmp_path: Path
) -> None:
    few = series.rows(0, 40)
    ones = [at_start(name, rig) for name in ("planet_phase", "runout", "ring_flexibility")]
    np.savez(tmp_path / "in.npz", data=few.data, compiled=forces(rig, ones, motion(rig, few)))
    tests = Path(__file__).resolve().parents[1]
    path = os.pathsep.join([str(tests), str(tests.parent)])
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path}
    code = "import interpreted_effects; interpreted_effects.main()"
    command = [sys.executable, "-W", "ignore", "-c", code, str(tmp_path / "in.npz")]
    subprocess.run(command, env=environment, check=True, timeout=100)


def test_a_clock_of_other_channels_does_not_concern_the_forces() -> None:
    """A diagnosis names channels of motion; forces alone are shown through the other errors."""
    clock, gain = effect("clock_drift"), effect("sensor_gain")
    of_motion = Active(clock, (5.0,), Locus(), (("channels", ("v_sp_L",)),))
    of_all = Active(clock, (5.0,), Locus(), ())
    of_force = Active(gain, (1.1,), Locus(), (("channels", ("F_sp_L",)),))
    assert on_channels(("F_sp_L", "F_rp_L"), (of_motion, of_all, of_force)) == (of_all, of_force)


def test_an_effect_that_fills_slots_has_a_law_too() -> None:
    with pytest.raises(ParameterError, match="has fill alone"):
        Effect("heavy", "fills a slot", "mesh", (), fill=lambda slots, theta, mask, options: None)


def test_pin_forces_are_no_forces_of_meshes() -> None:
    (gain,) = read_effects("sensor_gain")
    assert names_of(("F_sp1_L", "F_pin1"), gain) == ("F_sp1_L",)
