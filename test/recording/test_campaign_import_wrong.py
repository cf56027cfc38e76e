"""A wrong spec, or files that hold something else: one clear error, and nothing left behind."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from herringbone_sim.__main__ import main
from herringbone_sim.recording.importing import campaign

Spec = dict[str, Any]
SPEC: Spec = {
    "rig": "bench",
    "files": [
        {
            "path": "{run}.csv",
            "time": {"column": "t", "unit": "s"},
            "channels": {
                "phase": {"column": "phase", "unit": "rad"},
                "F_sp1_L": {"column": "force", "unit": "N"},
            },
        }
    ],
    "runs": [
        {"name": n, "role": "fit", "delta_T": 20.0, "K": 0.0, "T_1": 220.0, "Omega": 1.0}
        for n in ("run_00", "run_01")
    ],
}


def change(*path: Any, to: Any) -> Callable[[Spec], None]:
    def apply(spec: Spec) -> None:
        at: Any = spec
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = to

    return apply


def without(*path: Any) -> Callable[[Spec], None]:
    def apply(spec: Spec) -> None:
        at: Any = spec
        for key in path[:-1]:
            at = at[key]
        del at[path[-1]]

    return apply


FILE = ("files", 0)
FORCE = (*FILE, "channels", "F_sp1_L")
WRONG: dict[str, tuple[Callable[[Spec], None], tuple[str, ...]]] = {
    "no rig": (without("rig"), ("rig", "missing")),
    "a rig with a long name": (
        change("rig", to=256 * "r"),
        ("rig must be a text of at most 255 characters, got 'rrr", "mend the spec"),
    ),
    "an unknown key": (change("rigs", to="a"), ("rigs", "did you mean rig?")),
    "no runs": (change("runs", to=[]), ("runs must be a list",)),
    "a run is a text": (change("runs", 0, to="run_00"), ("runs[0]", "'run_00'")),
    "no role": (without("runs", 0, "role"), ("runs[0].role", "fit, held_out")),
    "a role": (change("runs", 1, "role", to="test"), ("runs[1].role", "'test'")),
    "a name that leads out": (change("runs", 0, "name", to="../a"), ("runs[0].name", "'../a'")),
    "a name twice": (change("runs", 1, "name", to="run_00"), ("names of their own", "run_00")),
    "a torque in watts": (change("runs", 0, "T_1", to="3 W"), ("runs[0].T_1", "N m", "3 W")),
    "a temperature": (change("runs", 0, "delta_T", to="20 degC"), ("delta_degC",)),
    "no speed": (without("runs", 0, "Omega"), ("runs[0].Omega", "missing")),
    "a truth value": (change("runs", 0, "K", to=True), ("runs[0].K", "True")),
    "no such file": (change(*FILE, "path", to="no.csv"), ("files[0].path", "no.csv")),
    "a kind": (change(*FILE, "kind", to="xls"), ("files[0].kind", "'xls'", "parquet")),
    "no time": (without(*FILE, "time"), ("files[0].time", "a column or a rate")),
    "two times": (change(*FILE, "time", "rate", to=1e5), ("files[0].time", "one of them")),
    "a rate in metres": (change(*FILE, "time", to={"rate": "2 m"}), ("time.rate", "2 m")),
    "a rate of zero": (change(*FILE, "time", to={"rate": 0}), ("time.rate", "above 0")),
    "a time in newtons": (change(*FILE, "time", "unit", to="N"), ("time.unit", "'N'")),
    "a channel": (change(*FILE, "channels", "F_sp9_L", to={}), ("F_sp9_L", "did you mean")),
    "a star for nothing": (change(*FILE, "channels", "q_*", to={"column": "*"}), ("'q_*'",)),
    "no channels": (change(*FILE, "channels", to={}), ("files[0].channels",)),
    "no column": (without(*FORCE, "column"), ("F_sp1_L.column", "missing")),
    "no unit": (without(*FORCE, "unit"), ("F_sp1_L.unit", "missing")),
    "a unit of length": (change(*FORCE, "unit", to="mm"), ("F_sp1_L.unit", "a unit of N", "'mm'")),
    "a unit of nobody": (change(*FORCE, "unit", to="foo"), ("F_sp1_L.unit", "'foo'")),
    "half a unit": (change(*FORCE, "unit", to="N/("), ("F_sp1_L.unit", "'N/('")),
    "a sign": (change(*FORCE, "sign", to=2), ("F_sp1_L.sign", "1, -1")),
    "a scale of zero": (change(*FORCE, "scale", to=0), ("F_sp1_L.scale", "not 0")),
    "a scale with a unit": (change(*FORCE, "scale", to="2 N"), ("F_sp1_L.scale", "2 N")),
    "an offset": (change(*FORCE, "offset", to="a lot"), ("F_sp1_L.offset", "a lot")),
    "no number": (change(*FORCE, "offset", to=float("nan")), ("F_sp1_L.offset", "nan")),
    "no phase": (without(*FILE, "channels", "phase"), ("run_00", "phase", "angle_c")),
    "no shaft": (change("phase", to={"angle": "angle_c"}), ("run_00", "angle_c")),
    "a planet for a shaft": (change("phase", to={"angle": "angle_p1_L"}), ("phase.angle",)),
    "an option": (change(*FILE, "options", to={"decimal": ",,"}), ("options.decimal", "',,'")),
    "a channel twice": (
        lambda s: s["files"].append(copy.deepcopy(s["files"][0])),
        ("run_00", "each channel once", "F_sp1_L twice"),
    ),
    "an angle beside its rotation": (
        lambda s: s["files"][0]["channels"].update(
            {n: {"column": "phase", "unit": u} for n, u in (("angle_c", "rad"), ("u_c", "m"))}
        ),
        ("run_00", "each channel once", "u_c twice"),
    ),
    "a phase beside a shaft": (
        lambda s: (
            change("phase", to={"angle": "angle_c"})(s),
            change(*FILE, "channels", "angle_c", to={"column": "phase", "unit": "rad"})(s),
        ),
        ("run_00", "each channel once", "phase twice"),
    ),
    "a count of lines": (change(*FILE, "options", to={"skip": -1}), ("options.skip", "-1")),
    "an encoding": (change(*FILE, "options", to={"encoding": "none"}), ("run_00.csv", "none")),
    "noise of twice the signal": (
        change("noise", to={"rms_share": 2.0}),
        ("noise.rms_share of the spec", "2.0"),
    ),
    "noise as a number": (change("noise", to=5), ("noise of the spec must be", "got 5")),
    "sensors with words": (change("sensors", to={"F_sp1_L": "good"}), ("sensors", "good")),
    "sensors below no noise": (
        change("sensors", to={"F_sp1_L": {"rms": -1.0}}),
        ("sensors of the spec must be", "the rms of F_sp1_L must be above 0"),
    ),
    "no data sheet": (change("nominal", to="no.yaml"), ("no.yaml",)),
    "a column": (change(*FORCE, "column", to="kraft"), ("'kraft'", "t, phase, force, word")),
    "a column of words": (change(*FORCE, "column", to="word"), ("'word'", "numbers")),
    "another kind": (change(*FILE, "kind", to="tdms"), ("run_00.csv", "as tdms")),
    "another kind of bag": (change(*FILE, "kind", to="rosbag2"), ("run_00.csv", "as rosbag2")),
    "a clock that stands": (
        change(*FILE, "time", "column", to="still"),
        ("increase strictly", "1 s, 1 s at row 1"),
    ),
    "a clock that ends nowhere": (
        change(*FILE, "time", "column", to="endless"),
        ("increase strictly", "98 s, inf s at row 99"),
    ),
}


FILES = ["run_00.csv", "run_01.csv", "spec.yaml"]


def fill(folder: Path) -> None:
    t = np.arange(100) * 1e-5
    for name in ("run_00", "run_01"):
        ends = [*range(99), "inf"]
        rows = [
            f"{a!r},{3e4 * a!r},700.0,a,1.0,{b}" for a, b in zip(t.tolist(), ends, strict=True)
        ]
        text = "\n".join(["t,phase,force,word,still,endless", *rows])
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")


def command(folder: Path, spec: Spec) -> int:
    (folder / "spec.yaml").write_text(yaml.safe_dump(spec), encoding="utf-8")
    return main(
        ["campaign", "import", str(folder / "spec.yaml"), "--out", str(folder / "new" / "out")]
    )


def test_the_spec_that_the_wrong_ones_are_made_of_is_right(tmp_path: Path) -> None:
    fill(tmp_path)
    assert command(tmp_path, SPEC) == 0


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_spec_is_one_error_and_leaves_nothing(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(tmp_path)
    spec = copy.deepcopy(SPEC)
    wrong, words = WRONG[case]
    wrong(spec)
    assert command(tmp_path, spec) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert all(word in line for word in words), line
    assert sorted(path.name for path in tmp_path.iterdir()) == FILES


@pytest.mark.parametrize("case", [case for case in WRONG if case.startswith(("noise", "sensors"))])
def test_noise_and_sensors_are_checked_before_a_run_is_read(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fill(tmp_path)
    spec = copy.deepcopy(SPEC)
    WRONG[case][0](spec)
    monkeypatch.setattr(campaign, "read_columns", lambda *_: pytest.fail("a run was read"))
    assert command(tmp_path, spec) == 2


def test_an_import_that_was_killed_does_not_stand_in_the_way(tmp_path: Path) -> None:
    fill(tmp_path)
    (tmp_path / ".out.part" / "run_00").mkdir(parents=True)
    assert command(tmp_path, SPEC) == 0
    assert not (tmp_path / ".out.part").exists()


def test_the_second_of_two_runs_that_is_wrong_takes_the_first_along(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(tmp_path)
    (tmp_path / "run_01.csv").write_text("t,phase\n0.0,1.0\n", encoding="utf-8")
    assert command(tmp_path, SPEC) == 2
    assert "run_01: " in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == FILES


def test_files_that_never_overlap_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(tmp_path)
    spec = copy.deepcopy(SPEC)
    other = copy.deepcopy(spec["files"][0])
    del other["channels"]["phase"], spec["files"][0]["channels"]["F_sp1_L"]
    other |= {"resample": True}
    other["time"] |= {"trigger_offset": "1 s"}
    spec["files"].append(other)
    assert command(tmp_path, spec) == 2
    assert "overlap" in capsys.readouterr().err


def test_a_folder_with_something_in_it_stays_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(tmp_path)
    kept = tmp_path / "new" / "out" / "mine.txt"
    kept.parent.mkdir(parents=True)
    kept.write_text("mine")
    assert command(tmp_path, SPEC) == 2
    assert "never overwrites" in capsys.readouterr().err
    assert [*kept.parent.iterdir()] == [kept]
