"""The command: files, summary, report, several runs, refusals."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from analysis_support import harmonic_series, henon, mapped_series, series_of
from matplotlib.figure import Figure

from herringbone_sim.__main__ import main
from herringbone_sim.analysis.pipeline import analyze_series
from herringbone_sim.core.parameters import Parameters, to_mapping
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.recording.writer import RunWriter
from herringbone_sim.views.figures.motion import draw_spectrum
from herringbone_sim.views.figures.style import Scale

START_NS = 1_700_000_000_000_000_000


def _record(
    folder: Path, name: str, series: TimeSeries, parameters: dict[str, Any] | None = None
) -> Path:
    channels = {"source": "rig", "channels": [{"name": n, "unit": "-"} for n in series.names]}
    if parameters:
        channels["parameters"] = parameters  # type: ignore[assignment]
    writer = RunWriter.create(folder, name, "/rig", channels, series.names, START_NS)
    for start in range(0, len(series), 2000):
        writer.write_samples(series.data[start : start + 2000])
    writer.close({})
    return folder / name


def _staircase(levels: int = 4, dwell: int = 120) -> TimeSeries:
    n = levels * dwell * 16 + 1
    K = np.minimum(np.arange(n) // (dwell * 16), levels - 1) / 10
    return harmonic_series(levels * dwell, {1.0: 3e-5, 0.5: 2e-5}, K=K)


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_run_gives_tables_figures_and_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = _record(tmp_path, "stairs", _staircase())
    out = tmp_path / "out"
    assert main(["analyze", str(run), "--out", str(out)]) == 0
    segments = _rows(out / "segments.csv")
    assert [row["period"] for row in segments] == ["2"] * 4
    assert [float(row["K"]) for row in segments] == pytest.approx([0, 0.1, 0.2, 0.3])
    points = _rows(out / "poincare.csv")
    assert {row["segment"] for row in points} == {"1", "2", "3", "4"}
    assert len({round(float(row["v_sp_L"]), 6) for row in points}) == 2
    lines = {row["h/n"]: float(row["amplitude_m"]) for row in _rows(out / "lines.csv")}
    assert lines["1/2"] == pytest.approx(2e-5, rel=1e-2)
    assert {row["K"] for row in _rows(out / "bifurcation.csv")} == {"0", "0.1", "0.2", "0.3"}
    assert _rows(out / "spectrum.csv")
    drawn = sorted(path.name for path in (out / "figures").iterdir())
    names = ["bifurcation", *(f"segment_00{i}" for i in (1, 2, 3, 4))]
    assert drawn == sorted(f"{name}.{kind}" for name in names for kind in ("png", "svg"))
    assert all(path.stat().st_size > 5000 for path in (out / "figures").iterdir())
    printed = capsys.readouterr().out
    assert len(re.findall(r"\bP2\b", printed)) == 4
    assert "report.html" in printed


def test_the_page_holds_everything_itself(tmp_path: Path) -> None:
    run = _record(tmp_path, "stairs", _staircase())
    main(["analyze", str(run), "--out", str(tmp_path / "out")])
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 5
    assert not re.search(r'(src|href)="(?!data:)', page)
    assert page.count("P2</b>") == 4


def test_many_segments_are_drawn_in_part_and_that_is_said(tmp_path: Path) -> None:
    run = _record(tmp_path, "long", _staircase(levels=9, dwell=40))
    main(["analyze", str(run), "--out", str(tmp_path / "out")])
    assert len(list((tmp_path / "out" / "figures").glob("segment_*.png"))) == 6
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "figures show 6 of 9 segments" in page


def test_a_known_gear_gives_contact_and_scales(tmp_path: Path) -> None:
    run = _record(tmp_path, "known", _staircase(1), to_mapping(Parameters()))
    main(["analyze", str(run), "--out", str(tmp_path / "out"), "--no-model"])
    (row,) = _rows(tmp_path / "out" / "segments.csv")
    shares = [float(row[f"{name}_sp_L"]) for name in ("drive", "separated", "back")]
    assert sum(shares) == pytest.approx(1)
    assert float(row["cycles_per_tau"]) == pytest.approx(100 / 32e3, rel=0.05)
    assert row["model_exponent_per_cycle"] == ""


def test_parameters_may_come_from_a_file_in_ros_form(tmp_path: Path) -> None:
    run = _record(tmp_path, "rig", _staircase(1))
    file = tmp_path / "rig.yaml"
    file.write_text("/**:\n  ros__parameters:\n    b: 0.3\n    z_r: 78\n    z_s: 27\n")
    command = ["analyze", str(run), "--out", str(tmp_path / "out"), "--no-model"]
    assert main([*command, "--parameters", str(file)]) == 0
    (row,) = _rows(tmp_path / "out" / "segments.csv")
    assert float(row["separated_sp_L"]) > 0


def test_several_runs_get_folders_and_a_joint_diagram(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [
        _record(tmp_path, f"run_{k}", harmonic_series(60, {1.0: (1 + k) * 1e-5}, K=k / 10))
        for k in range(3)
    ]
    out = tmp_path / "out"
    assert main(["analyze", *map(str, runs), "--out", str(out)]) == 0
    assert all((out / f"run_{k}" / "report.html").exists() for k in range(3))
    assert {row["K"] for row in _rows(out / "bifurcation.csv")} == {"0", "0.1", "0.2"}
    assert "joint bifurcation diagram over K" in capsys.readouterr().out


def test_runs_that_differ_in_nothing_are_told_why_there_is_no_diagram(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = _record(tmp_path, "same", harmonic_series(60, {1.0: 1e-5}))
    out = tmp_path / "out"
    assert main(["analyze", str(run), str(run), "--out", str(out)]) == 0
    assert (out / "same~2" / "report.html").exists()
    assert "no parameter that differs" in capsys.readouterr().out


def test_a_run_named_like_a_repeated_one_keeps_its_folder(tmp_path: Path) -> None:
    series = harmonic_series(60, {1.0: 1e-5})
    runs = [_record(tmp_path, name, series) for name in ("same~2", "same")]
    again = _record(tmp_path / "again", "same", series)
    out = tmp_path / "out"
    assert main(["analyze", *map(str, [*runs, again]), "--out", str(out), "--no-model"]) == 0
    reports = {report.parent.name for report in out.glob("*/report.html")}
    assert reports == {"same~2", "same", "same~3"}


def test_runs_that_cannot_be_analysed_do_not_keep_others_from_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = [
        _record(tmp_path, f"run_{k}", harmonic_series(60, {1.0: 1e-5}, K=k / 10)) for k in range(3)
    ]
    bad = _record(tmp_path, "bare", _without_phase())
    out = tmp_path / "out"
    command = ["analyze", *map(str, [good[0], bad, *good[1:]]), "--out", str(out), "--no-model"]
    assert main(command) == 2
    assert {report.parent.name for report in out.glob("*/report.html")} == {
        "run_0",
        "run_1",
        "run_2",
    }
    said = capsys.readouterr()
    assert "joint bifurcation diagram over K" in said.out
    assert said.err.startswith("error: 1 of 4 runs can't be analysed: bare: ")


def test_a_chaotic_run_is_called_chaotic(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = _record(tmp_path, "henon", mapped_series(henon(1200)))
    assert main(["analyze", str(run), "--out", str(tmp_path / "out"), "--noise", "0"]) == 0
    assert "chaotic" in capsys.readouterr().out
    (row,) = _rows(tmp_path / "out" / "segments.csv")
    assert float(row["exponent_low"]) > 0.3


def _without_phase() -> TimeSeries:
    series = harmonic_series(60, {1.0: 1e-5})
    return series_of({n: series[n] for n in series.names if n != "phase"})


def test_without_a_phase_the_mesh_frequency_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["analyze", str(_record(tmp_path, "bare", _without_phase()))]
    command += ["--out", str(tmp_path / "out")]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert "--mesh-frequency" in error
    assert len(error.strip().splitlines()) == 1
    assert main([*command, "--mesh-frequency", "100"]) == 0
    assert _rows(tmp_path / "out" / "segments.csv")[0]["period"] == "1"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--mesh-frequency", "100"], "is for runs without a phase channel, and run has one"),
        (["--mesh", "sp_X"], "--mesh must be one of sp_L"),
        (["--parameters", "nowhere.yaml"], "nowhere.yaml: No such file or directory"),
    ],
)
def test_wrong_options_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    run = _record(tmp_path, "run", harmonic_series(60, {1.0: 1e-5}))
    assert main(["analyze", str(run), "--out", str(tmp_path / "out"), *options]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(("share", "texts"), [(0.0, ["no motion"]), (1.0, [])])
def test_the_spectrum_of_a_dead_gauge_is_said_to_be_none(share: float, texts: list[str]) -> None:
    series = harmonic_series(60, {1.0: 3e-5})
    moved = series.data.copy()
    moved[:, [name.startswith("x_") for name in series.names]] *= share
    (result,) = analyze_series(TimeSeries(series.times, moved, series.names))
    axes = Figure().add_subplot()
    draw_spectrum(axes, result, result.motion.meshes[0], Scale())
    assert [text.get_text() for text in axes.texts] == texts


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--noise", "2"], "--noise must be < 1.0, got '2'"),
        (["--noise", "x"], "--noise must be a number, got 'x'"),
        (["--transient", "-1"], "--transient must be >= 0, got '-1'"),
        (["--transient", "2.5"], "--transient must be a whole number, got '2.5'"),
        (["--mesh-frequency", "0"], "--mesh-frequency must be > 0.0, got '0'"),
        (["--max-period", "0"], "--max-period must be >= 1, got '0'"),
    ],
)
def test_numbers_out_of_range_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], told: str
) -> None:
    assert main(["analyze", "run", "--out", str(tmp_path), *options]) == 2
    assert capsys.readouterr().err == f"error: {told}: see --help\n"


def test_an_output_that_is_a_file_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = _record(tmp_path, "run", harmonic_series(60, {1.0: 1e-5}))
    taken = tmp_path / "taken"
    taken.write_text("")
    assert main(["analyze", str(run), "--out", str(taken)]) == 2
    assert "choose another --out" in capsys.readouterr().err


NAMES = [
    *("sun_planet_1_left", "50%", "sp#1", "a$b", "$$", "$x_{", "x^y^z", "{", "}", "\\frac"),
    *("\\$", "a\\$b$", "~&<b>", "mesh with spaces", "Ω_ω", "sp1_L", "x" * 300, "_", "_L"),
]


@pytest.mark.parametrize("mesh", ["sun_planet_1_left", "$$x_{ 50%", "sp#1^"])
def test_names_from_outside_are_drawn_as_they_are(tmp_path: Path, mesh: str) -> None:
    series = _staircase(levels=1, dwell=60)
    names = tuple(f"{n[:2]}{mesh}" if n in ("x_sp_L", "v_sp_L") else n for n in series.names)
    run = _record(tmp_path, "run $50% #1_a^", TimeSeries(series.times, series.data, names))
    assert main(["analyze", str(run), "--out", str(tmp_path / "out $_{")]) == 0
    assert (tmp_path / "out $_{" / "figures" / "segment_001.png").stat().st_size > 5000


def test_text_from_outside_stays_what_it_is_beside_formulas() -> None:
    from matplotlib.figure import Figure
    from matplotlib.mathtext import MathTextParser

    from herringbone_sim.views.figures.style import Scale
    from herringbone_sim.views.figures.text import plain_text

    for name in NAMES:
        assert Scale().v_label(name)
        for label in (plain_text(name), f"{plain_text(name)} / $b_c$", Scale().x_label(name)):
            text = Figure().text(0, 0, label)
            cleaned, is_formula = text._preprocess_math(label)
            if is_formula:
                MathTextParser("agg").parse(cleaned)
    assert plain_text("50%_a") == "50%_a"
    assert len(plain_text("x" * 300)) < 100
    assert "\n" not in plain_text("a\nb")
    assert Scale().x_label("sp1_L") == r"$x_{\mathrm{sp1}}^{\mathrm{L}}$ [µm]"


def test_segments_that_are_all_too_short_for_a_spectrum_give_an_empty_table(
    tmp_path: Path,
) -> None:
    run = _record(tmp_path, "run", harmonic_series(6, {1.0: 3e-5}))
    assert main(["analyze", str(run), "--out", str(tmp_path / "out")]) == 0
    header = (tmp_path / "out" / "spectrum.csv").read_text().strip()
    assert header.startswith("segment,order,x_")
    assert "\n" not in header
