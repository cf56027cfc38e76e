"""Sweeps of gears with effects: against other parameters, continued, stored, from the shell."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from herringbone_sim.__main__ import main
from herringbone_sim.core.integrate import largest_exponent
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.assemble import by_laws
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.law_stepper import LawStepper
from herringbone_sim.effects.registry import VARIABLE, effect
from herringbone_sim.effects.stepper import change, stepper
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import save_parameters
from herringbone_sim.sweeps import chains
from herringbone_sim.sweeps.chains import job_of, observe_parts
from herringbone_sim.sweeps.grid import (
    Axis,
    Observation,
    Sweep,
    default_chunk,
    with_sweep_steps,
)
from herringbone_sim.sweeps.grid_json import sweep_from_json
from herringbone_sim.sweeps.observe import Table
from herringbone_sim.sweeps.store import load_result, load_store

SOFT = "mean_stiffness@all/all/all:factor=0.9"
RING = "ring_flexibility@rp/all/all:stiffness=3e9"


def gear(**values: object) -> Parameters:
    return with_sweep_steps(Parameters().changed({"delta_T": 85.0, **values}), {})


def table_of(sweep: Sweep) -> Table:
    tables = []
    parts = range(sweep.n_parts)
    before = None
    for part in parts[::-1] if sweep.downwards else parts:
        tables.append(observe_parts([job_of(sweep, part, before)])[0])
        ends = tables[-1].get("end")
        if ends is not None:
            before = ends[:1] if sweep.downwards else ends[-1:]
    rows = np.argsort(np.concatenate([table["index"] for table in tables]))
    return {name: np.concatenate([t[name] for t in tables])[rows] for name in tables[0]}


LOOK = Observation(transient=150, cycles=60, points=60, mesh="sp_L")
AXIS = Axis("delta_T", (80.0, 85.0, 90.0))


@pytest.mark.parametrize("start", ["fixed", "up", "ramp_down"])
def test_an_effect_that_is_another_parameter_gives_that_diagram(start: str) -> None:
    other = table_of(Sweep(gear(k_factor=[0.9]), (AXIS,), LOOK, start))
    mine = table_of(Sweep(gear(), (AXIS,), LOOK, start, effects=SOFT))
    np.testing.assert_allclose(mine["points"], other["points"], atol=2e-3)
    if start != "ramp_down":
        assert np.array_equal(mine["period"], other["period"])
        np.testing.assert_allclose(mine["exponent"], other["exponent"], atol=0.01)
        np.testing.assert_allclose(mine["sun_drive"], other["sun_drive"], atol=0.03)
    plain = table_of(Sweep(gear(), (AXIS,), LOOK, start))
    assert np.abs(mine["points"] - plain["points"]).max() > 0.02


@pytest.mark.parametrize("start", ["fixed", "up", "ramp_down"])
def test_a_law_that_no_slot_holds_gives_that_diagram(
    start: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "soft.py"
    file.write_text(
        "from herringbone_sim.effects.effect import Effect\n"
        "from herringbone_sim.effects.law import STIFFNESS, law\n"
        "@law\n"
        "def excite(theta, site, gear, now, added_states, law):\n"
        "    for m in range(law.shape[1]):\n"
        "        law[STIFFNESS, m] *= 0.9\n"
        "EFFECT = Effect('soft', 'softer', 'mesh', (), excite=excite)\n"
    )
    monkeypatch.setenv(VARIABLE, str(file))
    other = table_of(Sweep(gear(k_factor=[0.9]), (AXIS,), LOOK, start))
    mine = table_of(Sweep(gear(), (AXIS,), LOOK, start, effects="soft"))
    np.testing.assert_allclose(mine["points"], other["points"], atol=1e-6)
    if start != "ramp_down":
        assert np.array_equal(mine["period"], other["period"])
        np.testing.assert_allclose(mine["sun_drive"], other["sun_drive"], atol=1e-6)
        np.testing.assert_allclose(mine["exponent"], other["exponent"], atol=0.01)
        assert np.isnan(mine["transverse"]).all()


@pytest.mark.parametrize("start", ["up", "ramp_up", "ramp_down"])
def test_chains_hand_own_states_on_in_parts_of_any_size(start: str) -> None:
    look = Observation(transient=7, cycles=5, points=5, mesh="sp_L", exponents=False)
    text = f"{RING}; runout@rp:amplitude=2e-5,member=ring"
    whole, cut = (
        table_of(Sweep(gear(control_order=0.3, K=0.1), (AXIS,), look, start, chunk, text))
        for chunk in (3, 1)
    )
    assert whole["end"].shape[1] == 8 + 4
    np.testing.assert_array_equal(whole["points"], cut["points"])
    np.testing.assert_array_equal(whole["end"], cut["end"])


@pytest.mark.parametrize(
    ("text", "start", "expected"),
    [
        ("", "fixed", 256),
        (RING, "fixed", 256),
        (RING, "up", 16),
        ("damping_law", "fixed", 256),
        ("damping_law; damping_law@sp:power=1", "fixed", 16),  # no slot holds both
    ],
)
def test_a_gear_by_the_laws_of_its_effects_is_swept_in_small_parts(
    text: str, start: str, expected: int
) -> None:
    assert default_chunk(gear(), read_effects(text), start) == expected


def test_the_exponent_of_chaos_is_that_of_the_tangent_flow() -> None:
    model = build(Parameters().changed({"delta_T": 20.0}))
    exact, error = largest_exponent(model, 1500, 200)
    machine = LawStepper(by_laws(model, []))
    state = machine.advance(machine.start(tangents=1), 200 * 16).end
    end = machine.advance(state, 1500 * 16).end
    found = (end.growth - state.growth)[0] * model.packed.Omega / (2 * np.pi * 1500)
    assert exact > 0.05
    assert abs(found - exact) < 5.0 * error


def test_own_states_stay_where_an_effect_stays() -> None:
    model = build(Parameters(model="full", delta_T=85.0))
    ring, stiffer = (
        active(effect("ring_flexibility"), Locus("rp"), {"stiffness": k}) for k in (3e9, 5e9)
    )
    crack = active(effect("tooth_crack"), Locus("sp", "1", "L"))
    machines = [stepper(model, ones) for ones in ([ring], [crack, stiffer], [crack], [ring], [])]
    state = machines[0].advance(machines[0].start(tangents=1), 50).end
    n = model.layout.n_state
    kept = state.y[n:]
    assert np.abs(kept).min() > 0.0
    for (old, new), own in zip(
        itertools.pairwise(machines), (kept, [], np.zeros(4), []), strict=True
    ):
        state = change(old, new, state)
        np.testing.assert_allclose(state.y[n:], own, rtol=1e-14)
        assert state.tangents.shape == (1, state.y.size)


def test_a_description_goes_there_and_back_and_is_checked() -> None:
    sweep = Sweep(gear(), (AXIS,), LOOK, effects=SOFT)
    assert sweep_from_json(sweep.to_json()) == sweep
    with pytest.raises(ParameterError, match="planet of a locus"):
        Sweep(gear(), (AXIS,), LOOK, effects="mean_stiffness@sp/1/L")


def test_the_commands_take_a_file_with_effects(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "gear.yaml"
    soft = active(effect("mean_stiffness"), Locus(), {"factor": 0.9})
    save_parameters(file, Parameters(delta_T=85.0), actives=(soft,))
    common = ["--parameters", str(file), "--transient", "20", "--cycles", "20", "--workers", "1"]
    out = tmp_path / "diagram"
    assert main(["sweep", *common, "--over", "delta_T=80:90:3", "--out", str(out)]) == 0
    assert f"with effects: {SOFT}" in capsys.readouterr().out
    assert load_result(load_store(out / "fixed")).sweep.effects == SOFT
    two = ["--over", "delta_T=80:90:2", "--over", "K=0:0.1:2"]
    assert main(["map", *common, *two, "--out", str(tmp_path / "map")]) == 0


def test_a_motion_that_repeats_with_a_member_is_not_called_aperiodic_for_too_few_points() -> None:
    """A run-out of the sun repeats after 27 mesh cycles, of which 80 hold less than five."""
    runout = read_effects("runout@sp/all/all:amplitude=2e-5,member=sun")
    axes = (Axis("delta_T", (85.0, 86.0)),)
    look = Observation(200, 80, 80)
    few = table_of(Sweep.of_gear(gear(), runout, axes, look, "fixed"))
    assert np.isnan(few["period"]).all()
    plain = table_of(Sweep.of_gear(gear(), (), axes, look, "fixed"))
    assert np.isfinite(plain["period"]).all()


def test_a_ramp_carries_over_from_value_to_value() -> None:
    """Omega changes the rate of e(t): the ramp is one motion, as of the node's live changes."""
    base = with_sweep_steps(Parameters(), {})
    sweep = Sweep(base, (Axis("Omega", (0.9, 1.0)),), Observation(2, 4, 2, False), "ramp_up")
    ends = observe_parts([job_of(sweep, 0)])[0]["end"]
    values = [0.9] * 6 + list(np.linspace(0.9, 1.0, 5)[1:])
    states, _ = chains.ramp([base.changed({"Omega": value}) for value in values])
    assert states is not None
    np.testing.assert_array_equal(ends, states[[6, 10]])


def test_added_states_keep_their_si_values_along_a_chain() -> None:
    """States of a ring are in units of b_c, which doubles: the numbers halve."""
    text, base = "ring_flexibility@rp:stiffness=3e9", with_sweep_steps(Parameters(), {})
    axes = (Axis("b_c", (1e-4, 2e-4)),)
    sweep = Sweep(base, axes, Observation(2, 4, 2, False), "up", 1, text)
    end = observe_parts([job_of(sweep, 0)])[0]["end"]
    job = job_of(sweep, 1, end)
    starts = chains._starts(job, job.rows[0])
    assert starts is not None
    np.testing.assert_allclose(2.0 * starts[0, 8:], end[0, 8:], rtol=1e-12)
