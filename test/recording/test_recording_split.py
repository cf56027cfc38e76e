"""A recording in several files: each one whole, all of them one bag."""

from __future__ import annotations

import itertools
import json
import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from recording_support import CHANNELS, NAMES, RATE_HZ, START_NS, make_rows, new_run
from rosbags.rosbag2 import Reader

from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.messages import decode_samples, decode_string
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.writer import RunWriter

EDGES = (0, 1000, 1700, 4000)


def channels_at(sample: int) -> dict[str, object]:
    return {**CHANNELS, "first": sample}


def begin(folder: Path) -> RunWriter:
    """A run in the last of its three files, all samples handed in."""
    writer = RunWriter.create(folder, "run", "/n", channels_at(0), NAMES, START_NS)
    for start, stop in itertools.pairwise(EDGES):
        if start:
            writer.next_file(channels_at(start), start / RATE_HZ)
        writer.write_parameter_event(start / RATE_HZ, "/n", {"K": float(start)})
        writer.write_samples(make_rows(start, stop))
    return writer


@pytest.fixture
def run(tmp_path: Path) -> Path:
    writer = begin(tmp_path)
    writer.close({"dropped_blocks": "0"})
    assert writer.samples_written == writer.samples_kept == EDGES[-1]
    return writer.path


def files_of(run: Path) -> list[Path]:
    return [run / f"run_{i}.mcap" for i in range(3)]


def test_the_files_together_are_the_run(run: Path) -> None:
    assert sorted(run.iterdir()) == sorted([*files_of(run), run / "metadata.yaml"])
    recording = read_recording(run)
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, EDGES[-1]))
    assert recording.complete
    assert recording.channels.content == channels_at(0)
    assert [change.values["K"] for change in recording.changes] == list(EDGES[:-1])
    assert recording.notes == ()


@pytest.mark.parametrize("number", range(3))
def test_each_file_is_a_whole_recording(run: Path, number: int) -> None:
    with files_of(run)[number].open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        messages = [(c.topic, m) for _, c, m in reader.iter_messages(log_time_order=False)]
        records = {record.name: record.metadata for record in reader.iter_metadata()}
    start, stop = EDGES[number], EDGES[number + 1]
    assert len(summary.schemas) == len(summary.channels) == 4
    assert messages[0][0] == "/n/channels"
    assert json.loads(decode_string(messages[0][1].data)) == channels_at(start)
    assert messages[0][1].log_time == START_NS + round(start / RATE_HZ * 1e9)
    rows = [decode_samples(m.data)[1] for topic, m in messages if topic == "/n/samples"]
    np.testing.assert_array_equal(np.concatenate(rows), make_rows(start, stop))
    assert records["herringbone_sim"]["samples_written"] == str(stop - start)
    told = yaml.safe_load(records["rosbag2"]["serialized_metadata"])
    assert told["relative_file_paths"] == [f"run_{number}.mcap"]
    assert told["message_count"] == len(messages) == summary.statistics.message_count
    alone = read_recording(files_of(run)[number])
    assert alone.channels.content == channels_at(start)
    np.testing.assert_array_equal(alone.samples.data, make_rows(start, stop))


def test_metadata_lists_all_files_in_order_with_their_spans(run: Path) -> None:
    text = (run / "metadata.yaml").read_text()
    assert "&id" not in text
    told = yaml.safe_load(text)["rosbag2_bagfile_information"]
    names = [file.name for file in files_of(run)]
    assert told["relative_file_paths"] == names == [one["path"] for one in told["files"]]
    summaries = []
    for file in files_of(run):
        with file.open("rb") as stream:
            summaries.append(make_reader(stream).get_summary().statistics)
    for one, counted in zip(told["files"], summaries, strict=True):
        first, last = counted.message_start_time, counted.message_end_time
        assert one["message_count"] == counted.message_count
        assert one["starting_time"] == {"nanoseconds_since_epoch": first}
        assert one["duration"] == {"nanoseconds": last - first}
    first, last = summaries[0].message_start_time, summaries[-1].message_end_time
    assert told["starting_time"] == {"nanoseconds_since_epoch": first}
    assert told["duration"] == {"nanoseconds": last - first}
    counts = {
        topic["topic_metadata"]["name"]: topic["message_count"]
        for topic in told["topics_with_message_count"]
    }
    assert counts["/n/channels"] == counts["/parameter_events"] == 3
    assert told["message_count"] == sum(counts.values())


def test_rosbags_reads_every_message_once_and_in_order(run: Path) -> None:
    with Reader(run) as reader:
        read = list(reader.messages())
        assert reader.message_count == len(read)
        assert reader.duration == read[-1][1] - read[0][1] + 1
    assert [at for _, at, _ in read] == sorted(at for _, at, _ in read)
    rows = [decode_samples(raw)[1] for c, _, raw in read if c.topic == "/n/samples"]
    np.testing.assert_array_equal(np.concatenate(rows), make_rows(0, EDGES[-1]))


def test_a_run_that_was_cut_off_is_read_over_all_its_files(tmp_path: Path) -> None:
    writer = begin(tmp_path)
    writer.flush()
    recording = read_recording(writer.path)
    np.testing.assert_array_equal(recording.samples.data, make_rows(0, EDGES[-1]))
    assert not recording.complete
    assert not any("counted" in note for note in recording.notes)


def test_a_file_that_cannot_be_opened_ends_the_run_and_keeps_those_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 1000))
    (writer.path / "run_1.mcap").write_bytes(b"mine")
    with pytest.raises(RecordingError, match="1000 of 1000 samples were flushed"):
        writer.next_file(CHANNELS, 0.0)
    assert (writer.path / "run_1.mcap").read_bytes() == b"mine"
    assert not list(writer.path.glob("*.part"))
    assert len(read_recording(writer.path / "run_0.mcap").samples) == 1000


def test_a_file_has_its_name_only_when_it_can_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names: list[list[str]] = []
    sync = os.fsync

    def look(handle: int) -> None:
        names.append([file.name for file in (tmp_path / "run").iterdir()])
        sync(handle)

    monkeypatch.setattr(os, "fsync", look)
    new_run(tmp_path)
    assert names == [["run_0.mcap.part"]]
    assert [file.name for file in (tmp_path / "run").iterdir()] == ["run_0.mcap"]


def test_a_recording_that_starts_late_begins_with_its_first_sample(tmp_path: Path) -> None:
    writer = RunWriter.create(tmp_path, "run", "/n", CHANNELS, NAMES, START_NS, t_s=0.5)
    writer.write_samples(make_rows(40_000, 41_000))
    writer.close()
    with Reader(writer.path) as reader:
        assert reader.start_time == START_NS + 500_000_000
        assert reader.duration < 20_000_000
