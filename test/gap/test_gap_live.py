"""The live gap without ROS: breaks in a stream, planted causes found, what is missing said."""

from __future__ import annotations

import importlib
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from gap_support import NOMINAL, POINTS, noisy, sampled

from herringbone_sim.__main__ import main
from herringbone_sim.cli.options import mirror_target
from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import AnalysisError, ParameterError, RecordingError
from herringbone_sim.gap.stream.analysis import motion_at_operating_point, residual
from herringbone_sim.gap.stream.buffer import SampleBuffer
from herringbone_sim.gap.stream.comparison import Comparison, ComparisonResult, SampleStream
from herringbone_sim.recording.messages import encode_joint_state, encode_samples
from herringbone_sim.views.mirror.live_text import bar, data, line, table
from herringbone_sim.views.mirror.target import MirrorTarget

STIFF = {"k_m_sp": 1.1 * NOMINAL.k_m_sp}
ODD = {"k_factor": [1.0, 1.2, *[1.0] * 10]}


@pytest.fixture(scope="module")
def stiff() -> TimeSeries:
    return noisy(sampled(STIFF, POINTS[0], 85), 0.01, 3)


@pytest.fixture(scope="module")
def healthy() -> TimeSeries:
    return noisy(sampled({"e_factor": [1.015] * 12}, POINTS[0], 85), 0.01, 4)


def only(series: TimeSeries, *prefixes: str) -> TimeSeries:
    names = tuple(n for n in series.names if n.startswith(("t", "phase", "delta", "K", *prefixes)))
    return TimeSeries(series.times, series.columns(names), names)


def test_a_rig_inside_its_tolerance_shows_no_gap_after_recalibration(healthy: TimeSeries) -> None:
    found = residual(healthy, NOMINAL, 0.01)
    assert found.rms("nominal") > 1.3 * found.rms("floor")
    assert 0.8 < found.total_chi < 1.15
    assert not found.shares.any()


def test_a_stiffness_off_by_a_tenth_is_placed_on_the_sun(stiff: TimeSeries) -> None:
    found = residual(stiff, NOMINAL, 0.01)
    assert found.metric == "force_law"
    assert found.shares_by("kind")["sp"] > 0.97
    assert found.chi[:6].min() > 1.5
    assert found.chi[6:].max() < 1.15
    assert found.point["Omega"] == pytest.approx(POINTS[0]["Omega"], rel=1e-6)


def test_one_odd_mesh_is_named() -> None:
    found = residual(noisy(sampled(ODD, POINTS[0], 85), 0.01, 5), NOMINAL, 0.01)
    assert found.places[int(found.shares.argmax())] == "sp2_L"
    assert found.shares.max() > 0.8
    assert found.shares_by("planet")["2"] > 0.8
    assert found.shares_by("side")["L"] > 0.8


def test_without_forces_the_accelerations_tell_the_body(stiff: TimeSeries) -> None:
    found = residual(only(stiff, "x_", "v_", "u_"), NOMINAL, 0.01)
    assert found.metric == "torque_balance"
    assert found.shares[:2].sum() > 0.9
    assert found.places[:2] == ("q_L", "q_R")
    assert "no forces" in found.remarks[-1]


def test_the_reduced_gear_without_forces_leaves_its_noise() -> None:
    model = build(NOMINAL.changed({**POINTS[0], "model": "reduced"}))
    _, settled = simulate(model, 60)
    series, _ = simulate(model, 40, settled)
    found = residual(only(noisy(series, 0.01, 6), "x_", "v_"), NOMINAL, 0.01)
    assert found.metric == "torque_balance"
    assert found.total_chi < 1.2


def test_too_few_channels_have_no_residual_and_say_what_is_needed(stiff: TimeSeries) -> None:
    with pytest.raises(AnalysisError, match="needs x"):
        residual(only(stiff, "u_s", "u_c"), NOMINAL, 0.01)


def test_meshes_that_are_not_seen_are_named(stiff: TimeSeries) -> None:
    keep = tuple(n for n in stiff.names if n != "F_rp3_R")
    found = residual(TimeSeries(stiff.times, stiff.columns(keep), keep), NOMINAL, 0.01)
    assert len(found.places) == 11
    assert "rp3_R" in found.remarks[-1]


def test_an_operating_point_that_is_not_recorded_is_taken_from_where_it_is_said(
    stiff: TimeSeries,
) -> None:
    keep = tuple(n for n in stiff.names if n != "delta_T")
    bare = TimeSeries(stiff.times, stiff.columns(keep), keep)
    told = residual(bare, NOMINAL, 0.01, {"delta_T": POINTS[0]["delta_T"]})
    assert told.point["delta_T"] == POINTS[0]["delta_T"]
    assert "channels" in told.remarks[0]
    assert residual(bare, NOMINAL, 0.01).point["delta_T"] == NOMINAL.delta_T


