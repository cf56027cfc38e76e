"""A run of several files of which some are gone, named twice, or not named at all."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from recording_support import CHANNELS, RATE_HZ, make_rows, new_run
from rosbags.rosbag2 import Reader

from herringbone_sim.__main__ import main
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.recover import recover

Said = pytest.CaptureFixture[str]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A finished run of four files, 1000 samples each."""
    writer = new_run(tmp_path, "base")
    for number in range(4):
        if number:
            writer.next_file(CHANNELS, 1000 * number / RATE_HZ)
        writer.write_samples(make_rows(1000 * number, 1000 * number + 1000))
    writer.close()
    return writer.path


def listing(run: Path) -> dict[str, object]:
    content = yaml.safe_load((run / "metadata.yaml").read_text())
    return dict(content["rosbag2_bagfile_information"])


def write_listing(run: Path, **changed: object) -> None:
    content = {"rosbag2_bagfile_information": listing(run) | changed}
    (run / "metadata.yaml").write_text(yaml.safe_dump(content))


def test_a_last_file_that_is_gone_is_told_wherever_it_is_read(run: Path, capsys: Said) -> None:
    (run / "base_3.mcap").unlink()
    recording = read_recording(run)
    assert not recording.complete
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, 3000))
    assert any("names base_3.mcap, which is not there" in note for note in recording.notes)
    assert main(["info", str(run)]) == 0
    page = capsys.readouterr().out
    assert "not whole: base_3.mcap is missing" in page
    assert "as many as were written" not in page
    main(["replay", str(run), "--verify"])
    assert "base_3.mcap, which is not there" in capsys.readouterr().out


def test_a_recovery_keeps_what_is_there_and_what_is_known_to_be_gone(
    run: Path, tmp_path: Path, capsys: Said
) -> None:
    shutil.copy(run / "base_2.mcap", tmp_path / "kept")
    (run / "base_2.mcap").unlink()
    assert main(["recover", str(run)]) == 0
    said = capsys.readouterr().out
    assert "not the whole run" in said
    assert "base_2.mcap, which is not there" in said
    with Reader(run) as reader:
        assert reader.message_count == sum(1 for _ in reader.messages())
    assert recover(run).missing == ("base_2.mcap",)
    assert not recover(run).changed
    assert not read_recording(run).complete
    assert recover(run, tmp_path / "out").missing == ("base_2.mcap",)
    assert not read_recording(tmp_path / "out").complete
    assert sorted(path.name for path in (tmp_path / "out").glob("*.mcap")) == [
        *("out_0.mcap", "out_1.mcap", "out_3.mcap")
    ]
    assert recover(tmp_path / "out").missing == ("out_2.mcap",)
    (tmp_path / "kept").rename(run / "base_2.mcap")
    recording = read_recording(run)
    assert (recording.complete, len(recording.samples)) == (True, 4000)
    assert recover(run).missing == ()
    assert read_recording(run).notes == ()


def test_one_file_of_such_a_run_is_whole_alone(run: Path) -> None:
    (run / "base_3.mcap").unlink()
    recording = read_recording(run / "base_0.mcap")
    assert (recording.complete, recording.notes) == (True, ())


def test_a_file_that_is_named_twice_is_read_once(run: Path) -> None:
    names = [f"base_{number}.mcap" for number in range(4)]
    write_listing(run, relative_file_paths=[*names, "base_3.mcap", "./base_0.mcap"])
    recording = read_recording(run)
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, 4000))
    assert any("names base_3.mcap, ./base_0.mcap twice" in note for note in recording.notes)
    report = recover(run)
    assert (report.changed, report.samples) == (True, 4000)
    assert listing(run)["relative_file_paths"] == names
    assert read_recording(run).notes == ()


def test_a_file_of_the_run_that_is_not_named_is_told(run: Path) -> None:
    write_listing(run, relative_file_paths=[f"base_{number}.mcap" for number in range(3)])
    shutil.copy(run / "base_0.mcap", run / "other.mcap")
    recording = read_recording(run)
    assert len(recording.samples) == 3000
    (said,) = [note for note in recording.notes if "does not name" in note]
    assert "base_3.mcap" in said
    assert "other.mcap" not in said
    assert any("base_3.mcap" in note for note in recover(run).notes)
    (run / "other.mcap").unlink()
    (run / "metadata.yaml").unlink()
    assert recover(run).samples == 4000


def test_a_number_of_messages_that_is_not_that_of_the_files_is_told(run: Path) -> None:
    write_listing(run, message_count=9999)
    notes = read_recording(run).notes
    assert any("counts 9999 messages" in note for note in notes)


def test_names_of_another_run_are_not_believed(run: Path) -> None:
    write_listing(run, relative_file_paths=["elsewhere_0.mcap"])
    recording = read_recording(run)
    assert (recording.complete, len(recording.samples)) == (True, 4000)
    assert any("names elsewhere_0.mcap" in note for note in recording.notes)
    assert recover(run).changed
    assert read_recording(run).notes == ()


def test_thousands_of_names_are_told_in_a_line(run: Path) -> None:
    names = [f"base_{number}.mcap" for number in range(4, 4000)]
    write_listing(run, relative_file_paths=["base_0.mcap", *names])
    os.truncate(run / "base_3.mcap", 0)
    assert all(len(note) < 2000 for note in read_recording(run).notes)
