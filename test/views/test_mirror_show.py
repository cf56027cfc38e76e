"""``show``: a recording through the mirror."""

from __future__ import annotations

import dataclasses
import subprocess
from pathlib import Path

import numpy as np
import pytest

from herringbone_sim.__main__ import main
from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.layout import Layout
from herringbone_sim.core.model import build, half_backlashes
from herringbone_sim.core.parameters import Parameters, to_mapping
from herringbone_sim.core.scaling import scales
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.channels import Channels
from herringbone_sim.recording.reader import ParameterChange, Recording, read_recording
from herringbone_sim.recording.writer import RunWriter
from herringbone_sim.views.mirror import screenshot
from herringbone_sim.views.mirror.replay import block_edges, layout_of, prepare, replay_blocks

CYCLES = 130


@pytest.fixture(scope="module")
def gear() -> Parameters:
    return Parameters(delta_T=60.0, initial_x=(0.3, 0.2, 0.1, 0.25))


@pytest.fixture(scope="module")
def run(gear: Parameters, tmp_path_factory: pytest.TempPathFactory) -> Path:
    model = build(gear)
    samples, end = simulate(model, CYCLES)
    changed = build(gear.changed({"K": 0.1}))
    more, _ = simulate(changed, CYCLES, end)
    channels = {"parameters": to_mapping(gear)}
    folder = tmp_path_factory.mktemp("runs")
    writer = RunWriter.create(folder, "run", "/sim", channels, model.layout.channels, 0)
    writer.write_samples(samples.data)
    writer.write_parameter_event(float(more.times[0]), "/sim", {"K": 0.1})
    writer.write_samples(more.data)
    writer.close()
    return writer.path


def test_blocks_hold_every_sample_and_every_section_point_once(run: Path) -> None:
    recording = read_recording(run)
    replay = prepare(recording)
    blocks = list(replay_blocks(recording, replay, 20, 400))
    assert np.array_equal(np.vstack([block.rows for block in blocks]), recording.samples.data)
    sections = np.vstack([block.sections for block in blocks])
    assert len(sections) == 2 * CYCLES
    x = recording.samples.names.index("x_sp_L")
    assert sections[:, x] == pytest.approx(recording.samples.data[::16, x])


def test_blocks_carry_parameters_events_and_hot_backlash(run: Path, gear: Parameters) -> None:
    recording = read_recording(run)
    replay = prepare(recording)
    blocks = list(replay_blocks(recording, replay, 20, 400))
    assert blocks[0].parameters["K"] == 0.0
    assert blocks[-1].parameters["K"] == pytest.approx(0.1)
    assert [e for block in blocks for e in block.events if "K = 0.1" in e]
    assert blocks[0].b_half == pytest.approx(
        dict(zip(("sp", "rp"), half_backlashes(gear, scales(gear))[[0, 2]], strict=True))
    )
    assert replay.scale is not None
    assert replay.scale.b_c == gear.b_c


