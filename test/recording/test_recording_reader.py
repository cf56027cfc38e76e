"""Runs of this package and of other programs, whole and odd."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType
from recording_support import (
    CHANNELS,
    NAMES,
    RATE_HZ,
    foreign_file,
    make_rows,
    new_run,
    write_message,
    write_run,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.messages import encode_samples, encode_string
from herringbone_sim.recording.reader import iter_sample_blocks, read_recording

BLOCKS = [make_rows(start, start + 100) for start in range(0, 3000, 100)]
ALL = make_rows(0, 3000)


def rosbags_run(path: Path, mode: CompressionMode = CompressionMode.NONE) -> Path:
    """A bag of a rig, written by rosbags, with nothing but samples and channels."""
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        string, array = "std_msgs/msg/String", "std_msgs/msg/Float64MultiArray"
        channels = writer.add_connection("/lab/rig/channels", string, typestore=store)
        samples = writer.add_connection("/lab/rig/samples", array, typestore=store)
        writer.write(channels, 0, encode_string(json.dumps({"source": "rig"})))
        for number, rows in enumerate(BLOCKS):
            writer.write(samples, number, encode_samples(NAMES, rows))
    return path


def damage(file: Path, marker: bytes, offset: int = 0) -> None:
    content = bytearray(file.read_bytes())
    content[content.index(marker) + offset] ^= 0xFF
    file.write_bytes(content)


@pytest.mark.parametrize("compressed", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_a_bag_of_a_rig_is_read(tmp_path, compressed):
    recording = read_recording(rosbags_run(tmp_path / "rig_run", compressed))
    np.testing.assert_array_equal(recording.samples.data, ALL)
    np.testing.assert_array_equal(recording.samples.times, ALL[:, 0])
    assert (recording.name, recording.channels.content) == ("rig_run", {"source": "rig"})
    assert (recording.changes, recording.complete, recording.notes) == ((), True, ())


def test_a_bag_compressed_outside_of_mcap_is_refused(tmp_path):
    run = rosbags_run(tmp_path / "run", CompressionMode.MESSAGE)
    with pytest.raises(RecordingError, match="ros2 bag convert"):
        read_recording(run)


def test_metadata_of_another_bag_does_not_concern_a_file(tmp_path):
    run = rosbags_run(tmp_path / "run", CompressionMode.MESSAGE)
    with pytest.raises(RecordingError, match="ros2 bag convert"):
        read_recording(next(run.glob("*.mcap")))
    recording = read_recording(foreign_file(run / "a.mcap", BLOCKS))
    assert not any("metadata.yaml" in note for note in recording.notes)
    (run / "metadata.yaml").write_text("a: [")
    recording = read_recording(run / "a.mcap")
    assert not any("metadata.yaml" in note for note in recording.notes)


@pytest.mark.parametrize("finish", [True, False])
@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_every_compression_is_read(tmp_path, compression, chunked, finish):
    file = foreign_file(
        tmp_path / "a.mcap", BLOCKS, compression=compression, chunked=chunked, finish=finish
    )
    recording = read_recording(str(file))
    np.testing.assert_array_equal(recording.samples.data, ALL)
    assert recording.complete is finish
    assert (recording.path, recording.name) == (file, "a")
    assert any("was not finished" in note for note in recording.notes) is not finish
    assert any("metadata.yaml is missing" in note for note in recording.notes)


@pytest.mark.parametrize("chunked", [True, False])
def test_a_file_cut_anywhere_keeps_all_that_is_whole(tmp_path, chunked):
    file = foreign_file(tmp_path / "a.mcap", BLOCKS, chunked=chunked)
    whole = file.read_bytes()
    first = whole.index(b"sample\0") + 65_000
    lengths = []
    for size in range(len(whole) - 1, first, -len(whole) // 97):
        file.write_bytes(whole[:size])
        recording = read_recording(file)
        lengths.append(len(recording.samples))
        np.testing.assert_array_equal(recording.samples.data, ALL[: lengths[-1]])
        assert not recording.complete
    assert lengths == sorted(lengths, reverse=True)
    assert lengths[0] == 3000
    assert lengths[-1] < 1500


def test_a_file_cut_before_its_first_sample_is_told(tmp_path):
    file = foreign_file(tmp_path / "a.mcap", BLOCKS)
    whole = file.read_bytes()
    for size in (0, 5, 8, 20, 300):
        file.write_bytes(whole[:size])
        with pytest.raises(RecordingError, match=r"must hold samples|not an MCAP file"):
            read_recording(file)


def test_zeros_behind_the_cut_are_no_record(tmp_path):
    file = foreign_file(tmp_path / "a.mcap", BLOCKS, finish=False)
    file.write_bytes(file.read_bytes() + bytes(5000))
    recording = read_recording(file)
    assert len(recording.samples) == 3000
    assert "last 5000 of" in " ".join(recording.notes)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_damaged_chunk_is_left_out_and_told(tmp_path, compression):
    file = foreign_file(tmp_path / "a.mcap", BLOCKS, compression=compression)
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0xFF
    file.write_bytes(content)
    recording = read_recording(file)
    notes = " ".join(recording.notes)
    assert recording.complete
    assert "damaged" in notes
    assert "samples are missing in 1 gaps" in notes
    n = len(recording.samples)
    assert 2000 < n < 3000
    missing = np.setdiff1d(np.arange(3000), np.rint(recording.samples.times * RATE_HZ))
    assert f"{3000 - n} samples are missing" in notes
    assert np.ptp(missing) == len(missing) - 1


def test_channels_survive_damage_of_their_first_copy(tmp_path):
    file = foreign_file(tmp_path / "a.mcap", BLOCKS)
    damage(file, b"/rig/a/samples")
    recording = read_recording(file)
    assert 2000 < len(recording.samples) < 3000


def test_the_channels_of_an_unfinished_file_can_be_lost(tmp_path):
    file = foreign_file(tmp_path / "a.mcap", BLOCKS, finish=False)
    damage(file, b"/rig/a/samples")
    with pytest.raises(RecordingError, match="must hold samples"):
        read_recording(file)


def test_a_damaged_summary_is_a_note(tmp_path):
    file = foreign_file(tmp_path / "a.mcap", BLOCKS, chunked=False)
    content = bytearray(file.read_bytes())
    content[content.rindex(b"/rig/a/samples")] = 0xFF
    file.write_bytes(content)
    recording = read_recording(file)
    assert len(recording.samples) == 3000
    assert "damaged" in " ".join(recording.notes)


def test_an_unknown_compression_is_refused(tmp_path):
    file = foreign_file(tmp_path / "a.mcap", BLOCKS, compression=CompressionType.ZSTD)
    file.write_bytes(file.read_bytes().replace(b"zstd", b"zstx"))
    with pytest.raises(RecordingError, match="got 'zstx'"):
        read_recording(file)


def test_blocks_come_one_by_one_in_order(tmp_path):
    blocks = list(iter_sample_blocks(foreign_file(tmp_path / "a.mcap", BLOCKS)))
    assert [names for names, _ in blocks] == [NAMES] * len(BLOCKS)
    np.testing.assert_array_equal(np.concatenate([rows for _, rows in blocks]), ALL)


def test_a_split_bag_is_read_in_the_order_of_its_numbers(tmp_path):
    for number in range(12):
        rows = make_rows(100 * number, 100 * number + 100)
        foreign_file(tmp_path / f"run_{number}.mcap", [rows], log_times=[number])
    np.testing.assert_array_equal(read_recording(tmp_path).samples.data, make_rows(0, 1200))


def test_only_the_files_that_metadata_names_are_read(tmp_path):
    run = write_run(tmp_path)
    foreign_file(run / "another.mcap", BLOCKS)
    assert len(read_recording(run).samples) == 5000


def test_the_order_of_the_file_counts_whatever_the_log_times(tmp_path):
    times = list(range(len(BLOCKS), 0, -1))
    recording = read_recording(foreign_file(tmp_path / "a.mcap", BLOCKS, log_times=times))
    np.testing.assert_array_equal(recording.samples.data, ALL)
    swapped = [BLOCKS[1], BLOCKS[0], *BLOCKS[2:]]
    with pytest.raises(RecordingError, match="at sample 100"):
        read_recording(foreign_file(tmp_path / "b.mcap", swapped))


def test_time_that_goes_backwards_is_refused_with_its_place(tmp_path):
    late = BLOCKS[1].copy()
    late[40:, 0] -= 1.0
    file = foreign_file(tmp_path / "a.mcap", [BLOCKS[0], late])
    with pytest.raises(RecordingError, match=r"-0.99\d+ s after 0.00\d+ s at sample 140"):
        read_recording(file)
    recording = read_recording(file, cut_at_jump=True)
    np.testing.assert_array_equal(recording.samples.data, ALL[:140])
    assert any("60 samples from there on are left out" in note for note in recording.notes)


@pytest.mark.parametrize("time", [np.nan, 99 / RATE_HZ])
def test_time_that_stands_or_is_no_number_is_refused(tmp_path, time):
    odd = BLOCKS[1].copy()
    odd[0, 0] = time
    with pytest.raises(RecordingError, match="at sample 100"):
        read_recording(foreign_file(tmp_path / "a.mcap", [BLOCKS[0], odd]))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "no channels message"),
        ("{", "must be JSON"),
        ("[1]", "must be a JSON object, got list"),
    ],
)
def test_missing_or_odd_channels_are_a_note(tmp_path, text, said):
    recording = read_recording(foreign_file(tmp_path / "a.mcap", BLOCKS, channels=text))
    assert recording.channels.content == {}
    assert said in " ".join(recording.notes)


def test_missing_samples_are_counted_by_the_phase(tmp_path):
    rows = np.delete(ALL, [*range(500, 520), 1700], axis=0)
    notes = " ".join(read_recording(foreign_file(tmp_path / "a.mcap", [rows])).notes)
    assert (
        "21 samples are missing in 2 gaps, the first after t = 0.0062375 s (sample 500)" in notes
    )


def test_a_lost_sample_is_told_against_the_counter_of_the_writer(tmp_path):
    writer = new_run(tmp_path)
    write_message(writer, encode_samples(NAMES, make_rows(0, 99)), 0.0, 100)
    writer.close()
    notes = read_recording(writer.path).notes
    assert any("counted 100 samples, 99 were read" in note for note in notes)


def test_changes_outside_of_the_samples_are_told(tmp_path):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 100))
    writer.write_parameter_event(5.0, "/n", {"K": 1.0})
    writer.close()
    notes = read_recording(writer.path).notes
    assert any("1 of 1 parameter changes lie outside" in note for note in notes)


@pytest.mark.parametrize("text", ["", "a: [", "rosbag2_bagfile_information: 3", "\udcff"])
def test_a_broken_metadata_yaml_is_a_note(tmp_path, text):
    run = write_run(tmp_path)
    (run / "metadata.yaml").write_bytes(text.encode(errors="surrogateescape"))
    recording = read_recording(run)
    assert len(recording.samples) == 5000
    assert any("metadata.yaml can't be read" in note for note in recording.notes)


def test_a_run_that_is_still_being_written_is_read_up_to_its_last_flush(tmp_path):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 2000))
    writer.flush()
    writer.write_samples(make_rows(2000, 2100))
    recording = read_recording(writer.path)
    assert len(recording.samples) == 2000
    assert recording.channels.content == CHANNELS
    writer.close()
    assert len(read_recording(writer.path).samples) == 2100


def test_nothing_there_is_told(tmp_path):
    with pytest.raises(RecordingError, match=r"there is no .*nowhere"):
        read_recording(tmp_path / "nowhere")
    with pytest.raises(RecordingError, match="name another folder"):
        read_recording(tmp_path)
    write_run(tmp_path)
    with pytest.raises(RecordingError, match=r"name one of its runs, as .*run"):
        read_recording(tmp_path)
    (tmp_path / "a.txt").write_text("hello, this is no recording")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        read_recording(tmp_path / "a.txt")


def test_a_file_that_may_not_be_opened_is_told(tmp_path, monkeypatch):
    run = write_run(tmp_path)

    def refuse(self: Path, *args: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(RecordingError, match=r"can't open .*Permission denied"):
        read_recording(run / "run_0.mcap")


@pytest.mark.parametrize("topic", ["/rig/a/sample", "/rig/samples/raw"])
def test_a_file_without_samples_is_told(tmp_path, topic):
    with pytest.raises(RecordingError, match="must hold samples"):
        read_recording(foreign_file(tmp_path / "a.mcap", BLOCKS, samples_topic=topic))


@pytest.mark.parametrize("names", [("phase", "K"), ("t", "t")])
def test_samples_without_one_time_are_refused(tmp_path, names):
    file = foreign_file(tmp_path / "a.mcap", [np.zeros((3, 2))], names=names)
    with pytest.raises(RecordingError, match="must have a channel t and no name twice"):
        read_recording(file)


def test_channels_that_change_are_refused(tmp_path):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 100))
    narrow = encode_samples(NAMES[:3], make_rows(100, 200)[:, :3])
    write_message(writer, narrow, 1.0, 100)
    writer.close()
    with pytest.raises(RecordingError, match=r"must stay the same throughout .* at sample 100"):
        read_recording(writer.path)


def test_records_that_are_longer_than_their_chunk_are_damage(tmp_path):
    file = foreign_file(tmp_path / "a.mcap", BLOCKS)
    content = bytearray(file.read_bytes())
    message = content.index(b"sample\0") - 4 - 4 - 4 - 22 - 8
    content[message : message + 8] = (10**9).to_bytes(8, "little")
    chunk = content.rindex(b"\x06", 0, content.index(b"std_msgs"))
    content[chunk + 9 + 24 : chunk + 9 + 28] = bytes(4)
    file.write_bytes(content)
    recording = read_recording(file)
    assert "longer than the chunk" in " ".join(recording.notes)


def test_samples_of_two_nodes_are_refused(tmp_path):
    foreign_file(tmp_path / "run_0.mcap", BLOCKS[:1])
    foreign_file(tmp_path / "run_1.mcap", BLOCKS[1:2], samples_topic="/rig/b/samples")
    with pytest.raises(RecordingError, match="/rig/a/samples and /rig/b/samples"):
        read_recording(tmp_path)