def rows(n: int, start: float = 0.0, **values: float) -> np.ndarray:
    t = start + np.arange(n) * 1e-5
    columns = [t, 2e4 * t, np.full(n, values.get("delta_T", 20.0)), np.sin(1e3 * t)]
    return np.column_stack(columns)


NAMES = ("t", "phase", "delta_T", "x_sp1_L")


def test_a_lost_block_is_counted_and_never_computed_across() -> None:
    intake = SampleBuffer(least=10)
    intake.put(NAMES, rows(100))
    intake.put(NAMES, rows(50, 150e-5))
    taken = intake.take()
    assert intake.lost == 50
    assert taken is not None
    assert len(taken) == 50
    assert taken.times[0] == pytest.approx(150e-5)
    assert intake.take() is None


@pytest.mark.parametrize("size", [1, 2, 7])
def test_small_blocks_without_a_break_are_one_stretch(size: int) -> None:
    intake, whole = SampleBuffer(least=10), rows(98)
    for first in range(0, 98, size):
        intake.put(NAMES, whole[first : first + size])
    taken = intake.take()
    assert taken is not None
    assert (len(taken), intake.lost, intake.restarts) == (98, 0, 0)


def test_a_clock_that_goes_back_and_other_channels_start_anew() -> None:
    intake = SampleBuffer(least=10)
    intake.put(NAMES, rows(100, 1.0))
    intake.put(NAMES, rows(40))
    assert intake.restarts == 1
    intake.put(NAMES[:3], rows(30, 5.0)[:, :3])
    assert (intake.restarts, intake.lost) == (2, 0)
    taken = intake.take()
    assert taken is not None
    assert taken.names == NAMES[:3]
    assert len(taken) == 30


def test_a_change_of_temperature_cuts_the_stretch_and_drift_does_not() -> None:
    intake = SampleBuffer(least=10)
    intake.put(NAMES, rows(100, delta_T=20.0))
    intake.put(NAMES, rows(60, 100e-5, delta_T=20.1))
    intake.put(NAMES, rows(40, 160e-5, delta_T=60.0))
    taken = intake.take()
    assert taken is not None
    assert len(taken) == 40


def test_the_newest_samples_are_kept_and_no_more() -> None:
    intake = SampleBuffer(most=200, least=10)
    whole = rows(1000)
    for first in range(0, 1000, 50):
        intake.put(NAMES, whole[first : first + 50])
    taken = intake.take()
    assert taken is not None
    assert taken.times[-1] == whole[-1, 0]
    assert len(taken) == 200


def test_blocks_without_time_are_refused() -> None:
    with pytest.raises(RecordingError, match="channel t"):
        SampleBuffer().put(NAMES[1:], rows(5)[:, 1:])
    broken = rows(5)
    broken[2, 0] = np.nan
    with pytest.raises(RecordingError, match="no number"):
        SampleBuffer().put(NAMES, broken)


class Bench:
    """Two streams and a clock."""

    def __init__(self, nominal: Parameters = NOMINAL, noise: float | None = 0.01) -> None:
        self.now = 0.0
        self.rig, self.sim = (
            SampleStream(f"/{n}/samples", lambda: self.now) for n in ("rig", "sim")
        )
        self.comparison = Comparison(self.rig, self.sim, nominal, noise)

    def send(self, stream: SampleStream, series: TimeSeries) -> None:
        for first in range(0, len(series), 150):
            stream.add_samples(encode_samples(series.names, series.data[first : first + 150]))


def test_rig_and_simulator_of_different_rates_are_compared_by_statistics(
    stiff: TimeSeries,
) -> None:
    bench = Bench()
    bench.send(bench.rig, stiff)
    slow = sampled({}, POINTS[0], 85)
    bench.send(bench.sim, TimeSeries(slow.times[::2], slow.data[::2], slow.names))
    picture = bench.comparison.update()
    assert picture.comparable
    content = json.loads(json.dumps(data(picture), allow_nan=False))
    assert content["gap"] is True
    one = content["statistics"]["sp1_L"]
    shares = [one[f"{state}_rig"] for state in ("contact", "separated", "back_contact")]
    assert sum(shares) == pytest.approx(1.0)
    assert one["force_rms_simulator"] > 0.0
    assert "sp1_L" in table(picture)
    assert "a gap" in line(picture)


def test_late_stale_and_broken_streams_are_said(stiff: TimeSeries) -> None:
    bench = Bench()
    assert "nothing on /rig/samples yet" in line(bench.comparison.update())
    bench.send(bench.rig, stiff)
    first = bench.comparison.update()
    assert first.residual is not None
    bench.rig.add_samples(b"\x00\x01\x00\x00garbage")
    assert bench.comparison.update().rig.refused == 1
    bench.now = 10.0
    stale = bench.comparison.update()
    assert not stale.rig.fresh
    assert "old" in line(stale)
    assert any(text.startswith("/rig/samples: ") for text in stale.remarks)


