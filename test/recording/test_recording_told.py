"""What is said where a run can't be written or read: the true cause, and a way on."""

from __future__ import annotations

from pathlib import Path

import pytest
from recording_support import make_rows, new_run, write_run

from herringbone_sim.cli.recover import as_text
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.campaign import read_campaign
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.recover import recover


def test_a_folder_in_place_of_metadata_yaml_is_named(tmp_path: Path) -> None:
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 1000))
    (writer.path / "metadata.yaml").mkdir()
    with pytest.raises(RecordingError) as told:
        writer.close()
    said = str(told.value)
    assert f"can't write {writer.path / 'metadata.yaml'} (Is a directory)" in said
    assert "1000 of 1000 samples are on the disk" in said
    assert "free the disk" not in said
    assert len(read_recording(writer.path).samples) == 1000
    with pytest.raises(RecordingError) as told:
        recover(writer.path)
    assert f"see that {writer.path / 'metadata.yaml'} can be written" in str(told.value)
    (writer.path / "metadata.yaml").rmdir()
    assert recover(writer.path).changed


def test_a_cut_without_half_a_record_tells_of_no_bytes(tmp_path: Path) -> None:
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 1000))
    writer.flush()
    copy = tmp_path / "cut.mcap"
    copy.write_bytes((writer.path / "run_0.mcap").read_bytes())
    (said,) = [note for note in read_recording(copy).notes if "was not finished" in note]
    assert "its last" not in said
    assert " 0 bytes" not in as_text(recover(copy, tmp_path / "out"))


def test_a_run_that_takes_more_memory_than_allowed_has_a_way_on(tmp_path: Path) -> None:
    run = write_run(tmp_path)
    with pytest.raises(RecordingError, match="of a run of several files name one"):
        read_recording(run, most_bytes=1000)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("runs: []", "rig is missing"),
        ("other: 1", "rig and runs is missing"),
        ("{rig: a, runs: 5}", "runs must be a list, got 5"),
        ("{rig: a, runs: [], noise: 5}", "noise of .* must be a mapping, got 5"),
    ],
)
def test_a_campaign_without_its_parts_says_which(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "campaign.yaml").write_text(text)
    with pytest.raises(RecordingError, match=said) as told:
        read_campaign(tmp_path)
    assert "Error(" not in str(told.value)
