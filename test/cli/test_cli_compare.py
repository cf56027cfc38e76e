"""``compare``: what moves between two gears, as data, on the page and from the shell."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from gap_support import a_report
from sweep_support import ROOT, gear

from herringbone_sim.__main__ import main
from herringbone_sim.effects.written import read_effects
from herringbone_sim.recording.parameter_file import load_parameters, save_parameters
from herringbone_sim.sweeps.compare import (
    GearSweeps,
    boundaries,
    coexisting,
    label_stretches,
    match_boundaries,
    motion,
    motions_at,
    shares,
)
from herringbone_sim.sweeps.grid import Axis, Observation, Sweep
from herringbone_sim.sweeps.store import Result
from herringbone_sim.views.figures.compare import colour, starts_figure
from herringbone_sim.views.pages.compare import cells, headline
from herringbone_sim.views.pages.gap.page import compare_command, gap_page

VALUES = tuple(np.linspace(60.0, 90.0, 31))
LOOK = Observation(10, 10, 10, mesh="sp_L")


def side(name: str, *edges: float, forcing: int = 1, other: float = 90.0, lost: float = 65.0):
    """Aperiodic, P2 and P1 with these edges; from above P1 goes on down to another one; both
    flanks are hit below where contact is lost."""
    sweep = Sweep(gear(), (Axis("delta_T", VALUES),), LOOK)

    def result(edges: tuple[float, ...]) -> Result:
        kinds = np.array([0.0, 2.0, 1.0]) * forcing
        n = len(VALUES)
        columns = {name: np.zeros(n) for name in ("exponent", "within", "transverse")}
        columns |= {"period": kinds[np.searchsorted(edges, VALUES, side="right")]}
        columns |= {"asymmetry": np.zeros(n), "points": np.zeros((n, 10))}
        columns |= {"contact_loss": np.where(np.array(VALUES) < lost, 2.0, 1.0)}
        return Result(sweep, columns, np.full(n, "", dtype=object))

    return GearSweeps(
        name, {"fixed": result(edges), "down": result((min(other, edges[0]),) * 2)}, forcing
    )


def test_motions_are_named_by_the_period_of_the_forcing() -> None:
    assert [motion(p) for p in (0.0, 1.0, 3.0, math.nan)] == ["aperiodic", "P1", "P3", "not known"]
    assert [motion(p, 27) for p in (27.0, 54.0, 0.0)] == ["P1", "P2", "aperiodic"]
    assert motion(40.0, 27) == "40 mesh cycles"
    assert colour("P1") != colour("P2") != colour("aperiodic")


def test_starts_are_drawn_at_their_values_on_an_uneven_axis() -> None:
    """Cells reach to the middle between values, as on a map."""
    alone = side("nominal", 70.0, 80.0)
    uneven = Sweep(gear(), (Axis("delta_T", (0.0, 1.0, 10.0)),), LOOK)
    results = {
        way: replace(of, sweep=uneven, columns={n: c[:3] for n, c in of.columns.items()})
        for way, of in alone.results.items()
    }
    made = replace(alone, results=results)
    (cells_drawn,) = starts_figure(made, made).axes[0].collections
    np.testing.assert_allclose(cells_drawn.get_coordinates()[0, :, 0], [-0.5, 0.5, 5.5, 14.5])


def test_stretches_that_do_not_last_make_no_boundary() -> None:
    labels = ["a"] * 60 + ["b"] + ["a"] * 40 + ["b"] * 30 + ["a"] + ["c"] * 60
    assert label_stretches(labels) == [(0, 100, "a"), (101, 130, "b"), (132, 191, "c")]
    found = boundaries("motion", [float(i) for i in range(len(labels))], labels)
    assert [(one.before, one.after, one.value, one.half_width) for one in found] == [
        ("a", "b", 100.5, 0.5),
        ("b", "c", 131.0, 1.0),
    ]


def test_boundaries_of_two_gears_are_matched_and_told() -> None:
    nominal, augmented = side("nominal", 64.5, 79.5), side("augmented", 70.5, 82.5, forcing=27)
    found = match_boundaries(nominal, augmented, "fixed")
    assert [one.shift for one in found] == [6.0, 3.0, 0.0]
    assert [one.uncertainty for one in found] == [1.0] * 3
    assert headline(found) == (
        "2 of 3 shared boundaries move, aperiodic to P2 by +6; 0 are new, 0 are gone"
    )
    assert cells(found[1]) == ["P2 to P1", "79.5", "82.5", "+3 ± 1"]
    found = match_boundaries(nominal, side("augmented", 64.5, 100.0, lost=0.0), "fixed")
    assert [cells(one)[-1] for one in found] == ["+0 ± 1", "gone", "gone"]
    assert cells(match_boundaries(side("n", 50.0, 50.0), nominal, "fixed")[0])[1:] == [
        "–",
        "64.5",
        "new",
    ]
    assert shares(nominal, augmented, "fixed")["P1"] == (11 / 31, 8 / 31)


def test_motions_of_different_starts_coexist() -> None:
    (one, two) = coexisting(side("nominal", 70.5, 79.5, other=65.5))
    assert (one.low, one.high, one.motions) == (
        66.0,
        70.0,
        ("P1 (left = right)", "aperiodic (left = right)"),
    )
    assert (two.low, two.high) == (71.0, 79.0)
    assert two.motions == ("P1 (left = right)", "P2 (left = right)")
    assert coexisting(side("nominal", 70.5, 70.5)) == []


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("gears")
    base = load_parameters(ROOT / "config" / "paper.yaml")
    save_parameters(folder / "nominal.yaml", base)
    soft = read_effects("mean_stiffness:factor=0.95")
    save_parameters(folder / "effect.yaml", base, actives=soft)
    save_parameters(folder / "parameter.yaml", base.changed({"k_factor": [0.95]}))
    return {path.stem: path for path in folder.glob("*.yaml")}


SHORT = ["--over=delta_T=76:90:15", "--starts=1", "--transient=500", "--cycles=60", "--workers=1"]


def boundaries_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "boundaries.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def made(files: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("compare") / "new"
    command = ["compare", str(files["nominal"]), str(files["effect"]), *SHORT, f"--out={out}"]
    assert main(command) == 0
    return out


def test_a_softer_mesh_moves_the_boundary_of_p1(
    made: Path, files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As the parameter that says the same does, to the line."""
    (row,) = [
        one
        for one in boundaries_of(made)
        if (one["start"], one["kind"], one["before"], one["after"]) == ("fixed", "motion", *EDGE)
    ]
    assert float(row["nominal"]) == pytest.approx(82.5, abs=1.0)
    assert float(row["shift"]) > float(row["error"])
    more = [*SHORT, f"--out={tmp_path}"]
    assert main(["compare", str(files["nominal"]), str(files["parameter"]), *more]) == 0
    assert boundaries_of(tmp_path) == boundaries_of(made)
    assert "k_factor: [1] / [0.95]" in capsys.readouterr().out


