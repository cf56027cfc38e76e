"""``gap`` writes the augmented model, ``gap verify`` finds its numbers again on further runs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from gap_support import NOMINAL, OMEGA_N, POINTS, check_report, noisy, prepared, sampled

from herringbone_sim.__main__ import main
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import distort
from herringbone_sim.effects.effect import Active, Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.attribution.effect_forces import fused_run
from herringbone_sim.gap.attribution.effect_torques import effect_accelerations
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.further_runs import repeat
from herringbone_sim.gap.report_file import StoredReport, read_report
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.sensors.consistency import consistency_chi2
from herringbone_sim.gap.sensors.correction import correct_sensors, is_motion_sensor_effect
from herringbone_sim.gap.verdict.augmented import Augmented
from herringbone_sim.gap.verification.residual_gap import residual_gap
from herringbone_sim.gap.verification.senses import Senses
from herringbone_sim.recording.parameter_file import load_gear
from herringbone_sim.recording.writer import RunWriter

DATA_SHEET = ["--nominal", str(Path(__file__).resolve().parents[2] / "config" / "rig.yaml")]
SIZE = 1.15
OWN = {"k_m_sp": SIZE * NOMINAL.k_m_sp, "c_factor": [SIZE**-0.5] * 6 + [1.0] * 6}
FURTHER = ({"delta_T": 60.0, "K": 0.0, "T_1": 700.0, "Omega": 0.8},)


def written(
    folder: Path, points: tuple[dict[str, float], ...], roles: tuple[str, ...], seed: int
) -> Path:
    """A campaign of the stiffer rig in a folder, 40 dB."""
    runs = []
    for i, (point, role) in enumerate(zip(points, roles, strict=True)):
        series = noisy(sampled(OWN, point, 40), 0.01, seed + i)
        writer = RunWriter.create(folder, f"run_{i}", "/rig", {}, series.names, 0)
        writer.write_samples(series.data)
        writer.close()
        runs.append({"path": f"run_{i}", "role": role, **point})
    content = {"rig": "stiffer", "noise": {"kind": "white", "rms_share": 0.01}, "runs": runs}
    (folder / "campaign.yaml").write_text(yaml.safe_dump(content))
    return folder


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the campaign ``rig`` and what ``gap`` wrote of it in ``out``."""
    folder = tmp_path_factory.mktemp("gap")
    fitted = written(folder / "rig", POINTS, ("fit", "fit", "held_out"), 1)
    assert main(["gap", str(fitted), *DATA_SHEET, "--out", str(folder / "out")]) == 0
    return folder


def test_the_verdict_is_written_as_a_gear_with_its_gap_in_three_senses(diagnosed: Path) -> None:
    out = diagnosed / "out"
    report = json.loads((out / "report.json").read_text())
    assert check_report(report) == []
    assert report["verdict"] == "mean_stiffness"
    own, actives = load_gear(out / "augmented.yaml")
    assert own.omega_n == pytest.approx(OMEGA_N)
    assert [one.effect.id for one in actives] == ["mean_stiffness"]
    assert actives[0].theta[0] == pytest.approx(SIZE, abs=0.03)
    for name, sense in report["gap"]["senses"].items():
        assert sense["closure"] > 0.8, name
    page = (out / "report.html").read_text()
    assert page.index("How much") < page.index("In three senses")


def test_the_verdict_holds_on_further_runs(
    diagnosed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = written(tmp_path / "more", FURTHER, ("fit",), 9)
    there = ["--report", str(diagnosed / "out"), "--out", str(tmp_path / "again")]
    assert main(["gap verify", str(more), *DATA_SHEET, *there]) == 0
    shown = capsys.readouterr().out
    assert shown.count(", 1 runs") == shown.count(", report") == 3
    told = json.loads((tmp_path / "again" / "verify.json").read_text())
    report = json.loads((diagnosed / "out" / "report.json").read_text())
    assert [run["path"] for run in told["gap"]["runs"]] == ["run_0"]
    assert told["reported"]["residual"]["closure"] == report["gap"]["closure"]
    for sense in ("residual", "prediction"):
        numbers = told["gap"]["senses"][sense]
        assert numbers["nominal"] > 2.0 * numbers["noise_floor"], sense
        assert numbers["closure"] > 0.8, sense
    assert "further runs" in (tmp_path / "again" / "verify.html").read_text()


def test_the_runs_of_the_diagnosis_give_its_numbers_again(diagnosed: Path, tmp_path: Path) -> None:
    there = ["--report", str(diagnosed / "out"), "--out", str(tmp_path)]
    assert main(["gap", "verify", str(diagnosed / "rig"), *DATA_SHEET, *there]) == 0
    report = json.loads((diagnosed / "out" / "report.json").read_text())["gap"]["senses"]
    told = json.loads((tmp_path / "verify.json").read_text())["gap"]["senses"]
    chaotic = [run["exponent"]["value"] > 0.0 for run in report["prediction"]["runs"]]
    assert not all(chaotic)
    for name, sense in report.items():
        pairs = list(zip(sense["runs"], told[name]["runs"], strict=True))
        if name == "attractor":  # rounding alone picks another piece of a chaotic one
            pairs = [pair for pair, wild in zip(pairs, chaotic, strict=True) if not wild]
        for before, again in pairs:
            # The horizon follows the exponent of a chaotic model, which rounding alone moves:
            # errors of noise, which grow with it, have differed by 13 %.
            same = before.get("horizon_cycles") == again.get("horizon_cycles")
            close = 1e-3 if same else 0.25
            # The diagnosis calibrates a common filter besides, and takes off what sensors may do:
            # drift and hum of so short runs take up to a tenth of the noise with them.
            apart = {"nominal": 0.01, "augmented": 0.1} if name == "residual" else {}
            for key in ("nominal", "augmented", "noise_floor"):
                rel = apart.get(key, close)
                assert again[key] == pytest.approx(before[key], rel=rel), (name, key)


@pytest.mark.parametrize("text", ["", "{}", '{"gap": {"metric": "guess"}}'])
def test_a_folder_without_a_report_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "report.json").write_text(text)
    with pytest.raises(AnalysisError, match="give the folder"):
        read_report(tmp_path / "report.json")


