"""A recording whose files others delete, cut, replace or move while it is written."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from recording_support import CHANNELS, RATE_HZ, make_rows, new_run

from herringbone_sim.errors import RecordingError, RecordingLostError
from herringbone_sim.recording.bag import Bag
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.writer import RunWriter


def unlink(run: Path) -> None:
    (run / "run_0.mcap").unlink()


def empty(run: Path) -> None:
    os.truncate(run / "run_0.mcap", 0)


def replace(run: Path) -> None:
    (run / "other").write_bytes((run / "run_0.mcap").read_bytes())
    (run / "other").replace(run / "run_0.mcap")


def append(run: Path) -> None:
    with (run / "run_0.mcap").open("ab") as file:
        file.write(b"mine")


def remove_folder(run: Path) -> None:
    shutil.rmtree(run)


def replace_folder(run: Path) -> None:
    shutil.copytree(run, run.with_name("copy"))
    shutil.rmtree(run)
    run.with_name("copy").rename(run)


GONE = [unlink, empty, replace, remove_folder, replace_folder]


def flushed_run(folder: Path) -> RunWriter:
    """A run of 1000 samples on the disk and 500 in memory."""
    writer = new_run(folder)
    writer.write_samples(make_rows(0, 1000))
    writer.flush()
    writer.write_samples(make_rows(1000, 1500))
    return writer


@pytest.mark.parametrize("end", [RunWriter.flush, RunWriter.close])
@pytest.mark.parametrize("fault", GONE)
def test_a_file_that_is_gone_is_told_with_what_was_in_it(
    tmp_path: Path, fault: Callable[[Path], None], end: Callable[[RunWriter], None]
) -> None:
    writer = flushed_run(tmp_path)
    fault(writer.path)
    with pytest.raises(RecordingLostError) as told:
        end(writer)
    said = str(told.value)
    assert str(writer.path / "run_0.mcap") in said
    assert f"1500 of its 1500 samples (t = 0 to {1499 / RATE_HZ:.9g} s) are lost" in said
    assert (writer.samples_written, writer.samples_kept) == (1500, 0)
    assert writer.losses == (said,)
    with pytest.raises(RecordingError, match="start another"):
        writer.write_samples(make_rows(1500, 1600))
    writer.close()


def test_a_file_that_is_cut_keeps_what_can_be_read(tmp_path: Path) -> None:
    writer = new_run(tmp_path)
    sizes = []
    for start in range(0, 3000, 1000):
        writer.write_samples(make_rows(start, start + 1000))
        writer.flush()
        sizes.append(writer.file_bytes)
    os.truncate(writer.path / "run_0.mcap", sizes[1] + 100)
    writer.write_samples(make_rows(3000, 30_000))  # more than a chunk, so some is written
    with pytest.raises(RecordingLostError, match="28000 of its 30000 samples"):
        writer.flush()
    assert writer.samples_kept == 2000
    np.testing.assert_array_equal(read_recording(writer.path).samples.data, make_rows(0, 2000))


def test_a_file_that_another_program_appends_to_is_told(tmp_path: Path) -> None:
    writer = flushed_run(tmp_path)
    append(writer.path)
    with pytest.raises(RecordingLostError, match="500 of its 1500 samples"):
        writer.flush()
    assert len(read_recording(writer.path).samples) == 1000


@pytest.mark.parametrize("end", [RunWriter.flush, RunWriter.close])
def test_a_folder_that_is_moved_away_takes_every_sample_with_it(
    tmp_path: Path, end: Callable[[RunWriter], None]
) -> None:
    writer = flushed_run(tmp_path)
    writer.path.rename(tmp_path / "moved")
    with pytest.raises(RecordingLostError, match="nothing is lost, its 1500 samples") as told:
        end(writer)
    assert str(tmp_path / "moved") in str(told.value)
    recording = read_recording(tmp_path / "moved")
    assert recording.complete
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, 1500))
    assert writer.samples_kept == 1500


def test_a_finished_file_that_is_taken_away_is_told_and_not_listed(tmp_path: Path) -> None:
    writer = flushed_run(tmp_path)
    writer.next_file(CHANNELS, 1500 / RATE_HZ)
    writer.write_samples(make_rows(1500, 2000))
    unlink(writer.path)
    writer.flush()
    (said,) = writer.losses
    assert "run_0.mcap is no longer there: 1500 of its 1500 samples" in said
    writer.write_samples(make_rows(2000, 2100))
    writer.close()
    assert (writer.samples_written, writer.samples_kept) == (2100, 600)
    recording = read_recording(writer.path)
    assert recording.complete
    assert recording.notes == ()
    np.testing.assert_array_equal(recording.samples.data, make_rows(1500, 2100))


def test_a_next_file_that_is_taken_away_at_its_beginning_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer, flush = flushed_run(tmp_path), Bag.flush

    def take_away(bag: Bag) -> None:
        if bag.stream.path.suffix == ".part":
            bag.stream.path.unlink()
        flush(bag)

    monkeypatch.setattr(Bag, "flush", take_away)
    with pytest.raises(RecordingError, match=r"run_1\.mcap\.part was deleted") as told:
        writer.next_file(CHANNELS, 1500 / RATE_HZ)
    assert not isinstance(told.value, RecordingLostError)
    assert (writer.samples_kept, writer.losses) == (1500, ())
    np.testing.assert_array_equal(read_recording(writer.path).samples.data, make_rows(0, 1500))


def test_a_finished_file_that_is_cut_at_the_end_is_told(tmp_path: Path) -> None:
    writer = flushed_run(tmp_path)
    writer.next_file(CHANNELS, 1500 / RATE_HZ)
    writer.write_samples(make_rows(1500, 2000))
    empty(writer.path)
    writer.close()
    assert "run_0.mcap has 0 of its" in writer.losses[0]
    np.testing.assert_array_equal(read_recording(writer.path).samples.data, make_rows(1500, 2000))


def test_a_folder_that_is_gone_takes_the_finished_files_with_it(tmp_path: Path) -> None:
    writer = flushed_run(tmp_path)
    writer.next_file(CHANNELS, 1500 / RATE_HZ)
    writer.write_samples(make_rows(1500, 2000))
    remove_folder(writer.path)
    with pytest.raises(RecordingLostError, match=r"run_1.mcap was deleted: 500 of its 500"):
        writer.flush()
    assert len(writer.losses) == 2
    assert writer.samples_kept == 0