def samples_in(result: ComparisonResult) -> int:
    assert result.residual is not None
    return result.residual.count


def test_another_operating_point_is_not_compared_and_starts_a_new_sum(stiff: TimeSeries) -> None:
    bench = Bench()
    bench.send(bench.rig, stiff)
    bench.send(bench.sim, sampled({}, POINTS[1], 40))
    picture = bench.comparison.update()
    assert not picture.comparable
    assert any("another operating point" in text for text in picture.remarks)
    elsewhere = noisy(sampled(STIFF, POINTS[1], 60), 0.01, 9)
    bench.send(bench.rig, elsewhere)
    assert samples_in(bench.comparison.update()) == len(elsewhere)


def test_a_slow_drift_does_not_join_distant_operating_points() -> None:
    """Each stretch is within 1 K of the one before, the fourth not of the first."""
    bench = Bench()
    joined = []
    for i in range(4):
        point = POINTS[0] | {"delta_T": POINTS[0]["delta_T"] + 0.4 * i}
        stretch = noisy(sampled(STIFF, point, 60), 0.01, i)
        bench.send(bench.rig, stretch)
        joined.append(samples_in(bench.comparison.update()) / len(stretch))
    assert joined == [1, 2, 3, 1]


def test_noise_of_a_simulator_that_plays_the_rig_is_none() -> None:
    bench = Bench(noise=None)
    bench.rig.set_channels(json.dumps({"source": "simulator", "parameters": {}}))
    for hostile in ("no JSON", "[" * 100_000, "[1]", '{"a": ' + "9" * 5000 + "}"):
        bench.rig.set_channels(hostile)
    assert bench.rig.simulated
    bench.send(bench.rig, sampled(STIFF, POINTS[2], 40))
    found = bench.comparison.update().residual
    assert found is not None
    assert found.shares_by("kind")["sp"] > 0.97


def test_a_bar_is_as_long_as_its_share() -> None:
    assert bar(1.0, 4) == "████"
    assert bar(0.5, 4) == "██  "
    assert bar(0.0, 4) == "    "


def test_where_to_mirror_is_read_or_refused() -> None:
    file = Path("gap.rrd")
    assert mirror_target("", file) is None
    where = mirror_target("connect=box:9876", file)
    assert where is not None
    assert (where.mode, where.address) == ("connect", "box:9876")
    saved, other = mirror_target("save", file), mirror_target("save=a.rrd", file)
    assert saved is not None
    assert other is not None
    assert (saved.path, other.path) == (file, Path("a.rrd"))
    for wrong in ("spawn=1", "somewhere"):
        with pytest.raises(ParameterError, match="spawn"):
            mirror_target(wrong, file)


def test_pictures_go_to_a_file_and_a_missing_viewer_is_said_once(
    stiff: TimeSeries, tmp_path: Path
) -> None:
    importlib.import_module("rerun")
    from herringbone_sim.views.mirror.live import LiveMirror
    from herringbone_sim.views.mirror.sink import rerun_binary

    bench, file = Bench(), tmp_path / "live.rrd"
    mirror = LiveMirror(MirrorTarget("save", path=file))
    mirror.show(bench.comparison.update())
    bench.send(bench.rig, stiff)
    bench.send(bench.sim, sampled({}, POINTS[0], 40))
    mirror.show(bench.comparison.update())
    assert mirror.close() == f"mirrored to {file}"
    command = [rerun_binary(), "rrd", "print", str(file)]
    said = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    for entity in ("/text", "/gear/spots", "/floors/rp", "/force/sp/rig", "/force/sp/sim"):
        assert entity in said
    gone = LiveMirror(MirrorTarget("connect", "127.0.0.1:9"))
    gone.show(bench.comparison.update())
    assert gone.close().startswith("mirror failed: no viewer answers")


def test_without_forces_the_viewer_gets_the_bodies(stiff: TimeSeries, tmp_path: Path) -> None:
    importlib.import_module("rerun")
    from herringbone_sim.views.mirror.live import LiveMirror

    bench = Bench()
    bench.send(bench.rig, only(stiff, "x_", "v_", "u_"))
    mirror = LiveMirror(MirrorTarget("save", path=tmp_path / "live.rrd"))
    picture = bench.comparison.update()
    mirror.show(picture)
    assert mirror.state == "running"
    assert mirror.close().startswith("mirrored")
    assert "accelerations" in table(picture)