EDGE = ("P2", "P1")


def test_all_that_is_told_is_written(made: Path) -> None:
    page = (made / "report.html").read_text(encoding="utf-8")
    assert "mean_stiffness@all/all/all:factor=0.95" in page
    assert page.count("data:image/png;base64,") == 2
    assert "P2 to P1" in page
    assert "http" not in page
    for name in ("compare", "starts"):
        assert (made / "figures" / f"{name}.png").stat().st_size > 15_000
    told = json.loads((made / "compare.json").read_text(encoding="utf-8"))
    assert told["parameter"] == "delta_T"
    assert len(told["boundaries"]) == len(boundaries_of(made))
    values = (made / "values.csv").read_text(encoding="utf-8").splitlines()
    assert len(values) == 1 + 2 * 4 * 15
    assert sorted(path.name for path in (made / "augmented").iterdir()) == [
        *("down", "fixed", "random_1", "up"),
    ]


def test_a_second_run_computes_nothing(
    made: Path, files: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("herringbone_sim.sweeps.execute.observe_parts", None)
    before = (made / "boundaries.csv").read_bytes()
    command = ["compare", str(files["nominal"]), str(files["effect"]), *SHORT]
    assert main([*command, f"--out={made}"]) == 0
    assert (made / "boundaries.csv").read_bytes() == before


def test_gears_of_one_planet_class_and_of_all_become_alike(
    files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    full = tmp_path / "full.yaml"
    base = load_parameters(files["nominal"]).changed({"model": "full", "delta_T": 85.0})
    crack = read_effects("tooth_crack@sp/1/L:depth=0.3")
    save_parameters(full, base, actives=crack)
    short = ["--over=delta_T=85:90:2", "--starts=0", "--transient=200", "--start=fixed"]
    out = tmp_path / "out"
    assert main(["compare", str(files["nominal"]), str(full), *short, f"--out={out}"]) == 0
    told = capsys.readouterr().out
    assert "P1 takes 27 mesh cycles" in told
    assert "270 observed at each" in told
    assert told.count("not alike") == 1
    assert "share of the values, nominal / augmented: P1 100.0% / 100.0%" in told


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--over=delta_T=900:990:2"], "nominal gear at delta_T = 900: delta_T"),
        (["--over=delta_T=80:90:2", "--starts=-1"], "--starts must be >= 0"),
        (["--over=delta_T=80:90:2", "--mesh=sp9_L"], "mesh must be one of"),
        (["--over=warmth=1:2:2"], "no parameter 'warmth'"),
    ],
)
def test_what_cannot_be_compared_is_said(
    files: dict[str, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: list[str],
    message: str,
) -> None:
    pair = [str(files["nominal"]), str(files["effect"])]
    assert main(["compare", *pair, *more, f"--out={tmp_path / 'out'}"]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_diagnosis_tells_the_command() -> None:
    command = compare_command(Path("my rig/rig.yaml"), Path("found"))
    page = unescape(gap_page(a_report(), (), command))
    assert "compare 'my rig/rig.yaml' found/augmented.yaml --over delta_T=0:100:400" in page
    assert "What the real gear will do" in page
    assert "What the real gear will do" not in gap_page(a_report())


def test_a_motion_that_is_not_known_hides_no_other() -> None:
    """From points that are too few, of a gear with equal halves."""
    known = side("nominal", 70.0, 80.0)
    columns = known.results["fixed"].columns
    unknown = columns | {"period": np.full(len(VALUES), np.nan)}
    results = known.results | {"fixed": replace(known.results["fixed"], columns=unknown)}
    for names in motions_at(replace(known, results=results)):
        assert names
        assert not any("not known" in name for name in names)
