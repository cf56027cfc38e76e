"""Recovery: what is kept, what is told, and that nothing is lost on the way."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import Writer
from recording_support import CHANNELS, RATE_HZ, foreign_file, make_rows, new_run, write_run
from rosbags.rosbag2 import Reader

from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.recover import recover

N = 30_000


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def cut_run(folder: Path, share: float = 0.6) -> Path:
    """A run whose file ends somewhere inside a chunk, without metadata.yaml."""
    run = write_run(folder, N)
    file = run / "run_0.mcap"
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    (run / "metadata.yaml").unlink()
    return run


def strip_index(run: Path) -> bytes:
    """Cut the run behind its last chunk; its content then."""
    file = run / "run_0.mcap"
    content = file.read_bytes()
    with file.open("rb") as stream:
        last = make_reader(stream).get_summary().chunk_indexes[-1]
    end = last.chunk_start_offset + last.chunk_length + last.message_index_length
    file.write_bytes(content[:end])
    (run / "metadata.yaml").unlink()
    return content[:end]


def test_a_complete_run_is_left_untouched(tmp_path):
    run = write_run(tmp_path)
    before = contents(run)
    report = recover(run)
    assert (report.was_complete, report.changed, report.originals) == (True, False, ())
    assert (report.samples, report.bytes_dropped) == (5000, 0)
    assert contents(run) == before


def test_a_cut_run_becomes_a_good_bag_and_keeps_its_original(tmp_path):
    run = cut_run(tmp_path)
    before = (run / "run_0.mcap").read_bytes()
    kept = read_recording(run).samples
    report = recover(run)
    assert 0 < report.samples == len(kept) < N
    assert report.span_s == (0.0, kept.times[-1])
    assert 0 < report.bytes_dropped < len(before)
    assert report.originals == (run / "run_0.mcap.cut",)
    assert report.originals[0].read_bytes() == before
    assert sorted(contents(run)) == ["metadata.yaml", "run_0.mcap", "run_0.mcap.cut"]
    recording = read_recording(run)
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, report.samples))
    assert (recording.complete, recording.notes) == (True, ())
    with Reader(run) as reader:
        assert reader.message_count == report.messages
    assert recover(run).changed is False


def test_a_run_that_lacks_only_its_end_loses_nothing(tmp_path):
    run = write_run(tmp_path, N)
    strip_index(run)
    report = recover(run)
    assert (report.samples, report.bytes_dropped, report.originals) == (N, 0, ())
    assert sorted(contents(run)) == ["metadata.yaml", "run_0.mcap"]
    recording = read_recording(run)
    assert len(recording.changes) == 1
    assert recording.complete


def test_a_file_cut_inside_its_index_loses_nothing(tmp_path):
    run = write_run(tmp_path, N)
    file = run / "run_0.mcap"
    file.write_bytes(file.read_bytes()[:-20])
    report = recover(run)
    assert (report.was_complete, report.samples, report.originals) == (False, N, ())
    with file.open("rb") as stream:
        records = {r.name: r.metadata for r in make_reader(stream).iter_metadata()}
    assert records["herringbone_sim"] == {
        "samples_written": str(N),
        "dropped_blocks": "0",
        "recovered": "true",
    }


@pytest.mark.parametrize(
    "text", [None, "odd: [", "rosbag2_bagfile_information: {message_count: 1}"]
)
def test_a_missing_or_wrong_metadata_yaml_alone_is_written(tmp_path, text):
    run = write_run(tmp_path)
    before = contents(run)
    (run / "metadata.yaml").unlink()
    if text is not None:
        (run / "metadata.yaml").write_text(text)
    report = recover(run)
    assert (report.was_complete, report.changed) == (True, True)
    assert any("written anew" in note for note in report.notes)
    after = contents(run)
    assert after["run_0.mcap"] == before["run_0.mcap"]
    assert yaml.safe_load(after["metadata.yaml"]) == yaml.safe_load(before["metadata.yaml"])


def test_another_folder_leaves_the_original_alone(tmp_path):
    run = cut_run(tmp_path)
    before = contents(run)
    report = recover(run, tmp_path / "deep" / "whole")
    assert contents(run) == before
    assert report.paths == (tmp_path / "deep" / "whole" / "whole_0.mcap",)
    assert report.originals == (run / "run_0.mcap",)
    recording = read_recording(tmp_path / "deep" / "whole")
    assert (len(recording.samples), recording.complete) == (report.samples, True)
    with Reader(tmp_path / "deep" / "whole") as reader:
        assert reader.message_count == report.messages


def test_an_existing_target_is_refused(tmp_path):
    run = cut_run(tmp_path)
    with pytest.raises(RecordingError, match="must be new"):
        recover(run, tmp_path)


def test_an_earlier_original_is_never_overwritten(tmp_path):
    run = cut_run(tmp_path)
    (run / "run_0.mcap.cut").write_text("precious")
    before = contents(run)
    with pytest.raises(RecordingError, match="from a recovery before this one"):
        recover(run)
    assert contents(run) == before


def test_files_of_several_runs_in_one_folder_are_refused(tmp_path):
    for name in "ab":
        foreign_file(tmp_path / f"{name}_0.mcap", [make_rows(0, 10)])
    for path in (tmp_path, tmp_path / "b_0.mcap"):
        with pytest.raises(RecordingError, match="a folder of its own"):
            recover(path)


@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_full_disk_leaves_the_original_as_it_was(tmp_path, monkeypatch, elsewhere):
    run = cut_run(tmp_path)
    before = contents(run)
    whole = os.write

    def fill(handle: int, content: memoryview) -> int:
        if len(content) > 1000:
            raise OSError(errno.ENOSPC, "No space left on device")
        return whole(handle, content)

    monkeypatch.setattr(os, "write", fill)
    with pytest.raises(RecordingError, match="No space left on device"):
        recover(run, tmp_path / "out" if elsewhere else None)
    assert contents(run) == before
    assert not (tmp_path / "out").exists()


def test_a_file_system_without_links_keeps_the_original_too(tmp_path, monkeypatch):
    def refuse(*args: object) -> None:
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    run = cut_run(tmp_path)
    before = (run / "run_0.mcap").read_bytes()
    report = recover(run)
    assert len(report.originals) == 1
    assert report.originals[0].read_bytes() == before
    assert read_recording(run).complete


def test_a_half_recovery_is_swept_away(tmp_path):
    run = cut_run(tmp_path)
    (run / "run_0.mcap.part").write_text("of a recovery that was killed")
    recover(run)
    assert "run_0.mcap.part" not in contents(run)


def test_a_cut_file_of_a_rig_keeps_topics_records_and_unreadable_messages(tmp_path):
    rows = make_rows(0, 100)
    file = foreign_file(tmp_path / "rig_0.mcap", [rows], finish=False)
    with (tmp_path / "tail").open("w+b") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start()
        start = stream.tell()
        writer.add_attachment(0, 0, "photo", "image/png", b"png")
        writer.add_metadata("rig", {"operator": "me"})
        writer.add_message(2, 7, b"\x00\x01\x00\x00 no samples", 7)
        writer.add_message(9, 7, b"of an unknown channel", 7)
        stream.seek(start)
        tail = stream.read()
    (tmp_path / "tail").unlink()
    file.write_bytes(file.read_bytes() + tail)
    report = recover(file)
    assert (report.samples, report.messages) == (100, 3)
    assert any("can't be read" in note for note in report.notes)
    assert report.originals == (tmp_path / "rig_0.mcap.cut",)
    with file.open("rb") as stream:
        reader = make_reader(stream)
        topics = {channel.topic for channel in reader.get_summary().channels.values()}
        records = {record.name: record.metadata for record in reader.iter_metadata()}
    assert topics == {"/rig/a/channels", "/rig/a/samples"}
    assert records["rig"] == {"operator": "me"}
    assert records["herringbone_sim"] == {"samples_written": "100", "recovered": "true"}


def test_a_damaged_chunk_is_counted(tmp_path):
    run = write_run(tmp_path, N)
    content = bytearray(strip_index(run))
    content[len(content) // 2] ^= 0xFF
    (run / "run_0.mcap").write_bytes(content)
    report = recover(run)
    assert report.chunks_dropped == 1
    assert 0 < report.samples < N
    assert len(report.originals) == 1
    notes = read_recording(run).notes
    assert any(f"{N - report.samples} samples are missing in 1 gaps" in note for note in notes)


def test_nothing_to_recover_is_told(tmp_path):
    with pytest.raises(RecordingError, match="there is no"):
        recover(tmp_path / "nowhere")


def split_run(folder: Path, files: int = 3) -> Path:
    """A run of 1000 samples a file that was killed in its last file."""
    writer = new_run(folder)
    for number in range(files):
        if number:
            writer.next_file(CHANNELS, 1000 * number / RATE_HZ)
        for start in range(1000 * number, 1000 * number + 1000, 100):
            writer.write_samples(make_rows(start, start + 100))
            writer.flush()
    last = writer.path / f"run_{files - 1}.mcap"
    last.write_bytes(last.read_bytes()[:-200])
    return writer.path


@pytest.mark.parametrize("named", [".", "run_0.mcap", "run_2.mcap"])
def test_a_run_of_several_files_is_recovered_whichever_is_named(tmp_path, named):
    run = split_run(tmp_path)
    before = contents(run)
    report = recover(run / named)
    assert (report.was_complete, report.samples) == (False, 2900)
    assert report.originals == (run / "run_2.mcap.cut",)
    after = contents(run)
    assert after["run_2.mcap.cut"] == before["run_2.mcap"]
    assert all(after[f"run_{number}.mcap"] == before[f"run_{number}.mcap"] for number in range(2))
    recording = read_recording(run)
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, 2900))
    assert (recording.complete, recording.notes) == (True, ())
    with Reader(run) as reader:
        assert reader.message_count == report.messages
    assert recover(run).changed is False


def test_every_file_of_a_run_that_needs_it_is_recovered(tmp_path):
    run = split_run(tmp_path)
    first = run / "run_0.mcap"
    first.write_bytes(first.read_bytes()[:-30])
    report = recover(run, tmp_path / "out")
    assert report.originals == tuple(run / f"run_{number}.mcap" for number in range(3))
    assert [path.name for path in report.paths] == [f"out_{number}.mcap" for number in range(3)]
    recording = read_recording(tmp_path / "out")
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, 2900))
    assert (recording.complete, recording.notes) == (True, ())
    with Reader(tmp_path / "out") as reader:
        assert reader.message_count == report.messages
    assert recover(run).originals == (run / "run_2.mcap.cut",)
    np.testing.assert_array_equal(read_recording(run).samples.data, make_rows(0, 2900))


def test_a_missing_file_of_a_run_is_a_gap(tmp_path):
    run = split_run(tmp_path)
    recover(run)
    (run / "run_1.mcap").unlink()
    recording = read_recording(run)
    assert len(recording.samples) == 1900
    assert any("1000 samples are missing in 1 gaps" in note for note in recording.notes)


@pytest.mark.parametrize("finished", [0, 1])
def test_a_run_that_is_still_being_recorded_is_refused_and_goes_on(tmp_path, finished):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 1000))
    for _ in range(finished):
        writer.next_file(CHANNELS, 1000 / RATE_HZ)
    writer.flush()
    before = contents(writer.path)
    for named in (writer.path, writer.path / "run_0.mcap"):
        with pytest.raises(RecordingError, match="is being recorded: stop the recording first"):
            recover(named)
    assert contents(writer.path) == before
    assert recover(writer.path, tmp_path / "so_far").samples == 1000
    writer.write_samples(make_rows(1000, 2000))
    writer.close()
    assert recover(writer.path).changed is False
    np.testing.assert_array_equal(read_recording(writer.path).samples.data, make_rows(0, 2000))


def test_a_recording_that_ended_by_itself_is_not_taken_for_one_that_runs(tmp_path):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 1000))
    writer.flush()
    with (writer.path / "run_0.mcap").open("ab") as file:
        file.write(b"mine")
    with pytest.raises(RecordingError):
        writer.flush()
    assert recover(writer.path).samples == 1000


def test_a_folder_that_is_in_the_way_is_not_removed(tmp_path):
    run = cut_run(tmp_path)
    (tmp_path / "out.part").mkdir()
    (tmp_path / "out.part" / "thesis.txt").write_text("precious")
    with pytest.raises(RecordingError, match="in the way"):
        recover(run, tmp_path / "out")
    assert (tmp_path / "out.part" / "thesis.txt").read_text() == "precious"


def test_a_recovery_that_was_killed_behind_its_link_is_finished(tmp_path):
    run = cut_run(tmp_path)
    samples = read_recording(run).samples.data
    os.link(run / "run_0.mcap", run / "run_0.mcap.cut")
    report = recover(run)
    assert report.originals == (run / "run_0.mcap.cut",)
    np.testing.assert_array_equal(read_recording(run).samples.data, samples)
