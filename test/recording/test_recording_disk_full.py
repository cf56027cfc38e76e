"""A disk that fills up while a run is recorded."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from recording_support import make_rows, new_run

from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.recover import recover

CHILD = """
import resource, sys
from pathlib import Path
from recording_support import make_rows, new_run
from herringbone_sim.errors import RecordingError

writer = new_run(Path(sys.argv[1]))
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, resource.RLIM_INFINITY))
refused = 0
for start in range(0, 100_000, 1000):
    try:
        writer.write_samples(make_rows(start, start + 1000))
        writer.flush()
    except RecordingError as error:
        refused += 1
        print(refused, error)
writer.close()
"""


class FullDisk:
    """Takes ``room`` bytes through os.write, half of the write that goes beyond, then none."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, room: int) -> None:
        self.room = room
        self.write = os.write
        monkeypatch.setattr(os, "write", self)

    def __call__(self, handle: int, content: memoryview) -> int:
        if not self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        taken = content[: min(len(content), self.room)]
        self.room -= len(taken)
        return self.write(handle, taken)


def fill(writer, steps: int = 40) -> list[str]:
    """Write and flush blocks of 500 samples; the errors met."""
    errors = []
    for start in range(0, 500 * steps, 500):
        try:
            writer.write_samples(make_rows(start, start + 500))
            writer.flush()
        except RecordingError as error:
            errors.append(str(error))
    return errors


@pytest.mark.parametrize("room", [60_000, 200_001, 350_777])
def test_a_full_disk_ends_the_recording_once_and_keeps_what_is_written(
    tmp_path, monkeypatch, room
):
    writer = new_run(tmp_path)
    FullDisk(monkeypatch, room)
    errors = fill(writer)
    assert "No space left on device" in errors[0]
    assert "recover" in errors[0]
    assert len(errors) > 2
    assert all("start another" in error and "ended early" in error for error in errors[1:])
    assert all("samples;" not in error for error in errors[1:])
    writer.close({"dropped_blocks": "3"})
    monkeypatch.undo()

    recording = read_recording(writer.path)
    n = len(recording.samples)
    assert n == 500 * (40 - len(errors))
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, n))
    assert not recording.complete
    report = recover(writer.path)
    assert (report.samples, report.bytes_dropped) == (n, 0)
    assert read_recording(writer.path).complete


@pytest.mark.parametrize("room", [0, 100, 200_000])
def test_the_early_end_counts_only_what_was_flushed(tmp_path, monkeypatch, room):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 500))
    writer.flush()
    FullDisk(monkeypatch, room)
    writer.write_samples(make_rows(500, 10_500))
    with pytest.raises(RecordingError, match="500 of 10500 samples were flushed"):
        writer.flush()
    monkeypatch.undo()
    assert writer.samples_kept == 500
    assert len(read_recording(writer.path).samples) >= 500


@pytest.mark.parametrize("room", [0, 100, 2000])
def test_a_disk_that_is_full_only_at_the_end_loses_no_sample(tmp_path, monkeypatch, room):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 500))
    writer.flush()
    FullDisk(monkeypatch, room)
    with pytest.raises(RecordingError, match="No space left"):
        writer.close()
    writer.close()
    monkeypatch.undo()
    assert len(read_recording(writer.path).samples) == 500


def test_a_full_disk_at_the_very_start_is_told(tmp_path, monkeypatch):
    FullDisk(monkeypatch, 10)
    with pytest.raises(RecordingError, match="No space left"):
        new_run(tmp_path)


def test_a_full_disk_leaves_no_half_metadata(tmp_path, monkeypatch):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 500))

    def refuse(self: Path, target: Path) -> Path:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(RecordingError, match="No space left"):
        writer.close()
    monkeypatch.undo()
    assert sorted(file.name for file in writer.path.iterdir()) == ["run_0.mcap"]
    recording = read_recording(writer.path)
    assert (recording.complete, len(recording.samples)) == (True, 500)


def test_a_limit_of_the_operating_system_is_a_full_disk(tmp_path):
    child = subprocess.run(
        [sys.executable, "-c", CHILD, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    lines = child.stdout.splitlines()
    assert lines[0].startswith("1 ")
    assert "File too large" in lines[0]
    recording = read_recording(tmp_path / "run")
    n = len(recording.samples)
    assert n == 1000 * (100 - len(lines))
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, n))
