"""Names and files that lead out of a run or nowhere, and recordings without samples."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from recording_support import foreign_file, make_rows, new_run, write_run

from benchmarks.faults.verbs import Verbs
from herringbone_sim.__main__ import main
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.recover import recover

BLOCKS = [make_rows(start, start + 100) for start in range(0, 1000, 100)]


@pytest.fixture
def verbs():
    with Verbs() as found:
        yield found


@pytest.mark.parametrize("name", ["../victim.mcap", "{}/victim.mcap", "link.mcap"])
def test_names_of_a_bag_stay_inside_it(tmp_path, name):
    victim = foreign_file(tmp_path / "victim.mcap", BLOCKS, finish=False)
    before = victim.read_bytes()
    run = write_run(tmp_path)
    text = (run / "metadata.yaml").read_text()
    (run / "metadata.yaml").write_text(text.replace("run_0.mcap", name.format(tmp_path)))
    if name == "link.mcap":
        (run / name).symlink_to(victim)
    assert len(read_recording(run / "run_0.mcap").samples) == 5000
    (run / "link.mcap").unlink(missing_ok=True)
    notes = " ".join(read_recording(run).notes)
    assert ("names files outside of the folder" in notes) is (name != "link.mcap")
    assert recover(run).changed
    assert victim.read_bytes() == before
    assert read_recording(run).notes == ()


def test_a_link_that_leads_out_of_a_run_is_not_followed(tmp_path):
    victim = foreign_file(tmp_path / "victim.mcap", BLOCKS, finish=False)
    before = victim.read_bytes()
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run_0.mcap").symlink_to(victim)
    for read in (read_recording, recover):
        with pytest.raises(RecordingError, match="must lie in its folder"):
            read(tmp_path / "run")
    assert victim.read_bytes() == before
    assert len(read_recording(tmp_path / "run" / "run_0.mcap").samples) == 1000


@pytest.mark.parametrize("kind", ["pipe", "socket", "device", "pipe in a folder"])
def test_what_is_no_file_is_not_opened(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    path = Path("run.mcap") if kind != "pipe in a folder" else Path("run/run_0.mcap")
    path.parent.mkdir(exist_ok=True)
    if kind == "socket":
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(str(path))
    elif kind == "device":
        path = Path("/dev/zero")
    else:
        os.mkfifo(path)
    named = path.parent if kind == "pipe in a folder" else path
    for read in (read_recording, recover):
        with pytest.raises(RecordingError, match="a pipe, a socket or a device"):
            read(named)


@pytest.mark.parametrize("verb", ["info", "recover", "replay --verify", "analyze --out out"])
@pytest.mark.parametrize("name", ["n" * 300, "a\0b", "loop", "\udcff.mcap", "loop/run"])
def test_names_that_lead_nowhere_are_one_error(tmp_path, monkeypatch, capsys, verb, name):
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    assert main([*verb.split(), name]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    assert len(said) < 300


def test_a_run_whose_name_no_terminal_can_show_is_told_all_the_same(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "utf-8:strict")
    run = write_run(tmp_path, 100, "run")
    odd = run.rename(tmp_path / "run\udcff")
    with Verbs() as verbs:
        attempt = verbs(["info", odd])
    assert (attempt.code, attempt.traceback) == (0, "")


def test_values_of_changes_are_shown_in_a_line(tmp_path, capsys):
    writer = new_run(tmp_path)
    writer.write_samples(make_rows(0, 100))
    writer.write_parameter_event(0.0, "/\x1b[2J", {"K\n": "x" * 100_000, "list": [1.0] * 9999})
    writer.close()
    assert main(["info", str(writer.path)]) == 0
    page = capsys.readouterr().out
    assert len(page) < 3000
    assert "\x1b" not in page


def test_a_run_without_samples_is_called_that_by_all(tmp_path, capsys):
    writer = new_run(tmp_path)
    writer.flush()
    run = writer.path
    del writer  # its program is gone
    for _ in range(2):
        assert main(["recover", str(run)]) == 1
        assert "holds no samples" in capsys.readouterr().out
        assert main(["info", str(run)]) == 2
        said = capsys.readouterr().err
        assert "cut off before the first" in said
        assert "record a topic" not in said


def test_a_run_that_ended_before_its_first_sample_is_not_blamed_on_the_topic(tmp_path):
    writer = new_run(tmp_path)
    writer.close()
    with pytest.raises(RecordingError, match="ended before the first: /herringbone_sim/samples"):
        read_recording(writer.path)
