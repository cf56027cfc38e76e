"""The verbs ``exponents`` and ``basins``, and the parameters that they take."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from gears import PAPER

from herringbone_sim.__main__ import main
from herringbone_sim.cli.arguments import parse
from herringbone_sim.cli.basins import cached_sections
from herringbone_sim.cli.parameter_options import (
    GearOptions,
    gear_from,
    settings,
)
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import ParameterError


def rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def chaos(tmp_path_factory):
    out = tmp_path_factory.mktemp("chaos")
    argv = ["exponents", "--parameters", str(PAPER), "--set", "delta_T=20", "--cycles", "500"]
    assert main([*argv, "--transient", "300", "--out", str(out)]) == 0
    return out


def test_exponents_of_the_papers_chaos(chaos):
    """delta_T = 20: all methods see chaos; the sum is that of the damping."""
    found = {(r["method"], r["quantity"]): r for r in rows(chaos / "exponents.csv")}
    value = {key: float(row["value"]) for key, row in found.items()}
    largest = value["tangent flow", "exponent 1"]
    assert largest > 0.06
    assert value["two trajectories", "exponent 1 at 1e-08"] == pytest.approx(largest, abs=0.02)
    assert value["recorded series", "exponent 1"] == pytest.approx(largest, rel=0.25)
    assert value["left and right part", "exponent 1"] > 0.03
    assert value["0-1 test", "K"] > 0.95
    assert value["tangent flow", "sum"] == pytest.approx(value["damping", "sum"], rel=1e-9)
    within, across = (
        [v for (method, name), v in value.items() if method == kind and "exponent" in name]
        for kind in ("left and right alike", "left and right part")
    )
    assert len(within) == len(across) == 4
    assert 0.0 < float(found["tangent flow", "exponent 1"]["error"]) < 0.01


def test_convergence_ends_at_the_exponents(chaos):
    table = np.genfromtxt(chaos / "convergence.csv", delimiter=",", names=True)
    last = [table[f"exponent_{j}"][-1] for j in range(1, 9)]
    shown = [float(r["value"]) for r in rows(chaos / "exponents.csv")[:8]]
    assert len(table) == 500
    assert last == pytest.approx(shown, abs=1e-8)
    assert (chaos / "exponents.png").stat().st_size > 20000


def test_motions_are_named(tmp_path, capsys):
    """P1 from rest at 85; chaos from an uneven start at 20, in which left and right differ."""
    argv = ["exponents", "--parameters", str(PAPER), "--cycles", "300", "--out", str(tmp_path)]
    assert main([*argv, "--set", "delta_T=85"]) == 0
    shown = capsys.readouterr().out
    assert "\nP1, left = right\n" in shown
    assert "recorded series" not in shown
    assert main([*argv, "--set", "delta_T=20", "--set", "initial_x=0.2,0.1,0,0"]) == 0
    shown = capsys.readouterr().out
    assert "chaotic\n" in shown
    assert "left and right part" not in shown


def test_basins_of_a_gear_with_one_motion(tmp_path, capsys):
    """delta_T = 85: the shares and the slice are P1 throughout; nothing unfinished is left."""
    argv = ["basins", "--parameters", str(PAPER), "--set", "delta_T=85", "--transient", "1000"]
    assert main([*argv, "--starts", "10", "--slice", "4", "--out", str(tmp_path)]) == 0
    (row,) = rows(tmp_path / "basins.csv")
    assert row["motion"] == "P1, left = right"
    assert (row["starts"], float(row["share"]), row["starts_of_slice"]) == ("10", 1.0, "16")
    assert float(row["low"]) == pytest.approx(0.7225, abs=1e-4)
    assert float(row["exponent_per_tau"]) < -0.02
    plane = np.genfromtxt(tmp_path / "slice.csv", delimiter=",", names=True)
    assert sorted(set(plane["shared"])) == pytest.approx([-0.75, -0.25, 0.25, 0.75])
    assert len(np.genfromtxt(tmp_path / "starts.csv", delimiter=",", names=True)) == 10
    assert not (tmp_path / "unfinished").exists()
    assert "P1, left = right" in capsys.readouterr().out
    assert main([*argv, "--starts", "2", "--out", str(tmp_path)]) == 0
    assert not (tmp_path / "slice.csv").exists()  # that of another run


def test_a_stopped_run_goes_on_where_it_was(tmp_path, monkeypatch):
    calls = []

    def gear_sections(*_):
        def sections_of(starts):
            calls.append(len(starts))
            if len(calls) == 2:
                raise KeyboardInterrupt
            return np.repeat(starts[:, None], 3, axis=1)

        return sections_of

    def ask(delta_T, starts):
        model = build(Parameters(delta_T=delta_T))
        return cached_sections(tmp_path, model, 10, 3, 1)(starts)

    monkeypatch.setattr("herringbone_sim.cli.basins.gear_sections", gear_sections)
    first, second = np.zeros((4, 2)), np.ones((3, 2))
    ask(20.0, first)
    with pytest.raises(KeyboardInterrupt):
        ask(20.0, second)
    assert ask(20.0, first).shape == (4, 3, 2)
    assert np.all(ask(20.0, second) == 1.0)
    assert calls == [4, 3, 3]
    ask(21.0, first)
    assert calls == [4, 3, 3, 4]


def parsed(*argv):
    asked = parse("exponents", [*argv, "--out", "x"]).keywords
    return gear_from(asked.get("gear", GearOptions()))[0]


def test_parameters_of_the_command_line():
    assert parsed() == Parameters()
    p = parsed("--parameters", str(PAPER), "--set", "delta_T=20", "--set", "K = 1e-1")
    assert (p.delta_T, p.K, p.thermal_rp) == (20.0, 0.1, "sun")
    p = parsed("--set", "k_amp=0.2,0.1", "--set", "model=full", "--set", "seed=3")
    assert (p.k_amp, p.model, p.seed) == ((0.2, 0.1), "full", 3)
    assert parsed("--set", "k_amp=[0.1]", "--set", "k_amp=[0.3]").k_amp == (0.3,)
    assert settings(["xi=0.1", "xi=0.2"]) == {"xi": 0.2}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("delta_T", "NAME=VALUE"),
        ("delta_T=", "NAME=VALUE"),
        ("warmth=3", "no parameter 'warmth'"),
        ("delta_T=warm", "must be float"),
        ("k_amp=0.1,x", "list of numbers"),
        ("xi=-1", "xi"),
        ("xi=nan", "finite"),
    ],
)
def test_wrong_settings_are_refused_in_words(text, told):
    with pytest.raises(ParameterError, match=told):
        parsed("--set", text)


@pytest.mark.parametrize(
    "argv",
    [
        ["exponents", "--cycles", "100"],
        ["exponents", "--transient", "-1"],
        ["basins", "--starts", "0"],
        ["basins", "--slice", "1"],
        ["basins", "--points", "5"],
        ["basins", "--reach", "0"],
    ],
)
def test_wrong_input_gives_one_line(argv, tmp_path, capsys):
    assert main([*argv, "--out", str(tmp_path / "new")]) == 2
    told = capsys.readouterr().err
    assert "error: --" in told
    assert not (tmp_path / "new").exists()


def test_a_folder_that_can_t_be_made(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    out = str(tmp_path / "file" / "out")
    assert main(["basins", "--starts", "1", "--out", out]) == 2
    assert "choose another --out" in capsys.readouterr().err
