"""Broken campaigns through the command line: what is wrong is named, the rest is diagnosed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from gap_support import POINTS, ROLES, noisy, sampled

from herringbone_sim.__main__ import main
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import RecordingError
from herringbone_sim.gap.campaign_checks import check
from herringbone_sim.gap.data.prepare import prepare
from herringbone_sim.gap.diagnose import diagnose
from herringbone_sim.recording.campaign import read_campaign
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.recording.writer import RunWriter

RIG = Path(__file__).resolve().parents[2] / "config" / "rig.yaml"
OWN = {"k_factor": [1.2] * 6 + [1.0] * 6}


@pytest.fixture(scope="module")
def series() -> list[TimeSeries]:
    return [noisy(sampled(OWN, point, 24), 0.01, i) for i, point in enumerate(POINTS)]


def entries() -> list[dict[str, Any]]:
    return [
        {"path": f"run_{i:02d}", **point, "role": role}
        for i, (point, role) in enumerate(zip(POINTS, ROLES, strict=True))
    ]


def write(folder: Path, series: list[TimeSeries], runs: list[Any]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for i, one in enumerate(series):
        writer = RunWriter.create(folder, f"run_{i:02d}", "/rig", {"source": "rig"}, one.names, 0)
        writer.write_samples(one.data)
        writer.close()
    content = {"rig": "mine", "noise": {"kind": "white", "rms_share": 0.01}, "runs": runs}
    (folder / "campaign.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return folder


def changed(series: TimeSeries, channel: str, first: int, add: float) -> TimeSeries:
    data = series.data.copy()
    data[first:, series.names.index(channel)] += add
    return TimeSeries(data[:, 0].copy(), data, series.names)


def gap(folder: Path, out: Path, nominal: Path = RIG) -> int:
    return main(["gap", str(folder), "--nominal", str(nominal), "--out", str(out)])


def test_four_faults_are_named_and_the_cause_is_still_found(
    tmp_path: Path, series: list[TimeSeries], capsys: pytest.CaptureFixture[str]
) -> None:
    broken = [
        changed(series[0], "F_sp1_L", 0, np.nan),
        changed(series[1], "t", 200, 0.01),
        series[2],
    ]
    runs = [*entries(), {**entries()[0], "path": "run_07"}, {"path": "run_08", "role": "fit"}]
    folder = write(tmp_path / "rig", broken, runs)
    assert gap(folder, tmp_path / "out") == 0
    made = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    found = {(f["what"], f["run"]): f for f in made["findings"]}
    assert set(found) >= {
        ("missing", "run_07"),
        ("missing", "run_08"),
        ("nan", "run_00"),
        ("clock", "run_01"),
    }
    assert found["nan", "run_00"]["channels"] == ["F_sp1_L"]
    assert found["clock", "run_01"]["time_s"] == series[1].times[199]
    assert {f["text"] for f in made["findings"]} <= set(made["undecidable"])
    assert made["causes"][0]["effect"] in {"mean_stiffness", "thermal_stiffness"}
    shown = capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "What is wrong with the recording" in page
    for part in (shown, page):
        assert "the clock of run_01 jumps by 0.01" in part
        assert "F_sp1_L of run_00 is no number" in part


def test_a_nominal_file_of_another_rig_names_no_effect(
    tmp_path: Path, series: list[TimeSeries], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write(tmp_path / "rig", series, entries())
    other = tmp_path / "other.yaml"
    text = RIG.read_text(encoding="utf-8")
    assert "k_m_sp: 1.5e+09" in text
    other.write_text(text.replace("k_m_sp: 1.5e+09", "k_m_sp: 2.5e+09"), encoding="utf-8")
    assert gap(folder, tmp_path / "out", other) == 0
    made = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert (made["verdict"], made["effects"], made["where"]) == ("unknown", [], [])
    assert [f["what"] for f in made["findings"]] == ["nominal"]
    assert "the nominal file does not match this rig" in capsys.readouterr().out


def test_without_a_run_to_fit_there_is_an_error_that_says_so(
    tmp_path: Path, series: list[TimeSeries], capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [{**entry, "role": "held_out"} for entry in entries()]
    folder = write(tmp_path / "rig", series, runs)
    assert gap(folder, tmp_path / "out") == 2
    assert "no run has the role fit" in capsys.readouterr().err


def test_one_run_alone_leaves_heat_and_load_open(tmp_path: Path, series: list[TimeSeries]) -> None:
    folder = write(tmp_path / "rig", series[:1], entries()[:1])
    found = diagnose(prepare(folder, load_parameters(RIG)))
    assert np.isnan(found.report.gap.closure)
    assert {"mean_stiffness", "thermal_stiffness"} <= set(found.report.verdict.ambiguous_with)
    told = " ".join(found.report.undecidable)
    assert "run_00 is the only run to fit" in told
    assert "no run is held out" in told


def test_a_run_that_was_cut_off_is_used_as_far_as_it_goes(
    tmp_path: Path, series: list[TimeSeries]
) -> None:
    folder = write(tmp_path / "rig", series, entries())
    shutil.rmtree(folder / "run_01")
    writer = RunWriter.create(folder, "run_01", "/rig", {}, series[1].names, 0)
    for block in np.array_split(series[1].data, 12):
        writer.write_samples(block)
        writer.flush()
    writer.close()
    file = next((folder / "run_01").glob("*.mcap"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 3 // 5])
    campaign, findings = check(prepare(folder, load_parameters(RIG)))
    (cut,) = [f for f in findings if f.what == "cut_off"]
    assert (cut.run, cut.channels) == ("run_01", ("t",))
    run = campaign.runs[1]
    assert 0 < len(run) < len(series[1])
    assert cut.time_s == pytest.approx(series[1].times[len(run) - 1])


@pytest.mark.parametrize("share", [0.0, -0.1, 40.0, "40 dB", True])
def test_a_share_of_noise_that_can_not_be_is_refused(
    tmp_path: Path, series: list[TimeSeries], share: object
) -> None:
    folder = write(tmp_path / "rig", [], entries())
    content = yaml.safe_load((folder / "campaign.yaml").read_text(encoding="utf-8"))
    content["noise"]["rms_share"] = share
    (folder / "campaign.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(RecordingError, match="rms_share"):
        read_campaign(folder)


def test_faults_of_entries_are_told_and_the_others_are_kept(tmp_path: Path) -> None:
    first, second, third = entries()
    del second["T_1"]
    namesake = {**third, "path": "day_2/run_02"}
    folder = write(tmp_path / "rig", [], [first, second, third, first, "run_09", namesake])
    read = read_campaign(folder)
    assert [run.path.name for run in read.runs] == ["run_00", "run_02"]
    assert [name for name, _ in read.faults] == ["run_01", "run_00", "entry 4", "day_2/run_02"]
    assert "T_1 is missing" in read.faults[0][1]
    assert "twice" in read.faults[1][1]
    assert "a name of its own" in read.faults[3][1]


@pytest.mark.parametrize("path", ["", ".", "..", "../rig/run_00", "day_2/../../run_00", "/run_00"])
def test_a_run_outside_of_the_campaign_is_not_used(tmp_path: Path, path: str) -> None:
    first, second, third = entries()
    folder = write(
        tmp_path, [], [first, second | {"path": path}, third | {"path": "day_2/run_02"}]
    )
    read = read_campaign(folder)
    assert [run.path for run in read.runs] == [folder / "run_00", folder / "day_2" / "run_02"]
    ((name, reason),) = read.faults
    assert name == (path or "entry 1")
    assert "path must lead to a folder inside" in reason


def test_without_noise_the_cause_is_found_and_the_lack_told(
    tmp_path: Path, series: list[TimeSeries]
) -> None:
    folder = write(tmp_path / "rig", series, entries())
    file = folder / "campaign.yaml"
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    del content["noise"]
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    found = diagnose(prepare(folder, load_parameters(RIG)), senses=False)
    assert found.report.causes[0].effect in {"mean_stiffness", "thermal_stiffness"}
    assert any("gives no noise" in text for text in found.report.undecidable)
    assert found.report.runner_up_effects
