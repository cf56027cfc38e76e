"""The command line as a newcomer meets it."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml

from herringbone_sim.__main__ import executable, main
from herringbone_sim.cli import demo
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import names
from herringbone_sim.errors import HerringboneError
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.recording.writer import RunWriter
from herringbone_sim.version import VERSION


def test_parameters_lists_each_with_unit_and_equation(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["parameters"]) == 0
    shown = capsys.readouterr().out
    assert all(f" {name} " in shown for name in names())
    assert "temperature rise, Eq. (2)" in shown


def test_wrong_input_gives_one_line_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for verb in ("info", "recover"):
        assert main([verb, str(tmp_path / "nothing")]) == 2
    assert main(["replay", str(tmp_path / "nothing"), "--verify"]) == 2
    told = capsys.readouterr().err
    assert told.count("error: ") == 3
    assert "nothing" in told


@pytest.mark.parametrize(
    ("argv", "named"),
    [
        (["info", "FILE", "--no-such"], "--no-such"),
        (["info", "FILE", "--ros-args", "-p", "K:=1"], "--ros-args -p K:=1"),
        (["run", "-p", "delta_T:=5"], "-p delta_T:=5"),
        (["run", "--ros-args", "-p", "K:=1.0", "--", "fast"], "fast"),
    ],
)
def test_unknown_arguments_are_refused_in_one_line(
    capsys: pytest.CaptureFixture[str], argv: list[str], named: str
) -> None:
    assert main(argv) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert f"unknown arguments {named}: " in said


def test_the_executable_of_ros_is_the_verb_run(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = []
    for ask in (lambda: main(["run", "--help"]), executable):
        monkeypatch.setattr("sys.argv", ["/install/lib/herringbone_sim/simulator", "--help"])
        assert ask() == 0
        shown.append(capsys.readouterr().out)
    assert shown[0] == shown[1]
    assert "--ros-args" in shown[0]
    monkeypatch.setattr("sys.argv", ["simulator", "-p", "delta_T:=5"])
    assert executable() == 2
    assert "what is for ROS follows --ros-args" in capsys.readouterr().err
    monkeypatch.setattr("sys.argv", ["simulator", "--version"])
    assert executable() == 0
    assert capsys.readouterr().out.strip() == VERSION
    monkeypatch.setattr("sys.argv", ["info", "no/such"])
    assert executable() == 2


def test_analysis_and_replay_need_no_ros(tmp_path: Path) -> None:
    """With rclpy out of reach every verb but run, demo and replay --publish still loads."""
    code = (
        "import sys; sys.modules['rclpy'] = None\n"
        "from herringbone_sim.__main__ import main\n"
        "sys.exit(main(['replay', '--verify', sys.argv[1]]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "error: " in done.stderr
    assert "Traceback" not in done.stderr


def test_run_without_ros_says_how_to_get_it() -> None:
    code = (
        "import sys; sys.modules['rclpy'] = None\n"
        "from herringbone_sim.__main__ import main\n"
        "sys.exit(main(['run']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "pip install" in done.stdout


def test_publishing_without_ros_says_how_to_get_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = _short_run(tmp_path)
    monkeypatch.setitem(sys.modules, "herringbone_sim.ros.replay", None)
    assert main(["replay", str(run), "--publish"]) == 2
    assert "no ROS 2 here" in capsys.readouterr().out


def _short_run(folder: Path) -> Path:
    writer = RunWriter.create(folder, "run", "/sim", {}, ("t", "x_sp_L"), 0)
    writer.write_samples(np.array([[0.0, 1.0], [1.0, 2.0]]))
    writer.close()
    return writer.path


@pytest.mark.parametrize("speed", ["0", "-1", "nan", "inf"])
def test_a_speed_that_plays_nothing_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], speed: str
) -> None:
    run = _short_run(tmp_path)
    assert main(["replay", str(run), "--publish", f"--speed={speed}"]) == 2
    assert "speed must be finite and positive" in capsys.readouterr().err


@pytest.mark.parametrize("file", ["rig.yaml", "paper.yaml"])
def test_a_file_that_is_checked_tells_what_no_gear_could_be(
    capsys: pytest.CaptureFixture[str], file: str
) -> None:
    path = Path(__file__).resolve().parents[2] / "config" / file
    assert main(["parameters", "--check", str(path)]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith(f"{path}: ")
    scales = build(load_parameters(path)).scales
    assert (
        f"\nomega_n {scales.omega_n:.6g} rad/s; base radii r_bs {scales.r_bs:.6g}, " in printed.out
    )
    assert printed.out.count("no such gear can be assembled") == 1
    assert printed.err == ""


def test_a_file_that_is_checked_may_be_wrong_or_sound(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = tmp_path / "good.yaml", tmp_path / "bad.yaml"
    head = "/**:\n  ros__parameters:\n"
    good.write_text(f"{head}    n_planets: 4\n    effects: 'runout@sp:amplitude=2e-5'\n")
    bad.write_text(f"{head}    delta_T: 900.0\n")
    assert main(["parameters", "--check", str(good)]) == 0
    printed = capsys.readouterr().out
    assert "4 planets" in printed
    assert "runout" in printed
    assert "assembled" not in printed
    assert main(["parameters", "--check", str(bad)]) == 2
    assert str(bad) in capsys.readouterr().err


def test_a_file_that_is_checked_is_told_what_the_node_tells(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "dump.yaml"
    file.write_text(
        "/herringbone_sim:\n  ros__parameters:\n    mirror: off\n    record_name: 'one'\n"
        "    step_cycles: 3\n    planet_angle: []\n    use_sim_time: true\n    xi: 1e-1\n"
        "    qos_overrides: {/parameter_events: {publisher: {depth: 1000}}}\n"
        "    recrod: true\n    k_amp: []\n"
    )
    assert main(["parameters", "--check", str(file)]) == 0
    notes = [line for line in capsys.readouterr().out.splitlines() if line.startswith("note: ")]
    assert "no parameter recrod: did you mean record?; it is ignored" in notes[0]
    assert "k_amp is empty and has its default" in notes[1]
    assert "assembled" in notes[2]
    file.write_text("/**:\n  ros__parameters:\n    record_name: 7\n")
    assert main(["parameters", "--check", str(file)]) == 2
    assert f"{file}: record_name must be a text, got 7: put it in" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("real_time_factor: [1.0, 2.0]", "must be float, got [1.0, 2.0]: give one number"),
        ("real_time_factor: fast", "must be float, got 'fast': give one number"),
        ("step_cycles: [1]", "must be int, got [1]: give a whole number"),
        ("step_cycles: 1.5", "must be int, got 1.5: give a whole number"),
        ("record: 1", "must be bool, got 1: give true or false"),
    ],
)
def test_a_value_of_another_type_is_refused_as_by_the_node(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, rule: str
) -> None:
    file = tmp_path / "node.yaml"
    file.write_text(f"/**:\n  ros__parameters:\n    {text}\n")
    assert main(["parameters", "--check", str(file)]) == 2
    name = text.split(":")[0]
    assert f"error: {file}: {name} {rule}" in capsys.readouterr().err


def test_a_rig_that_is_made_tells_it_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "rigs" / "one"
    argv = ["rig", "make", "--out", str(out), "--runs", "2", "--held-out", "1", "--cycles", "40"]
    assert main(argv) == 0
    printed = capsys.readouterr()
    assert (printed.out + printed.err).count("no such gear can be assembled") == 1


def test_a_command_does_not_judge_the_gear_and_leaves_the_filters_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Sets are built at the door, and again from each folder of a sweep; runs are on threads."""
    before = warnings.showwarning, list(warnings.filters)
    short = ["--transient", "10", "--cycles", "10", "--no-exponents", "--chunk", "2"]
    argv = ["sweep", "--over", "delta_T=20:60:6", "--start", "both", "--workers", "2", *short]
    assert main([*argv, "--out", str(tmp_path)]) == 0
    assert "no such gear" not in capsys.readouterr().err
    assert (warnings.showwarning, list(warnings.filters)) == before
    assert main([*argv, "--out", str(tmp_path)]) == 0
    assert "no such gear" not in capsys.readouterr().err


