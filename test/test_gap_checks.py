"""Bad input is named, with channel and time, and what is left can still be used."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from gap_support import NOMINAL, POINTS, noisy, prepared, rig, sampled

from herringbone_sim.core.model import build
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.gap.checks import check
from herringbone_sim.gap.fusion import fuse
from herringbone_sim.gap.prepared import PreparedCampaign, PreparedRun, mesh_table, prepare
from herringbone_sim.gap.screen import Finding
from herringbone_sim.recording.writer import RunWriter

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")


@pytest.fixture(scope="module")
def series() -> TimeSeries:
    return noisy(sampled({}, POINTS[0]), 0.01, 5)


@pytest.fixture(scope="module")
def others() -> tuple[PreparedRun, ...]:
    return rig({}).runs


def with_first(
    first: PreparedRun, others: tuple[PreparedRun, ...]
) -> tuple[PreparedCampaign, list[Finding]]:
    runs = (first, *others[1:])
    campaign = PreparedCampaign("mine", NOMINAL, runs, mesh_table(NOMINAL.layout), ())
    kept, findings = check(campaign)
    return kept, list(findings)


def edited(series: TimeSeries, channel: str, rows: slice, value: float) -> TimeSeries:
    data = series.data.copy()
    data[rows, series.names.index(channel)] = value
    return TimeSeries(series.times, data, series.names)


def test_a_good_campaign_has_nothing_to_say(others: tuple[PreparedRun, ...]) -> None:
    _, findings = with_first(others[0], others)
    assert findings == []


def test_nan_is_named_with_its_time_and_the_mesh_is_still_known(
    series: TimeSeries, others: tuple[PreparedRun, ...]
) -> None:
    bad = edited(series, "x_sp2_R", slice(100, None), np.nan)
    kept, (finding,) = with_first(prepared(bad, POINTS[0]), others)
    assert (finding.what, finding.channels) == ("nan", ("x_sp2_R",))
    assert finding.time_s == series.times[100]
    assert not kept.runs[0].x.there[4]
    assert np.isfinite(fuse(kept.runs[0]).x).all()


def test_a_saturated_sensor(series: TimeSeries, others: tuple[PreparedRun, ...]) -> None:
    j = series.names.index("F_rp1_L")
    data = series.data.copy()
    limit = 0.5 * data[:, j].max()
    data[:, j] = np.minimum(data[:, j], limit)
    bad = TimeSeries(series.times, data, series.names)
    _, findings = with_first(prepared(bad, POINTS[0]), others)
    finding = next(f for f in findings if f.what == "saturated")
    assert finding.channels == ("F_rp1_L",)
    at = int(np.searchsorted(series.times, finding.time_s))
    assert data[at, j] == limit


def test_a_sensor_that_is_off(series: TimeSeries, others: tuple[PreparedRun, ...]) -> None:
    bad = edited(series, "v_rp3_L", slice(None), 0.0)
    _, (finding, limit) = with_first(prepared(bad, POINTS[0]), others)
    assert (finding.what, finding.channels) == ("still", ("v_rp3_L",))
    assert (limit.what, limit.text[:5]) == ("scope", "rates")


@pytest.mark.parametrize(("prefix", "factor"), [("x", 1e3), ("F", 1e-3), ("v", 1e3)])
def test_a_wrong_unit(
    series: TimeSeries, others: tuple[PreparedRun, ...], prefix: str, factor: float
) -> None:
    data = series.data.copy()
    columns = [j for j, n in enumerate(series.names) if n.startswith(f"{prefix}_")]
    data[:, columns] *= factor
    bad = TimeSeries(series.times, data, series.names)
    kept, findings = with_first(prepared(bad, POINTS[0], name="run_00"), others)
    units = [f for f in findings if f.what == "unit"]
    assert {c[0] for f in units for c in f.channels} == {prefix}
    assert {len(f.channels) for f in units} == {12}
    for run in kept.runs:
        assert getattr(run, prefix).there.all() == (run.name != "run_00")


def test_a_clock_that_jumps(series: TimeSeries, others: tuple[PreparedRun, ...]) -> None:
    data = series.data.copy()
    data[300:, 0] += 0.01
    bad = TimeSeries(data[:, 0].copy(), data, series.names)
    _, findings = with_first(prepared(bad, POINTS[0]), others)
    clock = next(f for f in findings if f.what == "clock")
    assert clock.time_s == series.times[299]


def test_a_run_of_another_gear_is_left_out(others: tuple[PreparedRun, ...]) -> None:
    other = sampled({"omega_n": 30000.0}, POINTS[0])
    kept, findings = with_first(prepared(other, POINTS[0]), others)
    assert [f.what for f in findings if f.fatal] == ["other_gear"]
    assert len(kept.runs) == 2


def test_a_point_that_the_recording_contradicts(
    series: TimeSeries, others: tuple[PreparedRun, ...]
) -> None:
    bad = edited(series, "T_1", slice(50, None), 400.0)
    _, findings = with_first(prepared(bad, POINTS[0]), others)
    assert findings[0].what == "point"
    assert findings[0].time_s == pytest.approx(series.times[50] - series.times[0])


def test_one_run_none_held_out_and_a_nominal_of_another_rig(
    others: tuple[PreparedRun, ...],
) -> None:
    one = PreparedCampaign("mine", NOMINAL, others[:1], mesh_table(NOMINAL.layout), ())
    assert {f.what for f in check(one)[1]} == {"no_held_out", "one_run"}
    held = PreparedCampaign("mine", NOMINAL, others[2:], mesh_table(NOMINAL.layout), ())
    assert any(f.what == "no_fit" and f.fatal for f in check(held)[1])
    stiffer = NOMINAL.changed({"k_m_sp": 2.0e9})
    moved = tuple(_with_nominal(run, stiffer.k_m_sp) for run in others)
    wrong = PreparedCampaign("mine", stiffer, moved, mesh_table(NOMINAL.layout), ())
    assert "nominal" in {f.what for f in check(wrong)[1]}


def _with_nominal(run: PreparedRun, k_m_sp: float) -> PreparedRun:
    return replace(run, model=build(run.model.parameters.changed({"k_m_sp": k_m_sp})))


def test_a_missing_run_is_told_with_its_reason(others: tuple[PreparedRun, ...]) -> None:
    campaign = PreparedCampaign(
        "mine", NOMINAL, others, mesh_table(NOMINAL.layout), (("run_07", "there is no run_07"),)
    )
    first = check(campaign)[1][0]
    assert (first.what, first.run) == ("missing", "run_07")


def test_a_folder_with_a_missing_and_a_cut_run(tmp_path: Path, series: TimeSeries) -> None:
    writer = RunWriter.create(tmp_path, "run_00", "/rig", {}, series.names, 0)
    writer.write_samples(series.data)
    writer.close()
    file = next((tmp_path / "run_00").glob("*.mcap"))
    file.write_bytes(file.read_bytes()[:-2000])
    runs = [{"path": f"run_0{i}", "role": "fit", **POINTS[0]} for i in range(2)]
    content = {"rig": "mine", "noise": {"kind": "white", "rms_share": 0.01}, "runs": runs}
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump(content))
    campaign = prepare(tmp_path, NOMINAL)
    assert [name for name, _ in campaign.missing] == ["run_01"]
    assert any(f.what == "recording" for f in campaign.runs[0].findings)
