"""The verb ``orbits``: tables, figure, refusals."""

from __future__ import annotations

import csv

import pytest
from gears import PAPER

from herringbone_sim.__main__ import main

XI = ["orbits", "--parameters", str(PAPER), "--over", "xi", "--from", "0.155", "--to", "0.17"]


def rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("orbits") / "new" / "xi"
    assert main([*XI, "--start", "0.168", "--settle", "300", "--out", str(out)]) == 0
    return out


def test_the_cascade_is_followed_and_its_flip_is_named(written):
    boundaries = rows(written / "boundaries.csv")
    (flip,) = [one for one in boundaries if one["kind"] == "flip"]
    assert 0.155 < float(flip["value"]) < 0.17
    assert float(flip["multiplier_re"]) == pytest.approx(-1.0, abs=1e-5)
    assert flip["changes_stability"] == "True"
    values = [float(one["value"]) for one in boundaries]
    assert values == sorted(values)
    orbits = rows(written / "branches.csv")
    assert {one["period"] for one in orbits} == {"1", "2"}
    for one in orbits:
        modulus = abs(complex(float(one["within_re"]), float(one["within_im"])))
        assert (modulus > 1) == (int(one["unstable_within"]) > 0)
        beyond = float(one["value"]) > float(flip["value"])
        assert (one["unstable_within"] == "0") == (beyond or one["period"] == "2")


def test_the_sections_close_on_the_branch(written):
    """At the flip the doubled branch begins with two states that are nearly one."""
    sections = [one for one in rows(written / "sections.csv") if one["branch"] == "2"]
    first = [float(one["x_sp_L"]) for one in sections if one["index"] == "0"]
    last = [float(one["x_sp_L"]) for one in sections if one["index"] == sections[-1]["index"]]
    assert len(first) == len(last) == 2
    assert abs(first[0] - first[1]) < 1e-3
    assert abs(last[0] - last[1]) > 1e-2


def test_a_figure_is_drawn(written):
    for name in ("orbits.png", "orbits.svg"):
        assert (written / name).stat().st_size > 20_000


def test_an_unstable_orbit_is_found_on_request(tmp_path, capsys):
    """P1 below its flip, from the motion of P2."""
    range_ = ["--from", "0.15", "--to", "0.158", "--max-period", "1"]
    command = ["orbits", "--parameters", str(PAPER), "--over", "xi", *range_]
    assert main([*command, "--start", "0.155:1", "--out", str(tmp_path)]) == 0
    orbits = rows(tmp_path / "branches.csv")
    assert {(one["period"], one["stability"]) for one in orbits} == {("1", "unstable both ways")}
    printed = capsys.readouterr().out
    assert "P1" in printed
    assert "orbits.png" in printed


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--start", "0.18"], "an orbit must start in 0.1"),
        (["--start", "0.16", "--mesh", "sp9_L"], "--mesh must be one of sp_L"),
        (["--over", "delta_T", "--to", "30", "--start", "20"], "is not periodic"),
        (["--over", "delta_T", "--to", "900", "--start", "20"], "half-backlash"),
        (["--from", "0.2", "--start", "0.16"], "must ascend"),
    ],
)
def test_what_cannot_be_done_is_said(tmp_path, capsys, more, message):
    command = [*XI, *more, "--settle", "50", "--out", str(tmp_path / "out")]
    assert main(command) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_is_refused_before_the_work(tmp_path, capsys):
    (tmp_path / "file").touch()
    command = [*XI, "--start", "0.168", "--settle", "300", "--out", str(tmp_path / "file" / "in")]
    assert main(command) == 2
    assert "choose another --out" in capsys.readouterr().err


@pytest.mark.parametrize("start", ["0.16:0", "0.16:", "0.16:half", "warm"])
def test_a_start_that_is_none_is_refused(start, capsys):
    assert main([*XI, "--start", start, "--out", "x"]) == 2
    assert "error: --start must" in capsys.readouterr().err


def test_a_parameter_that_cannot_vary_is_refused(capsys):
    words = ["--over", "z_s", "--from", "1", "--to", "2", "--start", "1", "--out", "x"]
    assert main(["orbits", *words]) == 2
    assert "error: --over must be one of xi, T_1, delta_T" in capsys.readouterr().err