def test_a_reader_that_leaves_ends_a_command_quietly() -> None:
    gone, output = os.pipe()
    os.close(gone)
    done = subprocess.run(
        [sys.executable, "-m", "herringbone_sim", "parameters"],
        stdout=output,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    os.close(output)
    assert (done.returncode, done.stderr) == (1, "")


def test_output_that_does_not_fit_gives_one_line() -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "herringbone_sim", "parameters"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    (said,) = done.stderr.splitlines()
    assert done.returncode == 2
    assert said.startswith("error: the output can't be used: No space left")


@pytest.mark.parametrize(
    "words", [["--loop"], ["--start", "0.01"], ["--speed=2"], ["--clock"], ["--node-name=other"]]
)
def test_options_of_a_sending_are_refused_with_verify(
    capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    assert main(["replay", "RUN", "--verify", *words]) == 2
    told = capsys.readouterr().err
    assert f"error: {words[0].split('=')[0]} must come with --publish" in told


def test_survival_by_a_method_without_tangents_is_refused_before_it_computes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = ["--over", "delta_T", "--from", "60", "--to", "90", "--values", "2"]
    assert main(["survival", *values, "--set", "method=rk4", "--out", str(tmp_path)]) == 2
    assert "tangents need" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_node_of_the_demo_records_where_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """ROS reads values as YAML, in which ` #` begins a comment."""

    def start(words: list[str]) -> None:
        raise HerringboneError(*words)

    monkeypatch.setattr(subprocess, "Popen", start)
    place = tmp_path / "a #1 b: Prüfstand \N{GEAR}" / "demo"
    with pytest.raises(HerringboneError) as node:
        demo.experiment(tmp_path, place)
    given = dict(word.split(":=", 1) for word in node.value.args if ":=" in word)
    assert yaml.safe_load(given["record_dir"]) == str(place.parent)
