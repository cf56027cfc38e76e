"""``reproduce`` as its user meets it: files, page, table, and going on after a kill."""

from __future__ import annotations

import csv
import html
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from gears import PAPER

from herringbone_sim.__main__ import main
from herringbone_sim.cli import reproduce
from herringbone_sim.core.model import build, initial_state
from herringbone_sim.paper.reproduction import Point
from herringbone_sim.paper.statements import MotionAt, statements
from herringbone_sim.recording.parameter_file import load_parameters

QUICK = ("--values", "24", "--only", "A", "--compared", "4")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduction")
    assert main(["reproduce", "--out", str(out), *QUICK]) == 0
    return out


def rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_table_has_every_statement_of_the_scenario(made):
    table = rows(made / "statements.csv")
    assert list(table[0]) == ["scenario", "statement", "published", "obtained", "error", "ok"]
    assert [row["statement"] for row in table] == [one.text for one in statements("A")]
    assert {row["ok"] for row in table} <= {"True", "False"}
    by_text = {row["statement"]: row for row in table}
    assert by_text["Fig. 9: delta_T = 85 is P1"]["ok"] == "True"
    assert by_text["Fig. 6: delta_T = 20 is chaos"]["obtained"].startswith("chaos, exponent +")
    edge = by_text["P2 to P1 along delta_T"]
    obtained = float(edge["obtained"].split()[0])
    assert float(edge["error"]) == pytest.approx(obtained - 80.0, abs=0.01)


def test_dependence_names_every_start_and_step(made):
    table = rows(made / "dependence.csv")
    ways = {row["way"] for row in table}
    assert {"zero start", "continued upwards", "continued downwards", "RK4, 800 steps"} <= ways
    assert sum(way.startswith("asymmetric") for way in ways) == 3
    assert len(table) == 3 * len(ways)


def test_page_shows_the_figures_that_are_there(made):
    page = (made / "index.html").read_text(encoding="utf-8")
    shown = re.findall(r'<img alt="[^"]*" src="([^"]+)"', page)
    assert set(shown) == {
        *(f"figures/fig{n:02d}.png" for n in range(5, 10)),
        "figures/starts_A.png",
    }
    assert all((made / name).stat().st_size > 10_000 for name in shown)
    assert all(html.escape(one.text) in page for one in statements("A"))
    assert "http" not in page


def test_second_run_changes_nothing_and_integrates_nothing(made):
    files = {path: path.stat().st_mtime_ns for path in (made / "data").iterdir()}
    table = (made / "statements.csv").read_text(encoding="utf-8")
    assert main(["reproduce", "--out", str(made), *QUICK]) == 0
    assert {path: path.stat().st_mtime_ns for path in (made / "data").iterdir()} == files
    assert (made / "statements.csv").read_text(encoding="utf-8") == table


def test_killed_run_goes_on_where_it_stopped(tmp_path):
    command = [sys.executable, "-m", "herringbone_sim", "reproduce", "--out", str(tmp_path)]
    options = ["--only", "D", "--values", "96", "--compared", "0", "--workers", "1"]
    root = str(Path(__file__).resolve().parents[2])
    environment = {**os.environ, "PYTHONPATH": root}
    running = subprocess.Popen([*command, *options], env=environment, stderr=subprocess.DEVNULL)
    data = tmp_path / "data"
    while running.poll() is None and not list(data.glob("*.npz")):
        time.sleep(0.01)
    running.send_signal(signal.SIGKILL)
    running.wait()
    kept = {path: path.stat().st_mtime_ns for path in data.glob("*.npz")}
    assert kept
    assert main(["reproduce", "--out", str(tmp_path), *options]) == 0
    assert all(path.stat().st_mtime_ns == changed for path, changed in kept.items())
    assert len(rows(tmp_path / "statements.csv")) == len(statements("D"))


def test_wrong_input_is_told_in_one_line(tmp_path, capsys):
    assert main(["reproduce", "--out", str(tmp_path), "--only", "AX"]) == 2
    (tmp_path / "file").write_text("")
    assert main(["reproduce", "--out", str(tmp_path / "file"), *QUICK]) == 2
    told = capsys.readouterr().err
    assert "must be one of A, B, C, D, E, got 'X'" in told
    assert "--out" in told


@pytest.mark.parametrize(
    "wrong",
    [
        "--values=-3",
        "--values=0",
        "--values=1",
        "--compared=1",
        "--compared=-1",
        "--only=",
        "--workers=0",
    ],
)
def test_what_makes_no_reproduction_is_told_before_anything_runs(tmp_path, capsys, wrong):
    assert main(["reproduce", "--out", str(tmp_path / "new"), *QUICK, wrong]) == 2
    assert capsys.readouterr().err.count("error: ") == 1
    assert not (tmp_path / "new").exists()


def test_two_values_make_a_reproduction(tmp_path):
    few = ["--only", "A", "--values", "2", "--compared", "2"]
    assert main(["reproduce", "--out", str(tmp_path), *few]) == 0


@pytest.mark.filterwarnings("ignore")
def test_the_motion_of_a_figure_is_drawn_for_the_full_model(tmp_path: Path) -> None:
    changes = {"model": "full", "delta_T": 85.0, "samples_per_cycle": 1}
    gear = load_parameters(PAPER).changed(changes)
    at = next(s for s in statements("A") if isinstance(s, MotionAt) and s.value == 85)
    y = initial_state(build(gear))
    path, _ = reproduce._motion(tmp_path, Point(at, gear, np.tile(y, (60, 1)), y, 1, -0.02))
    assert path == "figures/fig09.png"
