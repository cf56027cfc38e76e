"""``campaign import`` of files that are unusual: nothing is dropped, guessed or hidden."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import yaml
from recording_support import write_bag

from herringbone_sim.__main__ import main
from herringbone_sim.arrays import Array
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.importing.campaign import ImportedRun, import_campaign
from herringbone_sim.recording.importing.clock import ClockGroup, merged
from herringbone_sim.recording.importing.columns import read_columns
from herringbone_sim.recording.importing.parse import read_spec
from herringbone_sim.recording.importing.units import factor, quantity
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.writer import RunWriter
from herringbone_sim.views.mirror.block import contact_states

POINT = {"delta_T": 20.0, "K": 0.0, "T_1": 220.0, "Omega": 1.0}
OMEGA = build(Parameters(model="full", **POINT)).scales.omega_n
TIMES = np.arange(480) * (2.0 * np.pi / OMEGA / 24.0)
PHASE = {"column": "phase", "unit": "rad"}
FORCE = {"column": "F", "unit": "N"}
TORQUE = {"column": "T", "unit": "N m"}


def write_csv(path: Path, **columns: Array) -> None:
    rows = np.column_stack([*columns.values()]).tolist()
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")


def write_spec(folder: Path, *files: dict[str, Any]) -> Path:
    run = {"name": "run_00", "role": "fit", **POINT}
    content = {"rig": "bench", "files": list(files), "runs": [run]}
    (folder / "spec.yaml").write_text(yaml.safe_dump(content))
    return folder / "spec.yaml"


def entry(path: str, *, time: dict[str, str] | None = None, **channels: Any) -> dict[str, Any]:
    clock = time or {"column": "t", "unit": "s"}
    return {"path": path, "time": clock, "channels": channels}


def imported(spec: Path) -> tuple[ImportedRun, TimeSeries]:
    out = spec.parent / "out"
    (run,) = import_campaign(read_spec(spec), out)
    return run, read_recording(out / run.name).samples


@pytest.mark.parametrize(
    ("text", "si"), [("-0,5 ms", "s"), ("12,5 N", "N"), ("1,02", "-"), ("220,5 N m", "N m")]
)
def test_a_decimal_comma_is_refused_not_dropped(text: str, si: str) -> None:
    with pytest.raises(ValueError, match="decimal point"):
        quantity(text, si)


def test_a_unit_that_is_a_sum_is_refused() -> None:
    with pytest.raises(ValueError, match="m\\+m"):
        factor("m+m", "m")


def test_a_column_that_stands_twice_is_an_error_only_if_it_is_wanted(tmp_path: Path) -> None:
    lines = ["t,phase,F,F,x,x", *(f"{t!r},{OMEGA * t!r},1.0,7.0,0,0" for t in TIMES.tolist())]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(RecordingError, match="one column 'F'"):
        imported(write_spec(tmp_path, entry("a.csv", phase=PHASE, F_sp1_L=FORCE)))
    run, _ = imported(write_spec(tmp_path, entry("a.csv", phase=PHASE)))
    assert run.samples == len(TIMES)


def test_a_column_of_empty_cells_is_nan(tmp_path: Path) -> None:
    lines = ["t,phase,F", *(f"{t!r},{OMEGA * t!r}," for t in TIMES.tolist())]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    run, series = imported(write_spec(tmp_path, entry("a.csv", phase=PHASE, F_sp1_L=FORCE)))
    assert np.isnan(series["F_sp1_L"]).all()
    assert "F_sp1_L has no number in 100.0% of the samples" in run.remarks


@pytest.mark.parametrize(
    "time", [{"column": "t", "start": "1 s"}, {"rate": "4 kHz", "unit": "ms"}]
)
def test_an_entry_of_time_without_effect_is_an_error(tmp_path: Path, time: dict[str, str]) -> None:
    write_csv(tmp_path / "a.csv", t=TIMES, phase=OMEGA * TIMES)
    with pytest.raises(RecordingError, match="must be beside a"):
        read_spec(write_spec(tmp_path, entry("a.csv", time=time, phase=PHASE)))


def test_a_folder_with_a_dot_is_a_bag(tmp_path: Path) -> None:
    (tmp_path / "speed_0.8").mkdir()
    spec = read_spec(write_spec(tmp_path, entry("speed_0.8", time={"rate": "4 kHz"}, phase=PHASE)))
    assert spec.runs[0].files[0].kind == "rosbag2"


def test_a_phase_with_a_missing_cell_still_has_its_cycles(tmp_path: Path) -> None:
    phase = OMEGA * TIMES
    phase[0] = np.nan
    write_csv(tmp_path / "a.csv", t=TIMES, phase=phase)
    run, _ = imported(write_spec(tmp_path, entry("a.csv", phase=PHASE)))
    assert run.cycles == pytest.approx(478 / 24)
    assert not any("nan" in text for text in run.remarks)


def test_a_wrapped_phase_is_told(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", t=TIMES, phase=np.mod(OMEGA * TIMES, 2.0 * np.pi))
    run, _ = imported(write_spec(tmp_path, entry("a.csv", phase=PHASE)))
    assert any("unwrapped" in text for text in run.remarks)
    there = tmp_path / "other"
    there.mkdir()
    write_csv(there / "a.csv", t=TIMES, phase=OMEGA * TIMES)
    run, _ = imported(write_spec(there, entry("a.csv", phase=PHASE)))
    assert not any("unwrapped" in text for text in run.remarks)


def test_a_file_of_another_time_is_not_told_to_resample(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", t=TIMES, phase=OMEGA * TIMES)
    write_csv(tmp_path / "b.csv", t=TIMES + 5.0, T=TIMES)
    files = entry("a.csv", phase=PHASE), entry("b.csv", T_in=TORQUE)
    run, _ = imported(write_spec(tmp_path, *files))
    assert "nothing in common" in dict(run.left)["T_in"]


def test_a_hole_is_not_filled_by_a_straight_line(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", t=TIMES, phase=OMEGA * TIMES)
    there = np.r_[0:100, 300:480]
    write_csv(tmp_path / "b.csv", t=TIMES[there] + 1e-7, T=220.0 + TIMES[there])
    second = entry("b.csv", T_in=TORQUE) | {"resample": True}
    _, series = imported(write_spec(tmp_path, entry("a.csv", phase=PHASE), second))
    assert 199 <= np.isnan(series["T_in"]).sum() <= 202


def test_an_hdf5_file_with_an_empty_dataset_is_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"], file["phase"], file["comment"] = TIMES, OMEGA * TIMES, h5py.Empty("S10")
    run, _ = imported(write_spec(tmp_path, entry("a.h5", phase=PHASE)))
    assert run.samples == len(TIMES)


def test_names_of_a_block_with_spaces_are_those_of_the_reader(tmp_path: Path) -> None:
    rows = np.column_stack([TIMES, OMEGA * TIMES])
    write_bag(tmp_path / "bag", ("/rig/samples", "t, phase", rows))
    assert read_recording(tmp_path / "bag").samples.names == ("t", "phase")
    columns = {"column": "/rig/samples.t"}, {"column": "/rig/samples.phase", "unit": "rad"}
    run, _ = imported(write_spec(tmp_path, entry("bag", time=columns[0], phase=columns[1])))
    assert run.samples == len(TIMES)


def test_a_run_with_gaps_in_its_temperature_is_shown(tmp_path: Path) -> None:
    columns = {
        "t": TIMES,
        "phase": OMEGA * TIMES,
        "delta_T": np.where(np.arange(480) % 7 == 3, 20.0, np.nan),
        "x_sp1_L": 1e-5 * np.cos(OMEGA * TIMES),
        "v_sp1_L": -1e-5 * OMEGA * np.sin(OMEGA * TIMES),
    }
    writer = RunWriter.create(tmp_path, "run", "/rig", {"source": "rig"}, tuple(columns), 0)
    writer.write_samples(np.column_stack(list(columns.values())))
    writer.close()
    saved = tmp_path / "a.rrd"
    assert main(["show", str(tmp_path / "run"), "--save", str(saved), "--burst", "2"]) == 0


@pytest.mark.parametrize("scale", [0.5, 1.5])
def test_a_wrapped_encoder_behind_a_gear_is_unwrapped_before_its_scale(
    tmp_path: Path, scale: float
) -> None:
    """An encoder in degrees that turns faster or slower than the carrier."""
    carrier = np.linspace(0.0, 28.0, 480)  # rad
    degrees = np.mod(np.degrees(carrier / scale), 360.0)
    write_csv(tmp_path / "a.csv", t=TIMES, phase=OMEGA * TIMES, angle=degrees)
    column = {"column": "angle", "unit": "deg", "scale": scale}
    _, series = imported(write_spec(tmp_path, entry("a.csv", phase=PHASE, angle_c=column)))
    assert np.abs(series["u_c"]).max() < 1e-9


def test_a_wrapped_counter_is_unwrapped_after_its_scale(tmp_path: Path) -> None:
    counts = np.mod(np.linspace(0.0, 28.0, 480) * 4096.0 / (2.0 * np.pi), 4096.0)
    write_csv(tmp_path / "a.csv", t=TIMES, phase=OMEGA * TIMES, angle=counts)
    column = {"column": "angle", "unit": "rad", "scale": 2.0 * np.pi / 4096.0}
    _, series = imported(write_spec(tmp_path, entry("a.csv", phase=PHASE, angle_c=column)))
    assert np.abs(series["u_c"]).max() < 1e-9


@pytest.mark.parametrize("name", ["import.html", "campaign.yaml", "nominal.yaml"])
def test_a_run_has_no_name_of_a_file_of_the_campaign(tmp_path: Path, name: str) -> None:
    write_csv(tmp_path / "a.csv", t=TIMES, phase=OMEGA * TIMES)
    spec = write_spec(tmp_path, entry("a.csv", phase=PHASE))
    spec.write_text(spec.read_text().replace("run_00", name))
    with pytest.raises(RecordingError, match="none of the files of a campaign"):
        read_spec(spec)


def test_what_is_not_recorded_is_no_contact_and_no_separation() -> None:
    assert contact_states(np.array([2.0, np.nan, -2.0, 0.0]), 1.0).tolist() == [0, 3, 2, 1]


def test_an_angle_without_any_number_is_nan_without_a_warning(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    nothing = np.full(len(TIMES), np.nan)
    write_csv(tmp_path / "a.csv", t=TIMES, phase=OMEGA * TIMES, angle=nothing)
    column = {"column": "angle", "unit": "deg", "scale": 0.5}
    _, series = imported(write_spec(tmp_path, entry("a.csv", phase=PHASE, angle_c=column)))
    assert np.isnan(series["u_c"]).all()
    assert not [w for w in recwarn if w.category is RuntimeWarning]


def test_one_file_beside_another_bag_is_that_file(tmp_path: Path) -> None:
    """And one that is the whole bag is read with its folder."""
    rows = np.column_stack([TIMES, TIMES])
    for name, n in (("a", 200), ("b", 50)):
        write_bag(tmp_path / name, ("/rig/samples", "t,phase", rows[:n]))
    own = next((tmp_path / "b").glob("*.mcap"))
    other = tmp_path / "a" / "other.mcap"
    other.write_bytes(own.read_bytes())
    for path in (own, other):
        read = read_columns(path, "rosbag2", ["/rig/samples.t"], {})
        assert len(read.values["/rig/samples.t"]) == 50


def test_the_working_folder_is_filled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_csv(tmp_path / "a.csv", t=TIMES, phase=OMEGA * TIMES)
    write_spec(tmp_path, entry("a.csv", phase=PHASE))
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path / "out")
    assert main(["campaign", "import", "../spec.yaml", "--out", "."]) == 0
    assert {"import.html", "campaign.yaml", "run_00"} <= {f.name for f in Path().iterdir()}


def test_a_star_stands_in_the_column_too(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", t=TIMES, phase=TIMES, x=TIMES)
    column = {"column": "x", "unit": "um"}
    spec = write_spec(tmp_path, entry("a.csv", phase=PHASE, **{"x_*": column}))
    with pytest.raises(RecordingError, match=r"column of 'x_\*' must have a star"):
        read_spec(spec)


def test_a_sensor_that_the_rig_lacks_is_refused(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", t=TIMES, phase=OMEGA * TIMES)
    spec = write_spec(tmp_path, entry("a.csv", phase=PHASE))
    spec.write_text(spec.read_text() + "sensors: {F_sp1: {rms: 30}}\n")
    with pytest.raises(RecordingError, match=r"sensors must be of channels.*did you mean F_sp1_"):
        read_spec(spec)


def test_times_of_tdms_are_not_cut_to_microseconds(tmp_path: Path) -> None:
    """The format counts in 2^-64 s, so that a microsecond is not a whole number of its ticks."""
    tdms = pytest.importorskip("nptdms")
    times = np.datetime64("2026-01-01T00:00:00", "us") + np.arange(50) * np.timedelta64(1, "us")
    with tdms.TdmsWriter(str(tmp_path / "a.tdms")) as writer:
        writer.write_segment([tdms.ChannelObject("g", "t", times)])
    read = read_columns(tmp_path / "a.tdms", "tdms", ["g/t"], {}).values["g/t"]
    assert np.diff(read).astype(float) == pytest.approx(1000.0, abs=2.0)  # [ns]


def test_readings_at_both_ends_of_a_hole_are_kept() -> None:
    slow = np.array([0.0, 1.0, 2.0, 3.0, 8.0, 9.0, 10.0])
    fast = 0.5 * np.arange(21)
    groups = (
        ClockGroup("fast", fast, {"phase": fast}, False),
        ClockGroup("slow", slow, {"T_in": slow}, True),
    )
    lacking = ~np.isfinite(merged(groups).values["T_in"])
    assert fast[lacking].tolist() == (0.5 * np.arange(7, 16)).tolist()
    slow = slow[3:] - 3.0  # the first reading is followed by the hole
    groups = (groups[0], ClockGroup("slow", slow, {"T_in": slow}, True))
    found = merged(groups)
    assert np.isfinite(found.values["T_in"][found.times == 0.0]).all()