def test_heat_that_is_recorded_moves_the_backlash(run: Path) -> None:
    recording = read_recording(run)
    data = recording.samples.data.copy()
    data[len(data) // 2 :, recording.samples.names.index("delta_T")] = 90.0
    hot = dataclasses.replace(
        recording, samples=TimeSeries(recording.samples.times, data, recording.samples.names)
    )
    blocks = list(replay_blocks(hot, prepare(hot), 20, 400))
    assert blocks[0].b_half is not None
    assert blocks[-1].b_half is not None
    assert blocks[-1].b_half["sp"] < blocks[0].b_half["sp"]


def test_heat_beyond_the_backlash_leaves_none(run: Path) -> None:
    recording = read_recording(run)
    data = recording.samples.data.copy()
    data[:, recording.samples.names.index("delta_T")] = 900.0
    hot = dataclasses.replace(
        recording, samples=TimeSeries(recording.samples.times, data, recording.samples.names)
    )
    assert next(replay_blocks(hot, prepare(hot), 20, 400)).b_half == {"sp": 0.0, "rp": 0.0}


def test_long_runs_are_cut_into_the_largest_number_of_blocks(run: Path) -> None:
    replay = prepare(read_recording(run))
    assert len(block_edges(replay, 20, 400)) == 13
    edges = block_edges(replay, 20, 5)
    assert len(edges) == 5
    assert edges[0][0] == 0
    assert edges[-1][1] == len(replay.rows)


@pytest.mark.parametrize("at", [0, -1, slice(None)])
def test_a_phase_that_is_unknown_is_shown_all_the_same(run: Path, at: int | slice) -> None:
    recording = read_recording(run)
    data = recording.samples.data.copy()
    data[at, recording.samples.names.index("phase")] = np.nan
    samples = TimeSeries(recording.samples.times, data, recording.samples.names)
    holed = dataclasses.replace(recording, samples=samples)
    blocks = list(replay_blocks(holed, prepare(holed), 20, 400))
    assert len(blocks) > 5
    assert sum(len(block.rows) for block in blocks) == len(data)


def test_regime_is_a_period_once_the_motion_has_settled(gear: Parameters) -> None:
    linear = build(gear.changed({"b": 0.0, "delta_T": 0.0, "k_amp": (0.01,), "xi": 0.2}))
    _, settled = simulate(linear, 400)
    samples, _ = simulate(linear, 100, settled)
    recording = Recording(Path("none"), "none", samples, Channels(), (), True, ())
    blocks = list(replay_blocks(recording, prepare(recording), 20, 400))
    assert blocks[-1].regime == "P1"


def test_foreign_names_without_phase_or_parameters_can_be_shown() -> None:
    times = np.arange(1000) * 1e-5
    samples = TimeSeries(
        times, np.column_stack([np.sin(times), np.cos(times)]), ("x_sp2_L", "T_x")
    )
    change = ParameterChange(0.001, 1_000_000, "/rig", {"K": 0.2, "note": "text"})
    recording = Recording(Path("none"), "none", samples, Channels(), (change,), True, ())
    replay = prepare(recording)
    assert replay.layout == Layout(2, numbered=True)
    assert replay.scale is None
    assert len(replay.notes) == 2
    blocks = list(replay_blocks(recording, replay, 20, 400))
    assert sum(len(block.rows) for block in blocks) == 1000
    assert blocks[-1].parameters["K"] == 0.2
    assert prepare(recording, nominal=True).scale is not None


def test_parameters_of_another_program_are_told_not_fatal() -> None:
    samples = TimeSeries(np.arange(3.0), np.zeros((3, 1)), ("F_rp_R",))
    told = Channels(parameters={"stiffness": 3})
    replay = prepare(Recording(Path("none"), "none", samples, told, (), True, ()))
    assert replay.gear is None
    assert "stiffness" in " ".join(replay.notes)


def test_layout_of_names() -> None:
    assert layout_of(("t", "x_sp_L")) == Layout(1, numbered=False)
    assert layout_of(("t", "F_rp3_R", "x_sp1_L")) == Layout(3, numbered=True)
    assert layout_of(("t",)) == Layout(1, numbered=False)


def test_show_saves_a_file_that_rerun_verifies(run: Path, tmp_path: Path) -> None:
    from herringbone_sim.views.mirror.sink import rerun_binary

    path = tmp_path / "run.rrd"
    assert main(["show", str(run), "--save", str(path), "--mesh", "rp_R"]) == 0
    subprocess.run([rerun_binary(), "rrd", "verify", str(path)], check=True, timeout=120)


@pytest.mark.parametrize(
    ("words", "match"),
    [
        (("--mesh", "sp7_L"), "sp7_L"),
        (("--size", "big", "--screenshot", "x.png"), "--size"),
        (("--burst", "0"), "burst"),
        (("--blocks", "0"), "--blocks"),
    ],
)
def test_show_says_what_is_wrong(
    run: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    match: str,
) -> None:
    assert main(["show", str(run), "--save", str(tmp_path / "run.rrd"), *words]) == 2
    assert match in capsys.readouterr().err


def test_show_of_nothing_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", str(tmp_path / "missing"), "--save", str(tmp_path / "run.rrd")]) == 2
    assert "missing" in capsys.readouterr().err


def test_picture_is_drawn_or_the_missing_driver_is_said(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "none.json"))
    monkeypatch.setenv("VK_ICD_FILENAMES", str(tmp_path / "none.json"))
    png = tmp_path / "run.png"
    if main(["show", str(run), "--screenshot", str(png), "--blocks", "4"]) == 0:
        assert png.read_bytes().startswith(b"\x89PNG")
    else:
        assert "Vulkan" in capsys.readouterr().err
        assert not png.exists()


def test_a_picture_in_a_new_folder_is_written_and_a_wrong_one_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(screenshot, "rerun_binary", lambda: "true")
    monkeypatch.setattr(screenshot, "await_answer", lambda *_: None)
    monkeypatch.setattr(screenshot, "stable_screenshot", lambda _: b"picture")
    screenshot.take_screenshot(tmp_path / "run.rrd", tmp_path / "new" / "run.png")
    assert (tmp_path / "new" / "run.png").read_bytes() == b"picture"
    with pytest.raises(RecordingError, match=r"run\.png/x\.png .*: choose another file"):
        screenshot.take_screenshot(tmp_path / "run.rrd", tmp_path / "new" / "run.png" / "x.png")
