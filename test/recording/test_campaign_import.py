"""``campaign import``: what stood in the files stands in the campaign, in SI, on one clock."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.io import savemat

from herringbone_sim.__main__ import main
from herringbone_sim.arrays import Array
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import RecordingError
from herringbone_sim.examples.files import WRITERS, write_example
from herringbone_sim.gap.data.kinematics import bodies_to_coordinates
from herringbone_sim.recording.campaign import read_campaign
from herringbone_sim.recording.importing.campaign import ImportedRun, import_campaign
from herringbone_sim.recording.importing.parse import read_spec
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.recording.reader import read_recording

POINT = {"role": "fit", "delta_T": 20.0, "K": 0.0, "T_1": 220.0, "Omega": 1.0}
MODEL = build(Parameters(model="full", **{k: v for k, v in POINT.items() if k != "role"}))
OMEGA = MODEL.scales.omega_n
TIMES = np.arange(480) * (2.0 * np.pi / OMEGA / 24.0)


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of files of each kind, and the campaign made of them in ``campaign``."""
    folder = tmp_path_factory.mktemp("example") / "files"
    spec = write_example(folder, cycles=10)
    import_campaign(read_spec(spec), folder / "campaign")
    return folder


def test_every_kind_of_file_gives_back_what_was_simulated(example: Path) -> None:
    came, was = (read_campaign(example / name) for name in ("campaign", "simulated"))
    assert len(came.runs) == len(WRITERS) == 7
    assert (came.rig, came.noise_share) == ("bench", was.noise_share)
    for new, old in zip(came.runs, was.runs, strict=True):
        assert (new.path.name, new.point, new.role) == (old.path.name, old.point, old.role)
        got, told = read_recording(new.path), read_recording(old.path).samples
        kept = [name for name in told.names if name[:2] in ("x_", "v_", "F_", "u_")]
        assert len(kept) == 45
        for name in (*kept, "phase"):
            assert got.samples[name] == pytest.approx(told[name], rel=4e-15, abs=1e-30)
            assert got.channels.units[name] == {"x": "m", "v": "m/s", "F": "N", "u": "m"}.get(
                name[0], "rad"
            )
        assert got.samples.times == pytest.approx(told.times, abs=1.1e-9)  # dates count ns


def test_the_torque_meter_comes_at_its_time_with_its_sign(example: Path) -> None:
    run = read_campaign(example / "campaign").runs[0]
    series = read_recording(run.path).samples
    assert series["T_in"].mean() == pytest.approx(run.point["T_1"], abs=2.0)


def test_the_nominal_gear_goes_with_the_campaign(example: Path) -> None:
    assert load_parameters(example / "campaign" / "nominal.yaml") == load_parameters(
        example / "rig.yaml"
    )


def write_csv(path: Path, **columns: Array) -> None:
    rows = np.column_stack([*columns.values()]).tolist()
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_spec(folder: Path, *files: Mapping[str, Any], **more: Any) -> Path:
    content = {"rig": "bench", "files": list(files), "runs": [{"name": "run_00", **POINT}]}
    spec = folder / "spec.yaml"
    spec.write_text(yaml.safe_dump(content | more), encoding="utf-8")
    return spec


def imported(spec: Path) -> tuple[ImportedRun, TimeSeries]:
    """What is told of the only run, and its samples."""
    out = spec.parent / "out"
    (run,) = import_campaign(read_spec(spec), out)
    return run, read_recording(out / run.name).samples


def entry(path: str, *, time: Any = None, **channels: Any) -> dict[str, Any]:
    clock = {"column": "t", "unit": "s"} if time is None else time
    return {"path": path, "time": clock, "channels": channels}


PHASE = {"column": "phase", "unit": "rad"}


def force(t: Array) -> Array:
    load: Array = 700.0 + 500.0 * np.cos(OMEGA * t)
    return load


def test_unit_scale_sign_and_offset(tmp_path: Path) -> None:
    raw = force(TIMES)
    write_csv(tmp_path / "a.csv", t=1e3 * TIMES, phase=OMEGA * TIMES, force=raw)
    told = {"column": "force", "unit": "lbf", "scale": 2.0, "sign": -1, "offset": "0.1 kN"}
    bare = {"column": "force", "unit": "N", "scale": 1, "offset": 3}
    file = entry(
        "a.csv", time={"column": "t", "unit": "ms"}, phase=PHASE, F_sp1_L=told, F_sp2_L=bare
    )
    _, series = imported(write_spec(tmp_path, file))
    pound_n = 0.45359237 * 9.80665
    assert series["F_sp1_L"] == pytest.approx(-2.0 * pound_n * raw + 100.0, rel=1e-13)
    assert series["F_sp2_L"] == pytest.approx(raw + 3.0, rel=1e-15)
    assert series.times == pytest.approx(TIMES, rel=1e-14)


