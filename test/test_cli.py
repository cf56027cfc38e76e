"""The command line as a newcomer meets it."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from herringbone_sim.__main__ import VERBS, main
from herringbone_sim.core.parameters import names
from herringbone_sim.recording.writer import RunWriter


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([verb, "--help"])
    assert ended.value.code == 0
    assert len(capsys.readouterr().out) > 150


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


def test_unknown_arguments_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["info", str(tmp_path), "--no-such"])
    assert ended.value.code == 2


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


@pytest.mark.parametrize("speed", ["0", "-1", "nan", "inf"])
def test_a_speed_that_plays_nothing_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], speed: str
) -> None:
    writer = RunWriter.create(tmp_path, "run", "/sim", {}, ("t", "x_sp_L"), 0)
    writer.write_samples(np.array([[0.0, 1.0], [1.0, 2.0]]))
    writer.close()
    assert main(["replay", str(writer.path), "--publish", f"--speed={speed}"]) == 2
    assert "speed must be finite and positive" in capsys.readouterr().err


def test_a_command_warns_once_and_leaves_the_filters_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Sets are built at the door, and again from each folder of a sweep; runs are on threads."""
    before = warnings.showwarning, list(warnings.filters)
    short = ["--transient", "10", "--cycles", "10", "--no-exponents", "--chunk", "2"]
    argv = ["sweep", "--over", "delta_T=20:60:6", "--start", "both", "--workers", "2", *short]
    assert main([*argv, "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().err.count("warning: no such gear") == 1
    assert (warnings.showwarning, list(warnings.filters)) == before
    assert main([*argv, "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().err.count("warning: no such gear") == 1
