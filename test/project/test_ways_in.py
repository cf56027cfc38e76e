"""The ways in that the docs teach run as they are written; that of ROS is in ``test/ros``."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from tempfile import gettempdir

import nbformat
import pytest
from nbclient import NotebookClient
from ways_in import ROOT, run_page

START = ROOT / "docs" / "start"


def test_a_reader_of_the_paper_reproduces_a_figure(tmp_path):
    printed = run_page(START / "paper.md", tmp_path, 900)
    with (tmp_path / "fig_A" / "statements.csv").open(encoding="utf-8") as file:
        assert {row["scenario"] for row in csv.DictReader(file)} == {"A"}
    assert (tmp_path / "fig_A" / "index.html").exists()
    assert "chaotic" in printed  # the motion at 20 K
    assert (tmp_path / "own" / "bifurcation.png").exists()


def test_an_engineer_goes_from_three_encoders_to_a_verdict(tmp_path):
    """The backlash of the left ring meshes that the page puts into its files is named."""
    run_page(ROOT / "docs" / "rig_engineer.md", tmp_path, 1500)
    report = json.loads((tmp_path / "gap_bench" / "report.json").read_text(encoding="utf-8"))
    assert report["verdict"] == "backlash_offset"
    assert report["causes"][0]["locus"] == {"mesh": "rp", "planet": "all", "side": "L"}
    assert (tmp_path / "plan" / "plan.html").exists()
    assert (tmp_path / "rigs" / "bench" / "import.html").exists()
    assert list((tmp_path / "compared").glob("*.html"))


@pytest.mark.parametrize("name", ["dynamics", "rig"])
def test_a_notebook_runs_and_prints_what_it_shows(name):
    """Every cell runs and shows what the stored one shows; what libraries log is no part of it."""
    stored = nbformat.read(START / f"{name}.ipynb", 4)
    again = nbformat.from_dict(stored)
    NotebookClient(again, timeout=900, resources={"metadata": {"path": str(ROOT)}}).execute()
    for old, new in zip(stored.cells, again.cells, strict=True):
        assert kinds_shown(old) == kinds_shown(new), old.source


def kinds_shown(cell: nbformat.NotebookNode) -> list[list[str]]:
    """Kinds of data of each output of a cell, without what was logged to standard error."""
    outputs = [one for one in cell.get("outputs", []) if one.get("name") != "stderr"]
    return [sorted(one.get("data", {})) for one in outputs]


def verdict_of(name: str) -> str:
    """Text of the first cell that shows a diagnosis."""
    cells = nbformat.read(START / f"{name}.ipynb", 4).cells
    return next(c.outputs[0].data["text/plain"] for c in cells if "hb.diagnose" in c.source)


def test_the_notebook_of_a_rig_names_the_pin_that_was_moved():
    text = verdict_of("rig")
    assert "pin_position at all/2/all" in text.splitlines()[1]


def test_every_page_of_the_site_is_in_its_table_of_contents():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = [p.relative_to(ROOT / "docs") for p in (ROOT / "docs").rglob("*") if p.suffix in KINDS]
    wanted = {str(page.with_suffix("")) for page in pages if "blind_" not in str(page)}
    assert wanted - {"index"} <= set(re.split(r"[\s<>]+", index))


def test_the_drawing_of_the_rooms_has_every_room():
    drawing = (ROOT / "docs" / "images" / "rooms.svg").read_text(encoding="utf-8")
    rooms = [p.parent.name for p in (ROOT / "herringbone_sim").glob("*/__init__.py")]
    assert all(f">{room}<" in drawing for room in rooms)


KINDS = {".md", ".ipynb"}


def test_pages_name_no_folder_of_one_machine():
    for page in (ROOT / "docs").rglob("*.ipynb"):
        text = page.read_text(encoding="utf-8")
        assert not [f for f in (str(ROOT), str(Path.home()), gettempdir()) if f in text], page
