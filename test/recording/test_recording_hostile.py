"""Recordings that were damaged or made to do harm: one error or a note each, and little memory."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer
from recording_support import CHANNELS, NAMES, foreign_file, make_rows, new_run, write_run

from benchmarks.faults.spoil import record_starts
from benchmarks.faults.verbs import Verbs
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.info import recording_info
from herringbone_sim.recording.messages import decode_samples, encode_samples, encode_string
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.recover import recover
from herringbone_sim.recording.scan import MOST_TOPICS, Scan
from herringbone_sim.recording.schemas import FLOAT64_MULTI_ARRAY

BLOCKS = [make_rows(start, start + 100) for start in range(0, 1000, 100)]


PACK = {"lz4": lz4.frame.compress, "zstd": zstandard.ZstdCompressor(1).compress}


def chunk(size: int, packed: bytes, compression: str, crc: int = 0) -> bytes:
    """A chunk that says to hold ``size`` bytes."""
    name = compression.encode()
    body = struct.pack("<QQQII", 0, 0, size, crc, len(name)) + name
    body += struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", Opcode.CHUNK, len(body)) + body


def put_in_front(file: Path, content: bytes) -> Path:
    """Put bytes before the first record behind the header."""
    whole = file.read_bytes()
    at = record_starts(whole)[1][0]
    file.write_bytes(whole[:at] + content + whole[at:])
    return file


@pytest.fixture
def verbs():
    with Verbs() as found:
        yield found


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_bombs_take_little_memory_and_no_sample_with_them(tmp_path, verbs, compression):
    size = 300 << 20
    packed = PACK[compression](bytes(size))
    bombs = chunk(size, packed, compression) + chunk(1000, packed, compression) * 8
    file = put_in_front(foreign_file(tmp_path / "a_0.mcap", BLOCKS), bombs)
    assert file.stat().st_size < 20e6
    for words in (["info", file], ["recover", file, "--out", tmp_path / "out"]):
        attempt = verbs(words)
        assert (attempt.code, attempt.traceback) == (0, "")
        assert attempt.peak_bytes < 1 << 30
    recording = read_recording(file)
    assert len(recording.samples) == 1000
    assert sum("damaged (it " in note for note in recording.notes) == 9


def test_many_chunks_of_the_largest_size_end_somewhere(tmp_path, verbs):
    rows = bytes(200 << 20)
    head = struct.pack("<BQHIQQ", Opcode.MESSAGE, len(rows) + 22, 99, 0, 0, 0)
    bomb = chunk(len(head) + len(rows), PACK["zstd"](head + rows), "zstd")
    file = put_in_front(foreign_file(tmp_path / "a.mcap", BLOCKS), bomb * 60)
    attempt = verbs(["info", file])
    assert (attempt.code, attempt.traceback) == (0, "")
    assert attempt.peak_bytes < 1 << 30
    assert "49 more records are left out" in attempt.text


def test_samples_that_unpack_to_more_than_any_run_are_refused(tmp_path, verbs):
    file = tmp_path / "a.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=20 << 20)
        writer.start()
        kind = FLOAT64_MULTI_ARRAY
        schema = writer.register_schema(kind.name, "ros2msg", kind.text.encode())
        topic = writer.register_channel("/a/samples", "cdr", schema)
        message = encode_samples(("t",), np.zeros((2_000_000, 1)))
        for number in range(20):
            writer.add_message(topic, number, message, number)
        writer.finish()
    attempt = verbs(["info", file])
    assert (attempt.code, attempt.traceback) == (2, "")
    assert "unpacks to more than 256 MiB" in attempt.text
    assert attempt.peak_bytes < 1 << 30
    assert recording_info(write_run(tmp_path)).n_samples == 5000
    with pytest.raises(RecordingError, match="unpacks to more than 0 MiB"):
        read_recording(tmp_path / "run", most_bytes=1000)


@pytest.mark.parametrize("told", [0, 10, 10**6, 2**40, 2**63, 2**64 - 1])
@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_a_chunk_that_lies_about_its_size_is_left_out(tmp_path, told, compression):
    packed = PACK[compression](b"content" * 99) if compression else b"content" * 99
    lie = chunk(told, packed, compression)
    file = put_in_front(foreign_file(tmp_path / "a.mcap", BLOCKS), lie)
    recording = read_recording(file)
    assert len(recording.samples) == 1000
    assert any("damaged" in note for note in recording.notes)


def test_a_chunk_holds_no_chunk(tmp_path):
    inner = b""
    for _ in range(1200):
        inner = chunk(len(inner), inner, "")
    recording = read_recording(put_in_front(foreign_file(tmp_path / "a.mcap", BLOCKS), inner))
    assert len(recording.samples) == 1000
    assert any("belongs into no chunk" in note for note in recording.notes)


def test_the_most_of_a_chunk_is_an_argument(tmp_path):
    scan = Scan(foreign_file(tmp_path / "a.mcap", BLOCKS), most_bytes=1000)
    assert list(scan.messages()) == []
    assert scan.damaged > 0
    assert all("too long (at most 1000 bytes" in note for note in scan.notes[:3])


@pytest.mark.parametrize("length", [2**31, 2**62, 2**63, 2**64 - 1])
def test_no_record_is_longer_than_its_file(tmp_path, length):
    record = struct.pack("<BQ", Opcode.MESSAGE, length)
    file = put_in_front(foreign_file(tmp_path / "a.mcap", BLOCKS, finish=False), record)
    with pytest.raises(RecordingError, match="must hold samples"):
        read_recording(file)


@pytest.mark.parametrize("at", [8, 2**31, 2**63, 2**64 - 1])
def test_a_summary_may_start_anywhere(tmp_path, at):
    file = foreign_file(tmp_path / "a_0.mcap", BLOCKS)
    whole = file.read_bytes()
    file.write_bytes(whole[:-28] + struct.pack("<Q", at) + whole[-20:])
    recording = read_recording(file)
    assert len(recording.samples) == 1000
    assert any("index of a_0.mcap is damaged" in note for note in recording.notes)
    assert recover(file).changed
    assert read_recording(file).notes == ()


def test_a_chunk_under_another_name_is_missed(tmp_path):
    file = foreign_file(tmp_path / "a.mcap", BLOCKS, channels=None)
    whole = bytearray(file.read_bytes())
    last = [at for at, opcode, _ in record_starts(whole) if opcode == Opcode.CHUNK][-1]
    whole[last] = Opcode.MESSAGE_INDEX
    file.write_bytes(whole)
    notes = " ".join(read_recording(file).notes)
    assert "says that it holds 10 messages" in notes


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[" * 100_000, "too many brackets"),
        ('{"a":' + "[" * 40 + "]" * 40 + "}", "nest 32 deep"),
        ('{"a": ' + "9" * 5000 + "}", "5000 digits"),
        ('{"a": NaN}', "no finite number"),
        ('{"a": 1e999}', "no finite number"),
        ('{"a": "' + "x" * (5 << 20) + '"}', "4194304 characters"),
    ],
)
def test_json_that_no_program_writes_is_left_out(tmp_path, text, said):
    recording = read_recording(foreign_file(tmp_path / "a.mcap", BLOCKS, channels=text))
    assert recording.channels.content == {}
    assert any(said in note and len(note) < 400 for note in recording.notes)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("state", value) for value in (3, [], {"y": 1}, {"y": [[1.0]], "cycle": 0})),
        *(("parameters", value) for value in (3, [], "K")),
        *(("channels", value) for value in (3, ["t"], [{"name": "t", "unit": 3}])),
        *(("source", value) for value in (3, "\ud800", "\x1b[2J", "long " * 1000)),
        *(("clock", value) for value in (3, {"t_s": "a"}, {"other": 1.0})),
    ],
)
def test_a_part_of_the_channels_of_a_wrong_kind_is_a_note(tmp_path, name, value):
    text = json.dumps({"model": "reduced", name: value})
    recording = read_recording(foreign_file(tmp_path / "a.mcap", BLOCKS, channels=text))
    assert recording.channels.model == "reduced"
    said = [note for note in recording.notes if note.startswith(f"{name} in the channels message")]
    assert len(said) == 1
    assert len(said[0]) < 400
    assert said[0].isprintable()


def test_channels_are_typed_where_they_are_right(tmp_path):
    told = read_recording(write_run(tmp_path)).channels
    assert (told.content, told.source, told.version) == (CHANNELS, "simulator", "0.1.0")
    assert told.units["t"] == "s"
    assert (told.parameters, told.state) == ({"Omega": 1.0}, None)


def test_an_enormous_list_of_channels_is_refused_at_once(tmp_path):
    names = tuple(f"c{number}" for number in range(200_000))
    file = foreign_file(tmp_path / "a.mcap", [np.zeros((1, len(names)))], names=names)
    with pytest.raises(RecordingError, match="at most 8000, got 1 x 200000"):
        read_recording(file)


def test_a_layout_of_millions_of_dimensions_is_refused_at_once():
    with pytest.raises(RecordingError, match="2 dimensions"):
        decode_samples(b"\x00\x01\x00\x00" + struct.pack("<I", 2**32 - 1) + bytes(10**6))


def test_times_that_are_not_finite_do_not_increase(tmp_path):
    rows = make_rows(0, 10)
    rows[-1, 0] = np.inf
    with pytest.raises(RecordingError, match="time must increase strictly"):
        read_recording(foreign_file(tmp_path / "a.mcap", [rows]))


@pytest.mark.parametrize("count", ["²", "9" * 5000, "-1", "many"])
def test_a_count_that_is_none_is_not_believed(tmp_path, count):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 10))
    writer.flush()
    file = writer.path / "run_0.mcap"
    content = struct.pack("<I", 15) + b"herringbone_sim"
    pair = b"".join(struct.pack("<I", len(t)) + t for t in (b"samples_written", count.encode()))
    content += struct.pack("<I", len(pair)) + pair
    with file.open("ab") as stream:
        stream.write(struct.pack("<BQ", Opcode.METADATA, len(content)) + content)
    assert recording_info(file).samples_counted is None


@pytest.mark.parametrize("qos", ["a: [", "- 3", "&a [*a, *a]", "[" * 3000, "text", "9" * 5000])
def test_a_damaged_quality_of_service_is_left_out(tmp_path, qos):
    run = tmp_path / "rig"
    run.mkdir()
    with (run / "rig_0.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        kind = FLOAT64_MULTI_ARRAY
        schema = writer.register_schema(kind.name, "ros2msg", kind.text.encode())
        told = {"offered_qos_profiles": qos}
        topic = writer.register_channel("/rig/samples", "cdr", schema, told)
        writer.add_message(topic, 0, encode_samples(NAMES, make_rows(0, 10)), 0)
        writer.finish()
    report = recover(run, tmp_path / "out")
    assert report.samples == 10
    assert any("quality of service of /rig/samples" in note for note in report.notes)
    assert read_recording(tmp_path / "out").notes[0].startswith("there is no channels message")


def file_of_topics(path: Path, n: int, finish: bool) -> Path:
    """A file with n topics and a message on the last."""
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=finish)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        for number in range(n):
            topic = writer.register_channel(f"/topic_{number}", "cdr", schema)
        writer.add_message(topic, 0, encode_string("a"), 0)
        if finish:
            writer.finish()
    return path


@pytest.mark.parametrize("finish", [True, False])
def test_more_topics_than_any_robot_has_are_refused(tmp_path, finish):
    scan = Scan(file_of_topics(tmp_path / "a.mcap", MOST_TOPICS, finish))
    assert (len(list(scan.messages())), len(scan.topics)) == (1, MOST_TOPICS)
    file = file_of_topics(tmp_path / "a.mcap", MOST_TOPICS + 1, finish)
    for read in (read_recording, recover):
        with pytest.raises(RecordingError, match="4096 topics"):
            read(file)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_what_lies_behind_a_damaged_chunk_is_recovered(tmp_path, compression):
    file = foreign_file(tmp_path / "a_0.mcap", BLOCKS, compression=compression)
    whole = bytearray(file.read_bytes())
    first = next(at for at, opcode, _ in record_starts(whole) if opcode == Opcode.CHUNK)
    whole[first + 9 + 32] ^= 0xFF
    file.write_bytes(whole)
    assert read_recording(file).samples.times[-1] == BLOCKS[-1][-1, 0]
