"""Bad input is named, with channel and time, and what is left can still be used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from gap_support import NOMINAL, POINTS, noisy, prepared, rig, sampled

from herringbone_sim.core.model import build
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.campaign_checks import check
from herringbone_sim.gap.data.folds import leave_out_folds
from herringbone_sim.gap.data.noise import spectral_floor
from herringbone_sim.gap.data.prepare import (
    all_noise_told,
    noise_is_known,
    prepare,
    prepare_run,
    told_noise,
)
from herringbone_sim.gap.data.prepared import PreparedCampaign, PreparedRun
from herringbone_sim.gap.data.screen import Finding, finding_texts
from herringbone_sim.gap.diagnose import diagnose
from herringbone_sim.gap.observations.calibration.noise_report import recorded_noise
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.residuals.foreign_runs import runs_with_other_force_law
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.sensors.detrended import settle_detrended
from herringbone_sim.gap.sensors.noise import with_estimated_noise
from herringbone_sim.recording.campaign import CampaignRun
from herringbone_sim.recording.channels import Channels
from herringbone_sim.recording.reader import Recording
from herringbone_sim.recording.writer import RunWriter


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
    campaign = PreparedCampaign("mine", NOMINAL, runs, ())
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
    assert not kept.runs[0].x.recorded[4]
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
        assert getattr(run, prefix).recorded.all() == (run.name != "run_00")


def test_a_clock_that_jumps_leaves_the_longer_part(
    series: TimeSeries, others: tuple[PreparedRun, ...]
) -> None:
    data = series.data.copy()
    data[300:, 0] += 0.01
    bad = TimeSeries(data[:, 0].copy(), data, series.names)
    kept, (clock,) = with_first(prepared(bad, POINTS[0]), others)
    assert (clock.what, clock.channels, clock.time_s) == ("clock", ("t",), series.times[299])
    np.testing.assert_allclose(kept.runs[0].times, bad.times[300:] - bad.times[0])
    np.testing.assert_array_equal(kept.runs[0].F.values[:, 0], bad["F_sp1_L"][300:])


def test_a_dropout_of_the_recorder_does_not_cost_the_channels(
    series: TimeSeries, others: tuple[PreparedRun, ...]
) -> None:
    data = series.data.copy()
    data[700:720, 1:] = np.nan
    bad = TimeSeries(data[:, 0].copy(), data, series.names)
    kept, (hole,) = with_first(prepared(bad, POINTS[0]), others)
    assert (hole.what, hole.time_s) == ("dropout", series.times[700])
    assert len(kept.runs[0]) == 700
    assert kept.runs[0].F.complete


def test_a_phase_that_starts_anew_at_every_turn_is_unwrapped(
    series: TimeSeries, others: tuple[PreparedRun, ...]
) -> None:
    data = series.data.copy()
    j = series.names.index("phase")
    data[:, j] = np.mod(data[:, j], 2.0 * np.pi)
    bad = TimeSeries(series.times, data, series.names)
    kept, (phase,) = with_first(prepared(bad, POINTS[0]), others)
    assert (phase.what, phase.channels) == ("phase", ("phase",))
    assert "unwrapped" in phase.text
    turned = kept.runs[0].phase - series["phase"]
    np.testing.assert_allclose(turned, turned[0], atol=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda phase: -phase, "runs backwards"),
        (lambda phase: 0.0 * phase, "stands still"),
        (lambda phase: np.nan * phase, "is no number"),
    ],
)
def test_a_phase_that_does_not_go_forward_ends_the_run(
    series: TimeSeries, change: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    data = series.data.copy()
    j = series.names.index("phase")
    data[:, j] = change(data[:, j])
    with pytest.raises(AnalysisError, match=words):
        prepared(TimeSeries(series.times, data, series.names), POINTS[0])


@pytest.mark.parametrize(
    ("channel", "factor", "words"),
    [("t", 1e3, "milliseconds"), ("phase", 180.0 / np.pi, "degrees")],
)
def test_a_clock_in_another_unit(
    series: TimeSeries,
    others: tuple[PreparedRun, ...],
    channel: str,
    factor: float,
    words: str,
) -> None:
    data = series.data.copy()
    data[:, series.names.index(channel)] *= factor
    bad = TimeSeries(data[:, 0].copy(), data, series.names)
    kept, findings = with_first(prepared(bad, POINTS[0], name="odd"), others)
    (unit,) = [f for f in findings if f.what == "unit"]
    assert (unit.run, unit.channels, words in unit.text) == ("odd", (channel,), True)
    assert [run.name for run in kept.runs] == ["run_01", "run_02"]


def test_a_unit_that_the_recorder_declares(series: TimeSeries) -> None:
    told = Channels(units={"x_sp1_L": "mm", "x_sp2_L": "m"})
    recording = Recording(Path("run"), "run", series, told, (), True, ())
    run = prepare_run(CampaignRun(Path("run"), POINTS[0], "fit"), recording, NOMINAL, 0.01)
    (finding,) = run.findings
    assert (finding.what, finding.channels) == ("unit", ("x_sp1_L",))
    assert not run.x.recorded[0]


def test_noise_of_single_channels_is_taken_as_told(series: TimeSeries) -> None:
    """Where the noise of all is told it need not be estimated; that of an angle is in rad."""
    sensors = {
        name: {"rms": 2e-7} for name in series.names if name[:2] in ("x_", "v_", "F_", "u_")
    }
    sensors["angle_c"] = {"rms": 1e-6}
    run = CampaignRun(Path("run"), POINTS[0], "fit")
    recording = Recording(Path("run"), "run", series, Channels(), (), True, ())
    found = prepare_run(run, recording, NOMINAL, None, {"x_sp1_L": {"rms": 3e-7}})
    estimated = prepare_run(run, recording, NOMINAL, None)
    assert found.x.sigma[0] == pytest.approx(3e-7, rel=1e-3)
    assert with_estimated_noise(found).x.sigma[0] == found.x.sigma[0]
    np.testing.assert_array_equal(found.x.sigma[1:], estimated.x.sigma[1:])
    noise = recorded_noise(GearObservations([found]).runs, False)
    assert noise["x_sp1_L"].told == pytest.approx(3e-7, rel=1e-3)
    assert noise["x_sp2_L"].told is None
    assert all_noise_told([found], sensors)
    assert not all_noise_told([found], {n: one for n, one in sensors.items() if n != "F_sp1_L"})
    told = told_noise(found.model, {"angle_c": {"rms": 1e-6}})
    assert told == {"u_c": pytest.approx(1e-6 * found.model.scales.r_bc)}


def test_raw_angles_are_read_as_rotations_without_a_mean(series: TimeSeries) -> None:
    """Encoders that count from any mark; beside displacements their rotations are left out."""
    sc, p = build(NOMINAL).scales, NOMINAL
    data, names = series.data.copy(), list(series.names)
    at = names.index("u_c")
    data[:, at] = 0.3 + series["phase"] / p.z_r + series["u_c"] / sc.r_bc
    names[at] = "angle_c"
    run = prepared(TimeSeries(series.times, data, tuple(names)), POINTS[0])
    assert run.detrended == ("u_c",)
    # A share of an RMS without its mean is no noise: that of the spectrum is taken.
    other = prepared(series, POINTS[0])
    assert not noise_is_known([run], 0.01, {})
    assert noise_is_known([other], 0.01, {})
    assert run.u.sigma[2] == pytest.approx(spectral_floor(run.u.values)[2])
    assert np.array_equal(np.delete(run.u.sigma, 2), np.delete(other.u.sigma, 2))
    assert run.u.complete
    assert not run.means_known
    assert np.std(run.u.values[:, 2]) == pytest.approx(np.std(series["u_c"]), rel=0.02)
    # Law and balance are formed without them, although a run lacks a displacement, too.
    lacking = run.without("x", np.arange(12) == 0)
    for one in settle_detrended([run, lacking]):
        assert one.means_known
        assert not one.u.recorded[2]
    # Windows are all that shafts alone allow.
    few = run.without("x", np.ones(12, bool)).without("v", np.ones(12, bool))
    few = few.without("F", np.ones(12, bool))
    (kept,) = settle_detrended([few])
    assert kept.detrended == ("u_c",)
    assert kept.u.recorded[2]


def test_raw_angles_in_degrees_are_left_out_and_a_dead_encoder_is_named(
    series: TimeSeries,
) -> None:
    names = tuple("angle_c" if n == "u_c" else n for n in series.names)
    data = series.data.copy()
    data[:, names.index("u_s_L")] = np.nan
    recording = Recording(
        Path("run"),
        "run",
        TimeSeries(series.times, data, names),
        Channels(units={"angle_c": "deg"}),
        (),
        True,
        (),
    )
    run = prepare_run(CampaignRun(Path("run"), POINTS[0], "fit"), recording, NOMINAL, 0.01)
    assert not run.u.recorded[[0, 2]].any()
    found = {(finding.what, finding.channels) for finding in run.findings}
    assert {("unit", ("angle_c",)), ("nan", ("u_s_L",))} <= found


def test_channels_of_another_gear(series: TimeSeries) -> None:
    names = tuple(n.replace("sp3", "sp4") for n in series.names)
    run = prepared(TimeSeries(series.times, series.data, names), POINTS[0])
    (finding,) = run.findings
    assert finding.what == "foreign"
    assert set(finding.channels) == {f"{q}_sp4_{side}" for q in "xvF" for side in "LR"}


@pytest.mark.parametrize("bits", [16, 9, 7])
def test_a_coarse_converter_is_noise_and_not_saturation(
    series: TimeSeries, others: tuple[PreparedRun, ...], bits: int
) -> None:
    data = series.data.copy()
    steps = 2.0 * np.abs(data[:, 5:]).max(axis=0) / 2.0**bits
    data[:, 5:] = np.round(data[:, 5:] / steps) * steps
    run = prepared(TimeSeries(series.times, data, series.names), POINTS[0])
    assert with_first(run, others)[1] == []
    mesh = np.hypot(others[0].x.sigma[0], steps[0] / np.sqrt(12.0))
    np.testing.assert_allclose(run.x.sigma[0], mesh, rtol=0.02)


def test_a_run_whose_geometry_is_another(others: tuple[PreparedRun, ...]) -> None:
    x = others[0].x
    bad = replace(others[0], x=replace(x, values=x.values + 0.5 * others[0].waves.e))
    kept, (finding, *_) = with_first(bad, others)
    assert (finding.what, finding.run) == ("other_gear", "run_00")
    assert len(kept.runs) == 2


@pytest.mark.parametrize("error", ["gain", "bias", "delay", "drift", "swap"])
def test_errors_of_sensors_are_left_to_the_step_that_names_them(
    others: tuple[PreparedRun, ...], error: str
) -> None:
    def erring(run: PreparedRun) -> PreparedRun:
        values = run.x.values.copy()
        late = 1e-4 * run.times if error == "drift" else 0.3 * run.step_s
        wrong = {
            "gain": 1.3 * values,
            "bias": values + 3e-5,
            "swap": values[:, [3, 1, 2, 0, *range(4, 12)]],
        }.get(error, values - np.reshape(late, (-1, 1)) * run.v.values)
        return replace(run, x=replace(run.x, values=wrong))

    runs = tuple(erring(run) for run in others)
    kept, findings = with_first(runs[0], runs)
    assert findings == []
    assert all(run.x.complete for run in kept.runs)


def test_a_law_that_one_run_breaks_on_every_mesh(others: tuple[PreparedRun, ...]) -> None:
    middle = {"delta_T": 60.0, "K": 0.0, "T_1": 1000.0, "Omega": 0.5}
    hot = {**middle, "delta_T": 99.0}
    shares = {run.name: np.full(12, 0.02) for run in others}
    for point, out in ((middle, True), (hot, False)):
        odd = replace(others[0], name="odd", point=point)
        fit = [replace(run, role="fit") for run in others]
        (finding,) = runs_with_other_force_law([*fit, odd], {**shares, "odd": np.full(12, 0.9)})
        assert (finding.run, finding.fatal) == ("odd", out)
    held = replace(others[0], name="odd", point=middle, role="held_out")
    (finding,) = runs_with_other_force_law([*fit, held], {**shares, "odd": np.full(12, 0.9)})
    assert not finding.fatal


def test_the_same_recording_twice(others: tuple[PreparedRun, ...]) -> None:
    runs = (*others, replace(others[0], name="again", role="held_out"))
    campaign = PreparedCampaign("mine", NOMINAL, runs, ())
    kept, (finding,) = check(campaign)
    assert (finding.what, finding.run) == ("copy", "again")
    assert len(kept.runs) == 3


def test_one_run_is_taken_in_parts(others: tuple[PreparedRun, ...]) -> None:
    assert leave_out_folds(others) == others
    parts = leave_out_folds(others[:1])
    assert len(parts) == 3
    np.testing.assert_array_equal(np.concatenate([p.F.values for p in parts]), others[0].F.values)
    np.testing.assert_array_equal(np.concatenate([p.waves.k for p in parts]), others[0].waves.k)


def test_a_run_that_is_too_short(series: TimeSeries, others: tuple[PreparedRun, ...]) -> None:
    for cycles, out in ((5, True), (12, False)):
        short = TimeSeries(series.times[: 24 * cycles], series.data[: 24 * cycles], series.names)
        kept, (finding, *_) = with_first(prepared(short, POINTS[0], name="run_00"), others)
        assert (finding.what, finding.fatal) == ("short", out)
        assert finding.time_s == pytest.approx(short.times[-1] - short.times[0])
        assert len(kept.runs) == (2 if out else 3)


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
    one = PreparedCampaign("mine", NOMINAL, others[:1], ())
    assert {f.what for f in check(one)[1]} == {"no_held_out", "one_run"}
    held = PreparedCampaign("mine", NOMINAL, others[2:], ())
    assert any(f.what == "no_fit" and f.fatal for f in check(held)[1])
    stiffer = NOMINAL.changed({"k_m_sp": 2.0e9})
    moved = tuple(_with_nominal(run, stiffer.k_m_sp) for run in others)
    wrong = PreparedCampaign("mine", stiffer, moved, ())
    assert "nominal" in {f.what for f in check(wrong)[1]}
    hard = tuple(replace(run, waves=replace(run.waves, k=3.0 * run.waves.k)) for run in others)
    found = check(PreparedCampaign("mine", NOMINAL, hard, ()))[1]
    assert [f.what for f in found] == ["nominal"]


def _with_nominal(run: PreparedRun, k_m_sp: float) -> PreparedRun:
    return replace(run, model=build(run.model.parameters.changed({"k_m_sp": k_m_sp})))


def test_a_missing_run_is_told_with_its_reason(others: tuple[PreparedRun, ...]) -> None:
    campaign = PreparedCampaign("mine", NOMINAL, others, (("run_07", "there is no run_07"),))
    first = check(campaign)[1][0]
    assert (first.what, first.run) == ("missing", "run_07")


def test_what_runs_have_in_common_is_said_once() -> None:
    same = [Finding("recording", f"run_0{i}", (), None, f"run_0{i}: no units") for i in range(3)]
    other = Finding("clock", "run_01", ("t",), 0.1, "run_01 jumps back")
    assert finding_texts([same[0], other, *same[1:]]) == [
        "run_00, run_01, run_02: no units",
        "run_01 jumps back",
    ]


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


def test_the_load_of_a_rig_with_a_pin_off_its_place_fits_its_torque() -> None:
    """One planet carries it all there, and presses the others the other way."""
    pin = active(effect("pin_position"), Locus("all", "2", "all"), {"offset": 1.5e-5})
    campaign = rig({}, cycles=120, actives=[pin])
    assert not [one for one in check(campaign)[1] if one.what == "torque"]
    other = {"T_1": 6.0 * POINTS[1]["T_1"]}
    heavy = replace(
        campaign.runs[1], model=build(campaign.runs[1].model.parameters.changed(other))
    )
    _, findings = check(replace(campaign, runs=(campaign.runs[0], heavy)))
    (found,) = (one for one in findings if one.what == "torque")
    assert found.run == heavy.name


def test_a_campaign_without_a_usable_run_is_told_so(others: tuple[PreparedRun, ...]) -> None:
    """Clocks in ms: all runs are left out, and there is nothing to diagnose."""
    runs = tuple(replace(run, times=1e3 * run.times) for run in others)
    campaign = PreparedCampaign("mine", NOMINAL, runs, ())
    kept, findings = check(campaign)
    assert not kept.runs
    assert any(finding.fatal for finding in findings)
    with pytest.raises(AnalysisError, match="no run of role fit is left"):
        diagnose(campaign, senses=False)


def test_held_out_runs_do_not_hide_a_nominal_file_of_another_rig() -> None:
    """All fit runs of a gear of three times the stiffness, the held-out run of the nominal one."""
    stiff = {"k_m_sp": 3.0 * NOMINAL.k_m_sp, "k_m_rp": 3.0 * NOMINAL.k_m_rp}
    omega_n = build(NOMINAL).scales.omega_n
    runs = (*rig({**stiff, "omega_n": omega_n}).of_role("fit"), *rig({}).of_role("held_out"))
    campaign = PreparedCampaign("mine", NOMINAL, runs, ())
    assert any(finding.what == "nominal" for finding in check(campaign)[1])