SENSORS = (
    active(effect("sensor_gain"), values={"gain": 1.08, "channels": ("x_sp2_L",)}),
    active(effect("sensor_bias"), values={"bias": 2e-5, "channels": ("x_rp1_R",)}),
    active(effect("sensor_delay"), values={"delay": 3e-6, "channels": ("v_sp3_L",)}),
    active(effect("sensor_gain"), Locus("rp"), {"gain": 0.95, "channels": ("v",)}),
    active(effect("channel_swap"), values={"channels": ("x_sp1_L", "x_rp2_R")}),
    active(effect("clock_drift"), values={"ppm": 2e4}),
    active(effect("clock_drift"), values={"ppm": -300.0, "channels": ("x_sp1_L", "x_sp2_L")}),
)


@pytest.mark.parametrize("one", SENSORS, ids=lambda one: f"{one.effect.id} {one.chosen}")
def test_a_recording_is_put_right_by_the_sensor_effect_of_the_verdict(one: Active) -> None:
    whole = noisy(sampled({}, POINTS[0], 20), 3e-3, 4)
    clean = TimeSeries(whole.times - whole.times[0], whole.data, whole.names)
    shown = distort(clean, (one,))
    right, wrong = (prepared(series, POINTS[0], share=3e-3) for series in (clean, shown))
    mended = correct_sensors(wrong, (one,))
    before, after, best = (consistency_chi2([run]) for run in (wrong, mended, right))
    assert before > 2.0 * best
    assert after - best < 0.1 * (before - best)  # a delay is undone by interpolation


def test_force_sensors_are_left_to_the_law() -> None:
    one = active(effect("sensor_gain"), Locus("sp"), {"gain": 1.1})
    assert not is_motion_sensor_effect(one)
    assert is_motion_sensor_effect(SENSORS[-1])
    run = prepared(sampled({}, POINTS[0], 4), POINTS[0])
    same = correct_sensors(run, (one,))
    np.testing.assert_array_equal(same.F.values, run.F.values)


def test_an_effect_on_the_bodies_is_measured_once() -> None:
    run = prepared(noisy(sampled({}, POINTS[0]), 0.01, 3), POINTS[0], "held_out")
    ripple = active(effect("torque_ripple"), values={"amplitude": 1.5, "order": 7})
    with_ripple = Augmented(np.ones(6), np.ones(3), (ripple,))
    found = residual_gap((run,), lambda one: one, "torque_balance", with_ripple).runs[0]
    one = fused_run(run, fuse(run))
    size = effect_accelerations(one, np.ones(6), force_law(run, one.fused, np.ones(6)), ripple)
    expected = np.hypot(found.nominal, np.sqrt(np.mean(size**2)))  # a rig without has it missing
    assert found.augmented > 2.0 * found.nominal
    assert found.augmented == pytest.approx(expected, rel=0.05)


def test_without_forces_the_gap_is_named_one_of_accelerations() -> None:
    run = prepared(noisy(sampled({}, POINTS[0]), 0.01, 3), POINTS[0], "held_out")
    model = Augmented(np.ones(6), np.ones(3), motion=True)
    found = residual_gap((run,), lambda one: one, "force_law", model)
    assert (found.metric, found.unit) == ("torque_balance", "m/s^2")


def test_a_gap_of_trajectories_is_not_measured_as_another() -> None:
    report = StoredReport("rig", "runout", ("runout",), "trajectory", {})
    campaign = PreparedCampaign("more", NOMINAL, (), ())
    with pytest.raises(AnalysisError, match="'trajectory' can't be measured"):
        repeat(campaign, NOMINAL, (), report)


def test_a_delay_of_all_channels_is_no_gap_of_further_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A phase that is ahead of all channels by 4 us: sensors are calibrated as in a diagnosis."""
    series, point = noisy(sampled({}, POINTS[0], 20), 1e-3, 3), POINTS[0]
    data = series.data.copy()
    data[:, series.names.index("phase")] += 4e-6 * point["Omega"] * OMEGA_N
    late = prepared(TimeSeries(series.times, data, series.names), point, share=1e-3)
    campaign = PreparedCampaign("late", NOMINAL, (late,), ())
    report = StoredReport("rig", "none", (), "force_law", {})
    # The other senses are not looked at, and take longest.
    monkeypatch.setattr(
        "herringbone_sim.gap.further_runs.measure_senses",
        lambda runs, correct, gap, *_: Senses(gap, gap, gap),
    )
    (found,) = repeat(campaign, NOMINAL, (), report).senses.residual.runs
    assert found.nominal < 1.5 * found.floor
    model = Augmented(np.ones(6), np.ones(3))
    (wrong,) = residual_gap((late,), lambda run: run, "force_law", model).runs
    assert wrong.nominal > 5.0 * wrong.floor
