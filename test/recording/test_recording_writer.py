"""What a finished run holds, and what the writer refuses."""

from __future__ import annotations

import errno
import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from recording_support import CHANNELS, NAMES, RATE_HZ, START_NS, make_rows, new_run, write_run

from herringbone_sim.core.layout import Layout
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.messages import decode_samples
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.writer import RunWriter, split_rows


def read_mcap(run: Path):
    with (run / f"{run.name}_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        messages = [(c, m) for _, c, m in reader.iter_messages(log_time_order=False)]
        records = {record.name: record.metadata for record in reader.iter_metadata()}
        return reader.get_header(), reader.get_summary(), messages, records


@pytest.mark.parametrize("n", [1, 16, 5000])
def test_all_topics_come_back(tmp_path, n):
    recording = read_recording(write_run(tmp_path, n))
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, n))
    assert recording.samples.names == NAMES
    assert recording.channels.content == CHANNELS
    (change,) = recording.changes
    assert (change.t_ns, change.node, change.values) == (
        10_000_000,
        "/herringbone_sim",
        {"K": 0.5},
    )
    assert recording.complete


def test_the_channels_message_is_the_first(tmp_path):
    header, summary, messages, _ = read_mcap(write_run(tmp_path))
    assert header.profile == "ros2"
    assert messages[0][0].topic == "/herringbone_sim/channels"
    assert json.loads(messages[0][1].data[8:-1]) == CHANNELS
    assert summary.statistics.message_count == len(messages)


def test_chunks_are_compressed_indexed_and_checked(tmp_path):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 50_000))
    writer.close()
    _, summary, _, _ = read_mcap(writer.path)
    assert len(summary.chunk_indexes) > 2
    assert {chunk.compression for chunk in summary.chunk_indexes} == {"lz4"}
    assert all(chunk.message_index_length for chunk in summary.chunk_indexes)
    assert 2**20 < max(chunk.uncompressed_size for chunk in summary.chunk_indexes) < 1.2 * 2**20


@pytest.mark.parametrize("prefix", ["/herringbone_sim", "rig/left/", ""])
def test_topics_follow_the_prefix(tmp_path, prefix):
    writer = RunWriter.create(tmp_path, "run", prefix, CHANNELS, NAMES, START_NS)
    writer.write_samples(make_rows(0, 10))
    writer.close()
    _, summary, _, _ = read_mcap(writer.path)
    base = f"/{prefix.strip('/')}" if prefix else ""
    assert {channel.topic for channel in summary.channels.values()} == {
        f"{base}/samples",
        f"{base}/state",
        f"{base}/channels",
        "/parameter_events",
    }


@pytest.mark.parametrize("names", [NAMES, Layout(3, True).channels, ("t", "x" * 3000)])
def test_messages_stay_below_64_kb_and_carry_the_time_of_their_first_row(tmp_path, names):
    writer = RunWriter.create(tmp_path, "run", "/n", CHANNELS, names, START_NS)
    rows = np.random.default_rng(0).normal(size=(9000, len(names)))
    rows[:, names.index("t")] = np.arange(9000) / RATE_HZ
    writer.write_samples(rows, publish_ns=77)
    writer.close()
    _, _, messages, _ = read_mcap(writer.path)
    samples = [message for channel, message in messages if channel.topic == "/n/samples"]
    got = [decode_samples(message.data)[1] for message in samples]
    np.testing.assert_array_equal(np.concatenate(got), rows)
    for message, block in zip(samples, got, strict=True):
        assert len(message.data) < 64_000
        assert message.log_time == START_NS + round(block[0, names.index("t")] * 1e9)
        assert message.publish_time == 77
    assert [message.sequence for message in samples] == list(range(len(samples)))
    assert min(len(message.data) for message in samples[:-1]) > 55_000


def test_split_rows_covers_a_block_without_overlap():
    slices = split_rows(1000, ["x"] * 50)
    assert np.concatenate([np.arange(1000)[rows] for rows in slices]).tolist() == list(range(1000))
    assert split_rows(0, ["x"] * 50) == []
    with pytest.raises(RecordingError, match="fewer channels"):
        split_rows(1, ["x"] * 8000)


def test_an_empty_block_is_nothing(tmp_path):
    writer = new_run(tmp_path)
    writer.write_samples(np.empty((0, len(NAMES))))
    assert writer.samples_written == 0


def test_metadata_yaml_has_every_key_of_version_9(tmp_path):
    run = write_run(tmp_path)
    text = (run / "metadata.yaml").read_text()
    assert "&id" not in text
    told = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert set(told) == {
        "version",
        "storage_identifier",
        "duration",
        "starting_time",
        "message_count",
        "topics_with_message_count",
        "compression_format",
        "compression_mode",
        "relative_file_paths",
        "files",
        "custom_data",
        "ros_distro",
    }
    _, summary, messages, records = read_mcap(run)
    assert (told["version"], told["storage_identifier"]) == (9, "mcap")
    assert told["relative_file_paths"] == ["run_0.mcap"] == [told["files"][0]["path"]]
    assert told["message_count"] == len(messages) == told["files"][0]["message_count"]
    start, end = summary.statistics.message_start_time, summary.statistics.message_end_time
    assert told["starting_time"] == {"nanoseconds_since_epoch": start}
    assert told["duration"] == {"nanoseconds": end - start}
    assert yaml.safe_load(records["rosbag2"]["serialized_metadata"]) == told
    assert not list(run.glob("*.part"))