def test_a_matrix_by_columns_as_matlab_and_python_count(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    data = np.column_stack([OMEGA * TIMES, force(TIMES)])
    savemat(tmp_path / "a.mat", {"daq": {"data": data}})
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["daq/data"] = data
    with h5py.File(tmp_path / "c.mat", "w", userblock_size=512) as file:
        file["daq/data"] = data.T
    with (tmp_path / "c.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file")
    clock = {"rate": float(1.0 / TIMES[1])}
    for number, (path, form) in enumerate(
        [("a.mat", "daq.data(:,{})"), ("c.mat", "daq.data(:,{})"), ("b.h5", "daq/data[:,{}]")]
    ):
        phase, one = (form.format(i) for i in ((0, 1) if "[" in form else (1, 2)))
        folder = tmp_path / str(number)
        folder.mkdir()
        file = entry(
            f"../{path}",
            time=clock,
            phase={"column": phase, "unit": "rad"},
            F_sp1_L={"column": one, "unit": "N"},
        )
        _, series = imported(write_spec(folder, file))
        assert np.array_equal(series["F_sp1_L"], force(TIMES))


def test_topics_of_a_bag_with_stamps_of_their_own(tmp_path: Path) -> None:
    """Two topics of the same stamps are one clock, a slower one is left."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    joints, number, vector, xyz = (
        store.types[f"{package}/msg/{kind}"]
        for package, kind in (
            ("sensor_msgs", "JointState"),
            ("std_msgs", "Float64"),
            ("geometry_msgs", "Vector3Stamped"),
            ("geometry_msgs", "Vector3"),
        )
    )
    header, stamp = (
        store.types[n] for n in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    start_ns = 1_700_000_000_000_000_000
    stamps = start_ns + np.round(1e9 * TIMES).astype(int)
    none = np.zeros(0)
    with Writer(tmp_path / "bag", version=9) as writer:
        topics = [
            writer.add_connection(name, kind.__msgtype__, typestore=store)
            for name, kind in (("/joints", joints), ("/phase", number), ("/slow", vector))
        ]
        for i, (ns, t) in enumerate(zip(stamps.tolist(), TIMES, strict=True)):
            head = header(stamp(ns // 10**9, ns % 10**9), "")
            said = joints(head, ["a", "b"], none, none, np.array([1.0, force(t)]))
            late = ns + 7_000_000  # recorded later than it was measured
            writer.write(topics[0], late, store.serialize_cdr(said, joints.__msgtype__))
            text = store.serialize_cdr(number(OMEGA * t), number.__msgtype__)
            writer.write(topics[1], ns, text)
            if i % 8 == 0:
                torque = store.serialize_cdr(vector(head, xyz(0.0, 0.0, t)), vector.__msgtype__)
                writer.write(topics[2], ns, torque)
    file = {
        "path": "bag",
        "channels": {
            "phase": {"column": "/phase.data", "unit": "rad"},
            "F_rp2_R": {"column": "/joints.effort[1]", "unit": "N"},
            "T_in": {"column": "/slow.vector.z", "unit": "N m"},
        },
    }
    run, series = imported(write_spec(tmp_path, file))
    assert np.array_equal(series["F_rp2_R"], force(TIMES))
    assert series.times == pytest.approx(TIMES, abs=2e-9)
    left = dict(run.left)
    assert "clock of its own" in left["T_in"]
    assert "resample" in left["T_in"]
    assert left["bag: /joints.effort[0]"] == "the spec does not name it"


def test_a_run_of_this_project_comes_in_again(example: Path, tmp_path: Path) -> None:
    path = example / "simulated" / "run_00"
    file = entry(
        str(path),
        time={"column": "/bench/samples.t"},
        phase={"column": "/bench/samples.phase", "unit": "rad"},
    )
    file["channels"]["F_*"] = {"column": "/bench/samples.F_*", "unit": "N"}
    _, series = imported(write_spec(tmp_path, file))
    was = read_recording(path).samples
    assert len(series.names) == 14
    assert all(np.array_equal(series[name], was[name]) for name in series.names)


def test_a_table_with_words_of_another_code_page(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", t=TIMES, phase=OMEGA * TIMES, force=force(TIMES))
    text = (tmp_path / "a.csv").read_text(encoding="utf-8")
    named = "Prüfstand 3\n" + text.replace("force", "Stoß", 1)
    (tmp_path / "a.csv").write_bytes(named.encode("cp1252"))
    file = entry("a.csv", phase=PHASE, F_sp1_L={"column": "Stoß", "unit": "N"})
    options = {"encoding": "cp1252", "skip": 1}
    _, series = imported(write_spec(tmp_path, file | {"options": options}))
    assert np.array_equal(series["F_sp1_L"], force(TIMES))


def test_the_spec_of_the_docs_is_one(tmp_path: Path) -> None:
    """Its files for each run, made as it says: titles, units, decimal commas, a torque meter."""
    tdms = pytest.importorskip("nptdms")
    root = Path(__file__).resolve().parents[2]
    text = (root / "docs" / "importing.md").read_text(encoding="utf-8")
    spec = tmp_path / "spec.yaml"
    spec.write_text(text.split("```yaml\n")[1].split("```")[0], encoding="utf-8")
    (tmp_path / "rig.yaml").write_bytes((root / "config" / "rig.yaml").read_bytes())
    columns = {
        "Zeit": 1e3 * TIMES,
        "mesh phase": np.degrees(OMEGA * TIMES),
        "gauge 4": 0.1 + TIMES,
    }
    columns |= {f"x {mesh}": 35.0 * np.sin(OMEGA * TIMES) for mesh in MODEL.layout.meshes}
    rows = [";".join(map(repr, row)) for row in np.column_stack([*columns.values()]).tolist()]
    lines = ["DAQ", "today", ";".join(columns), ";".join("-" * len(columns)), *rows]
    torque = tdms.ChannelObject("meter", "torque", np.full(60, 218.0))
    for name in ("run_00", "run_05"):
        table = "\n".join(lines).replace(".", ",")
        (tmp_path / f"{name}_daq.csv").write_text(table, encoding="utf-8")
        with tdms.TdmsWriter(tmp_path / f"{name}_torque.tdms") as writer:
            writer.write_segment([torque])
    import_campaign(read_spec(spec), tmp_path / "out")
    series = read_recording(tmp_path / "out" / "run_00").samples
    assert series["F_rp1_L"] == pytest.approx(12.0 - 1.02 * 1e3 * (0.1 + TIMES), rel=1e-12)
    assert series["x_rp3_R"] == pytest.approx(35e-6 * np.sin(OMEGA * TIMES), rel=1e-12)
    assert series["T_in"] == pytest.approx(np.full(len(series), 218.0))


def test_bodies_that_turn_steadily_displace_no_mesh() -> None:
    """All of their encoders grow, the planets' too, although these turn against the sun."""
    p, s = MODEL.parameters, MODEL.scales
    turns = {"s": (p.z_s + p.z_r) / p.z_s, "c": 1.0, "p": p.z_r / p.z_p - 1.0}
    u = [turns[body[0]] * s.base_radius(body) for body in MODEL.layout.bodies]
    assert bodies_to_coordinates(MODEL) @ u == pytest.approx(0.0, abs=1e-12)


def test_raw_angles_become_rotations_and_the_phase(tmp_path: Path) -> None:
    """A carrier that vibrates about a steady rotation, its encoder starting anew each turn."""
    p, s = MODEL.parameters, MODEL.scales
    speed, wobble = OMEGA / p.z_r, 2e-5 * np.sin(0.5 * OMEGA * TIMES)
    turned = 6.2 + speed * TIMES + wobble / s.r_bc
    write_csv(tmp_path / "a.csv", t=TIMES, angle=np.degrees(turned % (2.0 * np.pi)))
    file = entry("a.csv", angle_c={"column": "angle", "unit": "deg"})
    spec = write_spec(tmp_path, file, phase={"angle": "angle_c", "offset": "0.5 rad"})
    _, series = imported(spec)
    assert "angle_c" not in series
    expected = wobble - np.polyval(np.polyfit(TIMES, wobble, 1), TIMES)
    assert series["u_c"] == pytest.approx(expected, abs=1e-9 * s.r_bc)
    slope = np.polyfit(TIMES, series["phase"], 1)[0]
    assert slope == pytest.approx(p.z_r * speed, rel=1e-3)  # the vibration is not whole cycles
    assert series["phase"][0] == pytest.approx(0.5 + p.z_r * 6.2, abs=0.05)


def test_the_sun_turns_less_often_a_mesh_cycle(tmp_path: Path) -> None:
    """With the ring at rest z_r w_c = z_s (w_s - w_c) is the mesh frequency."""
    p = MODEL.parameters
    w_s = OMEGA / p.z_r + OMEGA / p.z_s
    write_csv(tmp_path / "a.csv", t=TIMES, angle=w_s * TIMES)
    file = entry("a.csv", angle_s_L={"column": "angle", "unit": "rad"})
    _, series = imported(write_spec(tmp_path, file, phase={"angle": "angle_s_L"}))
    assert series["phase"] == pytest.approx(OMEGA * TIMES, rel=1e-9, abs=1e-9)


def two_files(folder: Path, later: Array, **more: Any) -> Path:
    """Phase in one file, a force in another with samples at other times [s] of its own clock."""
    write_csv(folder / "a.csv", t=TIMES, phase=OMEGA * TIMES)
    write_csv(folder / "b.csv", t=later, force=force(later))
    one = entry("b.csv", F_sp1_L={"column": "force", "unit": "N"})
    return write_spec(folder, entry("a.csv", phase=PHASE), one | more)


def test_files_of_one_clock_are_cut_to_the_time_that_both_have(tmp_path: Path) -> None:
    run, series = imported(two_files(tmp_path, TIMES[40:]))
    assert np.array_equal(series["F_sp1_L"], force(TIMES[40:]))
    assert series["phase"][0] == OMEGA * TIMES[40]
    assert series.times[0] == 0.0
    assert any("40 samples of a.csv" in text for text in run.remarks)


def test_a_trigger_that_came_later_is_put_right(tmp_path: Path) -> None:
    late = float(TIMES[40])
    clock = {"column": "t", "unit": "s", "trigger_offset": f"{1e6 * late!r} us"}
    _, series = imported(two_files(tmp_path, TIMES, time=clock))
    assert series["phase"][0] == OMEGA * TIMES[40]
    assert np.array_equal(series["F_sp1_L"], force(TIMES[:-40]))


@pytest.mark.parametrize("later", [TIMES[::8], TIMES[:-1] + 0.3 * TIMES[1]], ids=["rate", "apart"])
def test_another_clock_is_left_unless_it_is_asked_for(tmp_path: Path, later: Array) -> None:
    run, series = imported(two_files(tmp_path, later))
    assert "F_sp1_L" not in series
    assert "clock of its own" in dict(run.left)["F_sp1_L"]
    (tmp_path / "again").mkdir()
    run, series = imported(two_files(tmp_path / "again", later, resample=True))
    rows = (later[0] <= TIMES) & (later[-1] >= TIMES)
    assert series["F_sp1_L"] == pytest.approx(np.interp(TIMES[rows], later, force(later)))
    assert any("straight lines" in text for text in run.remarks)


def test_what_the_data_sheet_does_not_expect_is_told_and_taken(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", t=TIMES, phase=1.2 * OMEGA * TIMES, force=1e-3 * force(TIMES))
    file = entry("a.csv", phase=PHASE, F_sp1_L={"column": "force", "unit": "N"})
    run, series = imported(write_spec(tmp_path, file))
    assert "F_sp1_L" in series
    speed, size = run.remarks
    assert "Omega" in speed
    assert "F_sp1_L should be about" in size
    (tmp_path / "right").mkdir()
    write_csv(tmp_path / "right" / "a.csv", t=TIMES, phase=OMEGA * TIMES, force=force(TIMES))
    run, _ = imported(write_spec(tmp_path / "right", file))
    assert run.remarks == ()


def test_the_command_prints_what_it_took_and_left_and_shows_it(
    example: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "deep" / "out"
    assert main(["campaign", "import", str(example / "spec.yaml"), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert all(f"run_{i:02d}  " in said for i in range(7))
    assert "taken F" in said
    assert "brought to" in said
    page = (out / "import.html").read_text(encoding="utf-8")
    assert page.count("<img ") == 7
    assert "bench_v73.mat: F.sp1_L [kN]" in page
    assert "http" not in page
    assert main(["campaign", "import", str(example / "spec.yaml"), "--out", str(out)]) == 2
    assert "never overwrites" in capsys.readouterr().err


def test_the_packages_of_files_are_loaded_where_they_are_needed() -> None:
    code = (
        "import sys; from herringbone_sim.__main__ import VERBS\n"
        "from herringbone_sim.cli.arguments import help_of\n"
        "for verb in VERBS: help_of(verb)\n"
        "print([n for n in ('pint', 'h5py', 'nptdms', 'rosbags') if n in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("module", "kind", "pip_name"),
    [
        ("nptdms", "tdms", "npTDMS"),
        ("h5py", "hdf5", "h5py"),
        ("rosbags.highlevel", "rosbag2", "rosbags"),
    ],
)
def test_a_package_that_lacks_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, kind: str, pip_name: str
) -> None:
    (tmp_path / "a.file").write_bytes(b"")
    monkeypatch.setitem(sys.modules, module, None)
    spec = write_spec(tmp_path, entry("a.file", phase=PHASE) | {"kind": kind})
    with pytest.raises(RecordingError, match=f"pip install {pip_name}"):
        import_campaign(read_spec(spec), tmp_path / "out")
