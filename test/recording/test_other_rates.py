"""Topics such as ``samples_torque``: readings stand beside the samples of their time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recording_support import write_bag

from herringbone_sim.__main__ import main
from herringbone_sim.recording.reader import read_recording

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


def test_what_can_not_be_decoded_costs_no_samples(tmp_path: Path) -> None:
    rows = np.column_stack([TIMES, TIMES])
    write_bag(tmp_path / "bag", MAIN, ("/rig/samples_torque", "T_in,T_in", rows))
    read = read_recording(tmp_path / "bag")
    assert len(read.samples) == 200
    assert any("/rig/samples_torque is left out" in note for note in read.notes)