def test_channels_carry_hash_and_quality_of_service(tmp_path):
    _, summary, _, _ = read_mcap(write_run(tmp_path))
    by_topic = {channel.topic: channel for channel in summary.channels.values()}
    latched = yaml.safe_load(
        by_topic["/herringbone_sim/channels"].metadata["offered_qos_profiles"]
    )
    streamed = yaml.safe_load(
        by_topic["/herringbone_sim/samples"].metadata["offered_qos_profiles"]
    )
    assert (latched[0]["durability"], latched[0]["depth"]) == ("transient_local", 1)
    assert (streamed[0]["durability"], streamed[0]["reliability"]) == ("volatile", "reliable")
    assert all(c.metadata["topic_type_hash"].startswith("RIHS01_") for c in by_topic.values())


def test_the_file_keeps_the_sample_counter_and_the_health(tmp_path):
    _, _, _, records = read_mcap(write_run(tmp_path, 1234))
    assert records["herringbone_sim"] == {"samples_written": "1234", "dropped_blocks": "0"}


@pytest.mark.parametrize(
    "name", ["", ".", "..", "../x", "a/b", "/tmp/x", "a\\b", " a", "a\n", "a\0b"]
)
def test_a_name_that_leads_out_is_refused(tmp_path, name):
    record_dir = tmp_path / "runs"
    with pytest.raises(RecordingError, match="one folder inside record_dir"):
        new_run(record_dir, name)
    assert not record_dir.exists()


def test_an_existing_run_is_refused_and_left_alone(tmp_path):
    run = write_run(tmp_path)
    before = {file: file.read_bytes() for file in run.iterdir()}
    with pytest.raises(RecordingError, match="never overwrites"):
        new_run(tmp_path)
    assert {file: file.read_bytes() for file in run.iterdir()} == before


def test_a_link_that_leads_out_is_an_existing_name(tmp_path):
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "run").symlink_to(tmp_path)
    with pytest.raises(RecordingError, match="never overwrites"):
        new_run(tmp_path / "runs")


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "runs").write_text("mine")
    with pytest.raises(RecordingError, match="is not a folder"):
        new_run(tmp_path / "runs")
    with pytest.raises(RecordingError, match="can't create the run folder"):
        new_run(tmp_path / "runs" / "deeper")
    assert (tmp_path / "runs").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_refused(tmp_path):
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(RecordingError, match="can't create the run folder"):
        new_run(tmp_path)
    tmp_path.chmod(stat.S_IRWXU)


def test_a_folder_that_takes_no_file_is_refused_and_left_empty(tmp_path, monkeypatch):
    def refuse(*args: object) -> int:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(RecordingError, match="Read-only file system"):
        new_run(tmp_path)
    monkeypatch.undo()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "names", [("phase",), (), ("t", "t"), ("t", "a,b"), ("t", " x"), ("t", "")]
)
def test_channel_names_that_no_reader_could_part_are_refused(tmp_path, names):
    with pytest.raises(RecordingError, match="mend the names"):
        RunWriter.create(tmp_path, "run", "/n", CHANNELS, names, START_NS)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("value", [np.float32(1), float("nan"), {1, 2}])
def test_channels_that_are_no_json_are_refused(tmp_path, value):
    with pytest.raises(RecordingError, match="plain JSON"):
        RunWriter.create(tmp_path, "run", "/n", {"parameters": {"K": value}}, NAMES, START_NS)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("block", "said"),
    [
        (np.zeros((3, 2)), r"shape \(n, 7\), got \(3, 2\)"),
        (np.zeros(7), r"got \(7,\)"),
        (np.full((1, 7), np.nan), "must be finite"),
    ],
)
def test_a_wrong_block_is_refused_and_the_recording_goes_on(tmp_path, block, said):
    writer = new_run(tmp_path)
    with pytest.raises(RecordingError, match=said):
        writer.write_samples(block)
    writer.write_samples(make_rows(0, 30))
    writer.close()
    assert len(read_recording(writer.path).samples) == 30


def test_a_closed_recording_refuses_writes_and_a_second_close_is_nothing(tmp_path):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 30))
    writer.close()
    with pytest.raises(RecordingError, match="is closed: start another"):
        writer.write_samples(make_rows(30, 60))
    with pytest.raises(RecordingError, match="is closed"):
        writer.flush()
    writer.close()
    assert len(read_recording(writer.path).samples) == 30
