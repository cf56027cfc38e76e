"""Recordings of gears with effects: repeated, described and analysed as what they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from herringbone_sim.__main__ import main
from herringbone_sim.analysis.known_gear import gear_of
from herringbone_sim.analysis.sections import Section
from herringbone_sim.analysis.segments import FREQUENCY
from herringbone_sim.api.run import read_run
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.sensors import Sensors
from herringbone_sim.effects.stepper import change, stepper
from herringbone_sim.effects.written import effects_text, read_effects
from herringbone_sim.recording.parameter_file import EFFECTS, load_gear, ros_text, values_of_gear
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.writer import RunWriter
from herringbone_sim.replay import verify

SOFT = "mean_stiffness@sp:factor=0.8"
LATE = f"{SOFT}; sensor_delay@sp:delay=2.5e-5; clock_drift:ppm=200"


def write(folder: Path, first: str, then: str, cycles: int = 80) -> Path:
    """A run whose effects change half-way, in blocks of odd sizes."""
    p, actives = Parameters(delta_T=85.0, xi=0.2), read_effects(first)
    machine = stepper(build(p), actives)
    state, sensors = machine.start(), Sensors(machine, actives)
    stored = {"y": state.y.tolist(), "cycle": 0, "index": 0, "t": 0.0}
    channels = {"parameters": values_of_gear(p, actives), "state": stored}
    channels |= {"source": "simulator", "omega_n": machine.model.scales.omega_n}
    names = machine.model.layout.channels
    writer = RunWriter.create(folder, "run", "/sim", channels, names, 0)
    for text in (first, then):
        if text == then:
            actives = read_effects(then)
            new = stepper(machine.model, actives)
            state = change(machine, new, state)
            writer.write_parameter_event(sensors.shown_s(state.t), "/sim", {"effects": then})
            sensors, machine = sensors.followed(new, actives, state.t), new
        left = cycles * 16
        while left:
            block = machine.advance(state, min(left, 37))
            writer.write_samples(sensors.show(block).rows)
            state, left = block.end, left - len(block.rows)
    writer.close()
    return writer.path


@pytest.mark.parametrize(("first", "then"), [("", SOFT), (SOFT, ""), (LATE, SOFT), ("", LATE)])
def test_a_run_is_repeated_to_the_bit(tmp_path: Path, first: str, then: str) -> None:
    run = read_recording(write(tmp_path, first, then, 20))
    verdict = verify(run)
    assert verdict.identical, verdict
    assert verdict.changes == 1


def test_a_delay_shows_the_past_without_a_seam(tmp_path: Path) -> None:
    run = read_recording(write(tmp_path, "", "sensor_delay@sp:delay=2.5e-5,channels=F", 20))
    true = read_recording(write(tmp_path / "true", "", "sensor_gain:gain=1.0", 20))
    t, at = true.samples.times, 20 * 16
    late = np.interp(t - 2.5e-5, t, true.samples["F_sp_L"])
    size = np.abs(late).max()
    np.testing.assert_allclose(run.samples["F_sp_L"][at:], late[at:], atol=0.03 * size)
    assert np.abs(run.samples["F_sp_L"] - true.samples["F_sp_L"])[at:].max() > 0.1 * size
    np.testing.assert_array_equal(run.samples["F_rp_L"], true.samples["F_rp_L"])


@pytest.mark.parametrize(
    "text",
    [
        "sensor_gain@sp:gain=1.5; sensor_bias@rp:bias=3.0; clock_drift:ppm=200",
        "channel_swap:channels=F_sp_L+F_rp_L",
        "sensor_delay@sp:delay=2.5e-5",
        "sensor_delay@sp:delay=0",
    ],
)
def test_blocks_of_a_single_sample_are_shown_as_any(text: str) -> None:
    actives = read_effects(text)
    machine = stepper(build(Parameters(delta_T=85.0)), actives)
    alike, one_by_one = Sensors(machine, actives), Sensors(machine, actives)
    state, rows = machine.start(), []
    whole = machine.advance(state, 40)
    for _ in range(40):
        block = machine.advance(state, 1)
        rows.append(one_by_one.show(block).rows)
        state = block.end
    np.testing.assert_allclose(np.concatenate(rows), alike.show(whole).rows, rtol=1e-12, atol=0.0)
    last = replace(machine.advance(state, 1), diverged=True)
    assert Sensors(machine, actives).show(last).rows.shape == last.rows.shape


def test_info_and_analyze_tell_the_effects(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, SOFT, "")
    assert main(["info", str(path)]) == 0
    assert effects_text(read_effects(SOFT)) in capsys.readouterr().out
    assert main(["analyze", str(path), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert f"effects 0: {effects_text(read_effects(SOFT))}" in said
    assert "effects 1: none" in said
    assert "mean_stiffness" in (tmp_path / "out" / "report.html").read_text()
    rows = [line.split() for line in said.splitlines() if line.strip()[:2] in ("1 ", "2 ")]
    assert [row[-3] for row in rows] == ["P1", "P1"]
    with_effect, without = (float(row[-1]) for row in rows)
    assert max(with_effect, without) < -0.1
    assert abs(with_effect - without) > 0.05


def test_the_segments_of_a_run_end_where_its_effects_change(tmp_path: Path) -> None:
    soft, plain = read_run(write(tmp_path, SOFT, "", 40)).segments
    assert (soft.segment.point[EFFECTS], plain.segment.point[EFFECTS]) == (0.0, 1.0)
    assert soft.segment.stop == plain.segment.start == pytest.approx(40 * 16, abs=1)


def test_a_run_with_an_effect_that_is_not_loaded_is_shown(tmp_path: Path) -> None:
    path = write(tmp_path, "", "", 40)
    run = replace(read_run(path), parameters={"model": "reduced", EFFECTS: "mine@sp:size=1.0"})
    assert len(run.segments) == 1
    assert "segments" in repr(run) or "samples" in repr(run)


def test_the_exponent_of_the_model_is_that_of_the_gear_with_its_effects() -> None:
    """As of the parameter that says the same; the gear loses contact, so stiffness counts."""
    values = {"delta_T": 85.0, "k_factor": [0.9]}
    soft = read_effects("mean_stiffness:factor=0.9")
    n = 200
    section = Section(np.arange(n), np.arange(n, dtype=float), *np.zeros((2, n, 4)), ("none",))

    def found(parameters: dict[str, object], sets: Sequence[tuple[Active, ...]]) -> float:
        model = build(Parameters(delta_T=85.0))
        point = {FREQUENCY: model.packed.Omega * model.scales.omega_n / (2 * np.pi)}
        exponent = gear_of(parameters, True, sets).model_exponent
        assert exponent is not None
        return exponent(point, section)[0]

    mine, wanted = found({"delta_T": 85.0}, (soft,)), found(values, ((),))
    assert mine == pytest.approx(wanted, abs=1e-6)
    assert abs(mine - found({"delta_T": 85.0}, ((),))) > 1e-4


def test_a_file_with_a_list_becomes_one_that_ros_takes(tmp_path: Path) -> None:
    file = tmp_path / "gear.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    K: 1e-4\n    record: true\n    planet_angle: []\n"
        "    effects: [{effect: mean_stiffness, locus: {mesh: sp}, parameters: {factor: 0.8}}]\n"
    )
    text = ros_text(file)
    values = yaml.safe_load(text)["/**"]["ros__parameters"]
    assert values == {"K": 1e-4, "record": True, "effects": effects_text(read_effects(SOFT))}
    gear = [line for line in text.splitlines() if "record" not in line]
    file.write_text("\n".join(gear))
    assert load_gear(file)[1] == read_effects(SOFT)
