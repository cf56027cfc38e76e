"""``map`` from the command line: pictures of two parameters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from sweep_support import ROOT, gear, run

from herringbone_sim.__main__ import main
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.grid import Axis, Observation, Sweep
from herringbone_sim.sweeps.store import load_store
from herringbone_sim.views.figures import maps, style

PAPER = f"--parameters={ROOT / 'config/paper.yaml'}"
SHORT = ["--transient=5", "--cycles=5", "--workers=1"]


def test_a_map_is_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["map", PAPER, "--kind=delta_T-K", "--size=3", *SHORT, "--out", str(tmp_path)]
    assert main(command) == 0
    told = capsys.readouterr().out
    for name in ("period", "exponent", "contact", "map"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
        assert str(tmp_path / f"{name}.svg") in told
    assert load_store(tmp_path).sweep.names == ("delta_T", "K")


def test_a_map_has_two_axes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "--over=K=0:1:3", "--out", str(tmp_path)]) == 2
    assert "a map has two axes, got 1" in capsys.readouterr().err


def test_a_map_of_one_value_is_refused_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["map", PAPER, "--kind=delta_T-K", "--size=1", *SHORT, "--out", str(tmp_path / "a")]
    assert main(command) == 2
    assert "two values or more on each axis, got 1 x 1" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory):
    """Periods 2 and 1 of the paper's gear, and heat that leaves no backlash."""
    axes = (Axis("delta_T", (70.0, 90.0, 300.0)), Axis("xi", (0.06, 0.07)))
    sweep = Sweep(gear(), axes, Observation(150, 80, 80))
    return run(tmp_path_factory.mktemp("map"), sweep, workers=1)


def test_cells_have_the_colour_of_their_period(result) -> None:
    axes = Figure().subplots()
    maps.draw_period(axes, result)
    (mesh,) = axes.collections
    drawn = np.asarray(mesh.get_array())
    assert drawn.shape == (2, 3)
    colours = mesh.cmap(mesh.norm(drawn))
    assert result["period"][:2, 1].tolist() == [2.0, 1.0]
    for column, period in ((0, 2), (1, 1)):
        wanted = tuple(int(maps.PERIOD_COLOURS[period][i : i + 2], 16) / 255 for i in (1, 3, 5))
        assert colours[1, column, :3] == pytest.approx(wanted)
    assert np.ma.getmaskarray(mesh.get_array())[:, 2].all()
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["P1", "P2", "none"]


def test_a_period_without_a_colour_of_its_own_is_no_failed_run(result) -> None:
    """As that of a run-out, which repeats with the turns of a member; it is in the legend."""
    long = result["period"].copy()
    long[0, 0] = 27.0
    axes = Figure().subplots()
    maps.draw_period(axes, replace(result, columns={**result.columns, "period": long}))
    (mesh,) = axes.collections
    assert not np.ma.getmaskarray(mesh.get_array())[0, 0]
    assert "above P16" in [text.get_text() for text in axes.get_legend().get_texts()]


def test_zero_exponent_is_white(result) -> None:
    axes = Figure().subplots()
    maps.draw_exponent(axes, result)
    (mesh,) = axes.collections
    assert mesh.norm(0.0) == 0.5
    assert mesh.cmap(0.5)[:3] == pytest.approx((0.97, 0.97, 0.97), abs=0.01)


def test_nothing_to_draw_is_told(tmp_path: Path) -> None:
    axes = (Axis("delta_T", (300.0, 310.0)), Axis("K", (0.0, 0.1)))
    failed = run(tmp_path, Sweep(gear(), axes, Observation(5, 5, 5)), workers=1)
    with pytest.raises(AnalysisError, match="no value of this map came out"):
        maps.write_maps(tmp_path, failed)


def test_a_label_has_symbol_and_unit() -> None:
    assert style.parameter_label("delta_T") == r"temperature rise $\Delta T$ [K]"
    assert r"\Omega" in style.parameter_label("Omega")
    assert style.parameter_label("b_c") == "b_c [m]"
