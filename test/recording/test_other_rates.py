"""Topics such as ``samples_torque``: readings stand beside the samples of their time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recording_support import write_bag

from herringbone_sim.__main__ import main
from herringbone_sim.analysis.motion import motion_of
from herringbone_sim.analysis.segments import cut
from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.gap.data.breaks import longest_part
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.views.mirror.replay import prepare, replay_blocks

TIMES = np.arange(200) * 1e-5
FAST = np.column_stack([TIMES, 2e4 * TIMES, np.sin(2e4 * TIMES)])
MAIN = ("/rig/samples", "t,phase,x_sp1_L", FAST)


def torque(times: np.ndarray) -> np.ndarray:
    return np.column_stack([times, 2e4 * times, 220.0 + 1e3 * times])


def test_readings_stand_beside_the_samples_of_their_time(tmp_path: Path) -> None:
    slow = torque(TIMES[3::8])
    # The topic may come before that of the samples, in several messages.
    write_bag(
        tmp_path / "bag",
        ("/rig/samples_torque", "t,phase,T_in", slow[:10]),
        MAIN,
        ("/rig/samples_torque", "t,phase,T_in", slow[10:]),
    )
    read = read_recording(tmp_path / "bag")
    assert read.samples.names == ("t", "phase", "x_sp1_L", "T_in")
    assert read.samples["phase"] == pytest.approx(FAST[:, 1])
    there = np.isfinite(read.samples["T_in"])
    assert np.flatnonzero(there).tolist() == list(range(3, 200, 8))
    assert read.samples["T_in"][there].tolist() == slow[:, 2].tolist()
    assert any("T_in of /rig/samples_torque" in n and "25 readings" in n for n in read.notes)
    assert not any("left out" in note for note in read.notes)


def test_readings_between_samples_are_left_out_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    between = torque(np.append(TIMES[::8] + 3e-6, np.nan))
    write_bag(tmp_path / "bag", MAIN, ("/rig/samples_torque", "t,phase,T_in", between))
    read = read_recording(tmp_path / "bag")
    assert read.samples.names == ("t", "phase", "x_sp1_L")
    assert any("26 of 26 readings" in n and "campaign import" in n for n in read.notes)
    assert main(["info", str(tmp_path / "bag")]) == 0
    assert "T_in of /rig/samples_torque" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("label", ["time,T_in", "T_in,T_in"])
@pytest.mark.parametrize("times", [1, 2])
def test_names_that_do_not_fit_cost_no_samples(tmp_path: Path, label: str, times: int) -> None:
    rows = np.column_stack([TIMES, TIMES])
    write_bag(tmp_path / "bag", MAIN, *[("/rig/samples_torque", label, rows)] * times)
    read = read_recording(tmp_path / "bag")
    assert len(read.samples) == 200
    assert any("/rig/samples_torque is left out" in note for note in read.notes)
    assert not any("rate of their own" in note for note in read.notes)


def test_a_channel_that_two_topics_have_is_told(tmp_path: Path) -> None:
    left, right = (torque(TIMES[first::8]) for first in (0, 1))
    topics = ("/rig/samples_left", left), ("/rig/samples_right", right)
    write_bag(tmp_path / "bag", MAIN, *((name, "t,phase,T_in", rows) for name, rows in topics))
    read = read_recording(tmp_path / "bag")
    assert read.samples["T_in"][::8].tolist() == left[:, 2].tolist()
    assert any("T_in of /rig/samples_right is left out" in note for note in read.notes)


def test_where_time_jumps_readings_of_other_rates_are_left_out(tmp_path: Path) -> None:
    """The clock begins anew: a reading at 1 ms may be of either stretch."""
    name, label, rows = MAIN
    slow = ("/rig/samples_torque", "t,phase,T_in", torque(TIMES[:120:8]))
    write_bag(tmp_path / "bag", MAIN, (name, label, rows[:120]), slow)
    read = read_recording(tmp_path / "bag", cut_at_jump=True)
    assert len(read.samples) == 200
    assert "T_in" not in read.samples
    assert any("samples_torque are left out" in note for note in read.notes)


def test_a_temperature_of_another_rate_is_that_of_the_run(tmp_path: Path) -> None:
    """A gear at 50 K, whose nominal parameters say 20 K: analysis and viewer take the readings."""
    series, _ = simulate(build(Parameters(xi=0.085, delta_T=50.0, K=0.9)), 200)
    names = [name for name in series.names if name != "delta_T"]
    readings = np.column_stack([series.times[3::8], series["delta_T"][3::8]])
    write_bag(
        tmp_path / "bag",
        ("/rig/samples", ",".join(names), series.columns(names)),
        ("/rig/samples_temperature", "t,delta_T", readings),
    )
    read = read_recording(tmp_path / "bag")
    (segment,) = cut(read.samples, motion_of(read.samples), [], {"delta_T": 20.0})
    assert segment.point["delta_T"] == pytest.approx(50.0)
    shown = prepare(read, nominal=True)
    block = list(replay_blocks(read, shown, 200, 1))[-1]
    assert block.parameters["delta_T"] == pytest.approx(50.0)


def test_many_slow_channels_are_no_dropout_of_the_fast_ones(tmp_path: Path) -> None:
    slow = np.column_stack([TIMES[::8], np.ones((25, 3))])
    write_bag(tmp_path / "bag", MAIN, ("/rig/samples_slow", "t,T_in,T_out,oil", slow))
    part, findings = longest_part("run_00", read_recording(tmp_path / "bag").samples)
    assert (len(part), findings) == (200, ())


def test_the_note_on_a_jump_of_time_is_the_last(tmp_path: Path) -> None:
    slow = ("/rig/samples_torque", "t,phase,T_in", torque(TIMES[:120:8]))
    write_bag(tmp_path / "bag", MAIN, (*MAIN[:2], FAST[:120]), slow)
    read = read_recording(tmp_path / "bag", cut_at_jump=True)
    assert read.notes[-1].startswith("time goes from")
