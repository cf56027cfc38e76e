"""A recording whose process is killed at any time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from recording_support import make_rows
from rosbags.rosbag2 import Reader

from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.recover import recover

CHILD = """
import sys
from pathlib import Path
from recording_support import RATE_HZ, make_rows, new_run

writer = new_run(Path(sys.argv[1]))
block = 400
for number in range(1_000_000):
    start = number * block
    writer.write_samples(make_rows(start, start + block))
    if number == 3:
        writer.write_parameter_event(start / RATE_HZ, "/herringbone_sim", {"K": 0.5})
    if number % 10 == 9:
        writer.flush()
        print(start + block, flush=True)
"""


def killed_run(folder: Path, flushes: int) -> tuple[Path, int]:
    """A run killed by SIGKILL after some flushes, while it writes; samples known to be flushed."""
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(folder)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    flushed = [int(child.stdout.readline()) for _ in range(flushes)][-1]
    child.send_signal(signal.SIGKILL)
    assert child.wait() == -signal.SIGKILL
    child.stdout.close()
    return folder / "run", flushed


@pytest.mark.parametrize("flushes", [1, 3, 20])
def test_a_killed_run_keeps_all_that_was_flushed(tmp_path, flushes):
    run, flushed = killed_run(tmp_path, flushes)
    recording = read_recording(run)
    n = len(recording.samples)
    assert n >= flushed
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, n))
    assert [change.values for change in recording.changes] == [{"K": 0.5}]
    assert not recording.complete
    assert any("was not finished" in note for note in recording.notes)
    assert any("metadata.yaml is missing" in note for note in recording.notes)


def test_a_killed_run_is_recovered_sample_by_sample(tmp_path):
    run, flushed = killed_run(tmp_path, 5)
    cut = read_recording(run)
    report = recover(run)
    assert report.samples == len(cut.samples) >= flushed
    assert not report.was_complete
    recovered = read_recording(run)
    assert recovered.complete
    assert recovered.notes == ()
    np.testing.assert_array_equal(recovered.samples.data, cut.samples.data)
    assert recovered.channels == cut.channels
    assert recovered.changes == cut.changes
    with (run / "run_0.mcap").open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    with Reader(run) as reader:
        assert reader.message_count == summary.statistics.message_count == report.messages
