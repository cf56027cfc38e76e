"""What ``info`` and ``recover`` tell of a run."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
from recording_support import (
    NAMES,
    RATE_HZ,
    SAMPLES_PER_CYCLE,
    foreign_file,
    make_rows,
    new_run,
    write_run,
)

from herringbone_sim.cli.arguments import parse
from herringbone_sim.recording.gaps import MOST_MISSING, Gap, find_gaps
from herringbone_sim.recording.info import recording_info


def command(*words: object) -> int:
    """Exit code of a command line."""
    verb, *rest = map(str, words)
    return parse(verb, rest)()


def test_rates_come_from_time_and_phase(tmp_path):
    info = recording_info(write_run(tmp_path, 4001))
    assert info.n_samples == info.samples_counted == 4001
    assert info.duration_s == pytest.approx(4000 / RATE_HZ)
    assert info.sample_rate_hz == pytest.approx(RATE_HZ)
    assert info.samples_per_cycle == pytest.approx(SAMPLES_PER_CYCLE)
    assert info.mesh_hz == pytest.approx(RATE_HZ / SAMPLES_PER_CYCLE)
    assert (info.source, info.model, info.version) == ("simulator", "reduced", "0.1.0")
    assert info.parameters == {"Omega": 1.0}
    assert [change.values for change in info.changes] == [{"K": 0.5}]
    assert (info.complete, info.gaps, info.missing, info.notes) == (True, (), 0, ())
    assert info.bytes_of_samples == 4001 * len(NAMES) * 8
    assert info.bytes_on_disk == (tmp_path / "run" / "run_0.mcap").stat().st_size


def test_channels_are_summarised(tmp_path):
    channels = {channel.name: channel for channel in recording_info(write_run(tmp_path)).channels}
    assert channels["t"].unit == "s"
    assert channels["delta_T"].constant
    x = make_rows(0, 5000)[:, NAMES.index("x_sp_L")]
    assert channels["x_sp_L"].minimum == x.min()
    assert channels["x_sp_L"].mean == pytest.approx(x.mean())
    assert not channels["x_sp_L"].constant


def test_numbers_that_are_none_and_constant_channels_are_told(tmp_path):
    rows = make_rows(0, 100)
    rows[10:13, NAMES.index("x_sp_L")] = [np.nan, np.inf, -np.inf]
    rows[:, NAMES.index("F_sp_L")] = np.nan
    rows[:, NAMES.index("phase")] = 0.0
    info = recording_info(foreign_file(tmp_path / "a.mcap", [rows]))
    notes = " ".join(info.notes)
    assert "no finite number in some samples of x_sp_L (3), F_sp_L (100)" in notes
    assert "constant throughout: phase" in notes
    assert info.channels[NAMES.index("F_sp_L")].mean is None
    assert (info.samples_per_cycle, info.mesh_hz) == (None, None)


def test_a_run_without_phase_is_summarised_by_time_alone(tmp_path):
    rows = np.delete(make_rows(0, 100)[:, [0, 5]], slice(40, 45), axis=0)
    info = recording_info(foreign_file(tmp_path / "a.mcap", [rows], names=("t", "x_sp_L")))
    assert (info.samples_per_cycle, info.mesh_hz) == (None, None)
    assert info.sample_rate_hz == pytest.approx(RATE_HZ)
    assert info.gaps == (Gap(40, rows[39, 0], 5),)


def test_a_single_sample_has_no_rate(tmp_path):
    info = recording_info(foreign_file(tmp_path / "a.mcap", [make_rows(0, 1)]))
    assert (info.n_samples, info.duration_s, info.sample_rate_hz) == (1, 0.0, None)


def test_time_that_jumps_back_is_summarised_all_the_same(tmp_path):
    rows = make_rows(0, 100)
    rows[60:, 0] -= 1
    info = recording_info(foreign_file(tmp_path / "a.mcap", [rows]))
    assert info.time_jump == 60
    assert any("at sample 60" in note for note in info.notes)


@pytest.mark.parametrize("text", ['{"channels": 3, "parameters": []}', '{"channels": ["t"]}'])
def test_odd_channels_are_survived(tmp_path, text):
    info = recording_info(foreign_file(tmp_path / "a.mcap", [make_rows(0, 9)], channels=text))
    assert (info.parameters, info.channels[0].unit) == ({}, "")


def test_gaps_are_counted_exactly():
    index = np.delete(np.arange(1000.0), [1, *range(100, 350), 997])
    gaps = find_gaps(index * 1e-3, index * 2 * np.pi / 24)
    assert [gap.missing for gap in gaps] == [1, 250, 1]
    assert [gap.index for gap in gaps] == [1, 99, 746]
    assert gaps[1].t_s == pytest.approx(0.099)


@pytest.mark.parametrize(
    ("steps", "missing"),
    [
        ([1, 1, 5, 5, 1, 1], [4, 4]),  # a single sample between two gaps
        ([5, 5, 5, 1, 1, 5], [4]),  # a wide last step
        ([1, 2, 1, 2, 1, 2], [1, 1, 1]),
        ([1, 1, np.nan, np.nan, 1, 5, 5, 1, 1], [4, 4]),
        ([1, 1, 1, 5, 5, 5], []),
        ([1, 1, 1, 5, 5], []),
    ],
)
def test_gaps_are_found_beside_each_other_and_at_the_ends(steps, missing):
    counter = np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])
    counter[np.flatnonzero(np.isnan(steps))[1:]] = np.nan
    assert [gap.missing for gap in find_gaps(counter, counter)] == missing


def test_a_clock_that_jitters_has_hardly_more_gaps_than_steps_wide_beside_both_neighbours():
    """Steps of 1 +- 0.2, none missing: the median beside wide steps adds few to these."""
    steps = np.random.default_rng(1).normal(1.0, 0.2, 20_000)
    inner = steps[1:-1]
    beside_both = np.sum(inner > 1.5 * np.maximum(steps[:-2], steps[2:]))
    counter = np.cumsum(np.r_[0.0, steps])
    assert len(find_gaps(counter, counter)) < 1.2 * beside_both


def test_another_number_of_samples_a_cycle_is_no_gap():
    steps = np.repeat([1.0, 4.0, 0.5, 2.0], 50)
    phase = np.cumsum(steps)
    assert find_gaps(phase, phase) == ()


@pytest.mark.parametrize("values", [[], [0.0], [0.0, 1.0], [0.0, 0.0, 0.0], [0.0, np.nan, np.inf]])
def test_a_clock_that_does_not_run_has_no_gaps(values):
    assert find_gaps(np.array(values), np.array(values)) == ()


@pytest.mark.parametrize(
    "counter",
    [
        [0.0, 5e-324, 1e-323, 1.0],
        [0.0, 1e-300, 2e-300, 1e300],
        [0.0, 1.0, np.inf, np.inf],
        [-1e308, 1e308, 1.1e308, 1.2e308],
    ],
)
def test_gaps_in_a_clock_out_of_range_are_counted_as_far_as_that_goes(tmp_path, counter):
    values = np.array(counter)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert all(gap.missing < MOST_MISSING for gap in find_gaps(values, values))
        rows = make_rows(0, 4)
        rows[:, 0] = rows[:, 1] = values
        info = recording_info(foreign_file(tmp_path / "a.mcap", [rows]))
    assert info.n_samples == 4


def test_the_page_shows_all_there_is(tmp_path, capsys):
    assert command("info", write_run(tmp_path)) == 0
    page = capsys.readouterr().out
    for line in (
        "samples          5000 (as many as were written)",
        "mesh frequency   5000 Hz",
        "samples a cycle  16",
        "  K        0.3",
        "  Omega    1.0",
        "  t = 0.01 s  /herringbone_sim  K = 0.5",
    ):
        assert line in page.splitlines()
    assert "notes" not in page
    assert "missing samples" not in page


def test_the_page_shows_what_is_wrong(tmp_path, capsys):
    writer = new_run(tmp_path)
    rows = make_rows(0, 2000)
    rows[1000:, NAMES.index("K")] = 0.6
    writer.write_samples(np.delete(rows, np.arange(100, 2000, 50), axis=0))
    writer.flush()
    command("info", writer.path)
    lines = capsys.readouterr().out.splitlines()
    assert "file             cut off: 'recover' rebuilds its index" in lines
    assert "samples          1962 (the writer left no count)" in lines
    assert "  1 after t = 0.0012375 s (sample 100)" in lines
    assert "  ... and 28 more" in lines
    assert "  K        0.3 to 0.6" in lines
    assert any("metadata.yaml is missing" in line for line in lines)


def test_json_is_for_other_programs(tmp_path, capsys):
    rows = make_rows(0, 100)
    rows[:, NAMES.index("F_sp_L")] = np.nan
    writer = new_run(tmp_path)
    writer.write_samples(rows)
    writer.write_parameter_event(0.0, "/n", {"gain": float("inf"), "raw": b"\1", "word": "a"})
    writer.close()
    assert command("info", writer.path, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["n_samples"], told["missing_samples"]) == (100, 0)
    assert told["path"] == str(writer.path)
    assert told["channels"][-1]["mean"] is None
    assert told["changes"][0]["values"] == {"gain": None, "raw": [1], "word": "a"}


def test_recover_tells_what_became_of_the_run(tmp_path, capsys):
    run = write_run(tmp_path, 20_000)
    assert command("recover", run) == 0
    assert "is complete: left as it is" in capsys.readouterr().out
    file = run / "run_0.mcap"
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) * 2 // 3])
    assert command("recover", run, "--out", tmp_path / "out") == 0
    told = capsys.readouterr().out
    assert f"{tmp_path}/out/out_0.mcap was cut off, and is complete now" in told
    assert "bytes at the end of the file" in told
    assert f"the file as it was is kept as {file}" in told
    (tmp_path / "out" / "metadata.yaml").unlink()
    command("recover", tmp_path / "out")
    assert "was finished, and is complete now" in capsys.readouterr().out


def test_recover_tells_of_damage_and_of_a_run_without_samples(tmp_path, capsys):
    file = foreign_file(tmp_path / "a_0.mcap", [make_rows(0, 100)], finish=False)
    content = bytearray(file.read_bytes())
    content[content.index(b"/rig/a/samples")] ^= 0xFF
    file.write_bytes(content)
    command("recover", file)
    told = capsys.readouterr().out
    assert "it holds 0 messages with 0 samples" in told
    assert "damaged records inside the file" in told