def test_a_picture_that_cannot_be_drawn_is_told_and_the_next_is(
    stiff: TimeSeries, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    importlib.import_module("rerun")
    from herringbone_sim.views.mirror.live import LiveMirror

    bench = Bench()
    bench.send(bench.rig, stiff)
    mirror = LiveMirror(MirrorTarget("save", path=tmp_path / "live.rrd"))

    def fail(*_: object) -> None:
        raise ValueError("math domain error")

    with monkeypatch.context() as patch:
        patch.setattr(LiveMirror, "_send", fail)
        mirror.show(bench.comparison.update())
    assert mirror.state == "failed: math domain error"
    mirror.show(bench.comparison.update())
    assert mirror.state == "running"
    assert mirror.close().startswith("mirrored")


def test_a_measured_operating_point_is_no_break() -> None:
    intake, noisy_rows = SampleBuffer(), rows(1000)
    rng = np.random.default_rng(0)
    noisy_rows[:, 2] += 0.5 * rng.normal(size=1000)  # a thermometer [K]
    noisy_rows[100:110, 2] = np.nan
    noisy_rows[:, 1] += 0.02 * rng.normal(size=1000)  # an encoder [rad], a tenth of a step
    intake.put(NAMES, noisy_rows)
    taken = intake.take()
    assert taken is not None
    assert len(taken) == 1000


def test_a_change_of_a_measured_operating_point_is_one() -> None:
    intake, noisy_rows = SampleBuffer(), rows(1000)
    noisy_rows[:, 2] += 0.5 * np.random.default_rng(0).normal(size=1000)
    noisy_rows[600:, 2] += 5.0
    intake.put(NAMES, noisy_rows)
    taken = intake.take()
    assert taken is not None
    assert 390 <= len(taken) <= 410


def test_times_that_no_stamp_can_hold_are_refused() -> None:
    with pytest.raises(RecordingError, match="below 2"):
        SampleBuffer().put(NAMES, rows(5, 3e9))
    with pytest.raises(RecordingError, match="below 2"):
        encode_joint_state(3 * 10**18, ("sp1_L",), *np.ones((3, 1)))


def test_what_is_not_recorded_counts_as_the_rest(stiff: TimeSeries) -> None:
    data = stiff.data.copy()
    x = stiff.names.index("x_sp1_L")
    data[:, x] = 1.0  # far in drive contact
    data[1::2, x] = np.nan
    data[::3, stiff.names.index("delta_T")] = np.nan
    found = motion_at_operating_point(TimeSeries(stiff.times, data, stiff.names), NOMINAL)
    assert found.contact_shares[found.meshes.index("sp1_L")].tolist() == [0.0, 0.0, 1.0]
    assert found.point["delta_T"] == POINTS[0]["delta_T"]


@pytest.mark.parametrize("said", [None, "hot", [1, 2], True])
def test_an_operating_point_that_is_no_number_is_not_taken(
    stiff: TimeSeries, said: object
) -> None:
    bench = Bench()
    keep = tuple(n for n in stiff.names if n != "delta_T")
    bench.rig.set_channels(json.dumps({"parameters": {"delta_T": said}}))
    bench.send(bench.rig, TimeSeries(stiff.times, stiff.columns(keep), keep))
    picture = bench.comparison.update()
    assert any("of the nominal gear is taken" in remark for remark in picture.remarks)


def test_a_channel_that_stands_twice_is_refused(stiff: TimeSeries) -> None:
    bench = Bench()
    names = (*stiff.names[:-1], stiff.names[-2])
    bench.rig.add_samples(encode_samples(names, stiff.data[:150]))
    picture = bench.comparison.update()
    assert picture.rig.refused == 1
    assert f"got twice: {names[-1]}" in line(picture)


@pytest.mark.parametrize("where", ["connect=127.0.0.1:9", "connect=foo:bar"])
def test_a_viewer_that_is_not_there_is_said_at_once(
    capsys: pytest.CaptureFixture[str], where: str
) -> None:
    importlib.import_module("rerun")
    importlib.import_module("rclpy")
    assert main(["gap", "live", "--rerun", where, "--seconds", "0.1"]) == 2
    assert "mirror failed" in capsys.readouterr().err


def test_a_phase_that_starts_anew_at_every_turn_is_one_stretch() -> None:
    intake, t = SampleBuffer(least=10), np.arange(98) * 1e-5
    intake.put(("t", "phase"), np.column_stack([t, np.mod(2e4 * t, 2.0 * np.pi)]))
    taken = intake.take()
    assert taken is not None
    assert taken["phase"] == pytest.approx(2e4 * t)
    # One that counts on and jumps by more than turns is not one stretch.
    steps = np.full(800, 0.2)
    steps[400] -= 14.0 * np.pi + 0.4
    intake.put(("t", "phase"), np.column_stack([1.0 + np.arange(800) * 1e-5, np.cumsum(steps)]))
    taken = intake.take()
    assert taken is None or len(taken) < 400
