"""``sweep`` from the command line: folders, tables, a diagram."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from sweep_support import ROOT

from herringbone_sim.__main__ import main
from herringbone_sim.cli.sweep_options import SweepOptions, observation_of_gear
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.sweeps.grid import Axis
from herringbone_sim.sweeps.store import load_store

SHORT = ["--transient=5", "--cycles=5", "--workers=1"]
PAPER = f"--parameters={ROOT / 'config/paper.yaml'}"


def test_every_way_is_kept_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["sweep", PAPER, "--over=K=0:0.4:5", "--start=all", *SHORT, "--out", str(tmp_path)]
    assert main(command) == 0
    told = capsys.readouterr().out
    assert "fixed: 5 values" in told
    assert "different motions by different ways" in told
    for way in ("fixed", "up", "down", "ramp_up", "ramp_down"):
        assert load_store(tmp_path / way).missing() == []
    assert (tmp_path / "bifurcation.png").stat().st_size > 10_000
    assert (tmp_path / "bifurcation.svg").exists()


def test_a_way_that_is_added_joins_the_diagram(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        "sweep",
        PAPER,
        "--over=K=0:0.4:5",
        *SHORT,
        "--no-exponents",
        "--out",
        str(tmp_path),
    ]
    assert main(command) == 0
    assert "different motions" not in capsys.readouterr().out
    assert main([*command, "--start=down"]) == 0
    assert "different motions" in capsys.readouterr().out


def test_the_steps_are_those_of_a_sweep_unless_set(tmp_path: Path) -> None:
    common = ["sweep", PAPER, "--over=K=0,0.1", *SHORT, "--no-exponents", "--out"]
    assert main([*common, str(tmp_path / "a")]) == 0
    assert main([*common, str(tmp_path / "b"), "--set=steps_per_cycle=20"]) == 0
    a, b = (load_store(tmp_path / name / "fixed").sweep.base for name in "ab")
    assert (a.order, a.steps_per_cycle, a.samples_per_cycle) == (14, 8, 1)
    assert (b.order, b.steps_per_cycle, b.samples_per_cycle) == (14, 20, 1)


def test_a_grid_needs_no_diagram(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    over = ["--over=K=0,0.1", "--over=xi=0.07,0.1", "--over=delta_T=80,90,300"]
    assert main(["sweep", PAPER, *over, *SHORT, "--out", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "12 values" in told
    assert (
        "4 failed at K = 0 to 0.1, xi = 0.07 to 0.1, delta_T = 300: delta_T = 300 K leaves" in told
    )


@pytest.mark.parametrize(
    "wrong", ["--over=K=0:1", "--over=beta_x=0:1:3", "--mesh=sun", "--workers=0", "--workers=-2"]
)
def test_wrong_input_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], wrong: str
) -> None:
    assert main(["sweep", PAPER, "--over=K=0:1:3", *SHORT, wrong, "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("error: ") == 1


def test_another_sweep_in_the_folder_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["sweep", PAPER, "--over=K=0,0.1", *SHORT, "--out", str(tmp_path)]
    assert main(command) == 0
    assert main([*command, "--set=xi=0.1"]) == 2
    assert "holds another sweep (xi: 0.07, 0.1)" in capsys.readouterr().err


def test_few_cycles_are_told_as_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A plain gear has no forcing beside the mesh; a control of order 0.25 repeats after four."""
    common = ["sweep", PAPER, "--over=delta_T=85", "--transient=5", "--cycles=1", "--workers=1"]
    assert main([*common, "--out", str(tmp_path / "a")]) == 0
    assert "\n1 mesh cycles are observed: no period is told" in f"\n{capsys.readouterr().out}"
    steered = [*common, "--set=K=0.1", "--set=control_order=0.25"]
    assert main([*steered, "--out", str(tmp_path / "b")]) == 0
    assert "the forcing repeats after 4 mesh cycles, and 1" in capsys.readouterr().out


def swept(out: Path, start: str) -> None:
    words = f"--over delta_T=10:30:3 --start {start} --transient 5 --cycles 40 --no-exponents"
    assert main(["sweep", *words.split(), "--out", str(out)]) == 0


def test_ramps_are_not_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    swept(tmp_path, "ramp")
    assert "different motions" not in capsys.readouterr().out


def test_ways_of_two_versions_are_drawn_together_and_what_cannot_be_read_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    swept(tmp_path, "up")
    file = tmp_path / "up" / "sweep.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"kernel": "earlier"}))
    (tmp_path / "fixed").mkdir()
    (tmp_path / "fixed" / "sweep.json").write_text("{")
    capsys.readouterr()
    swept(tmp_path, "both")
    assert "different motions" in capsys.readouterr().out


@pytest.mark.parametrize("verb", ["basins", "exponents"])
def test_what_needs_tangents_is_refused_before_it_computes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    assert main([verb, "--set", "method=rk4", "--out", str(tmp_path / "out")]) == 2
    assert "tangents need method: taylor" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_forcing_is_that_of_the_last_values_if_the_first_give_no_gear() -> None:
    gear = Parameters(K=0.3, control_order=1 / 32, delta_T=100.0)
    for low in (0.55, 0.4):  # the lower backlash leaves no gear at 100 K
        look = observation_of_gear(SweepOptions(), (gear, ()), (Axis("b", (low, 0.6)),), "sp_L")
        assert look.cycles == 320


@pytest.mark.parametrize(
    "verb",
    [
        ["sweep", PAPER, "--over=K=0:1:3"],
        ["map", PAPER, "--over=K=0:1:3", "--over=delta_T=0:1:3"],
        ["compare", "config/paper.yaml", "config/rig.yaml", "--over=K=0:1:3"],
    ],
)
def test_a_change_of_what_is_varied_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: list[str]
) -> None:
    assert main([*verb, "--set", "K=0.3", "--out", str(tmp_path / "out")]) == 2
    assert "--set K=0.3 has no effect, as K is varied" in capsys.readouterr().err
    assert main([*verb, "--set", "K=abc", "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("error: ") == 1
