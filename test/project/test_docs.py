"""What README and docs say of commands, links and examples holds."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from help_support import check_command, commands_in

from herringbone_sim.__main__ import VERBS
from herringbone_sim.recording.campaign import read_campaign
from herringbone_sim.recording.reader import read_recording

ROOT = Path(__file__).resolve().parents[2]
CONTRIBUTING = ROOT / "CONTRIBUTING.md"
PAGES = (ROOT / "README.md", CONTRIBUTING, *sorted((ROOT / "docs").glob("**/*.md")))


def commands(page: Path) -> list[list[str]]:
    """Every command of a page on a line of its own, module first."""
    return commands_in(page.read_text(encoding="utf-8"))


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    heads = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^a-z0-9 _-]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_parse(page: Path) -> None:
    for words in commands(page):
        check_command(words, page.name)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        file, _, anchor = link.partition("#")
        if "://" in link:
            continue
        target = page.parent / file if file else page
        assert target.exists(), f"{page.name}: {link}"
        assert not anchor or anchor in anchors(target), f"{page.name}: {link}"


def test_one_page_shows_every_verb() -> None:
    page = ROOT / "docs" / "verbs.md"
    shown = {" ".join(words[1:n]) for words in commands(page) for n in (2, 3)}
    assert set(VERBS) <= shown


def test_the_readme_is_read_in_some_minutes() -> None:
    assert len(PAGES[0].read_text(encoding="utf-8").splitlines()) < 150


def test_the_page_for_contributors_names_rooms_and_files_that_there_are() -> None:
    text = CONTRIBUTING.read_text(encoding="utf-8")
    package = ROOT / "herringbone_sim"
    rooms = {f"{path.parent.name}/" for path in package.glob("*/__init__.py")}
    assert {room for room in rooms if f"`{room}`" not in text} == set()
    named = set(re.findall(r"`((?:[a-z_]+/)+(?:[a-z_]+\.[a-z]+)?)`", text)) - {"data/"}
    places = (ROOT, package, package / "gap", package / "gap" / "observations")
    assert len(named) > 30
    assert {n for n in named if not any((place / n).exists() for place in places)} == set()


def test_a_campaign_of_ones_own_is_read(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    said: dict[str, Any] = {}
    exec(re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0], said)
    given = yaml.safe_load(re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)[0])
    columns = {"t": np.arange(5) * 1e-5, "phase": np.arange(5) * 0.3, "F_sp1_L": np.ones(5)}
    for run in given["runs"]:
        said["write_run"](tmp_path, run["path"], columns)
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump(given), encoding="utf-8")
    found = read_campaign(tmp_path)
    assert [run.role for run in found.runs] == ["fit", "held_out"]
    assert found.noise_share == 0.01
    assert not found.faults
    samples = read_recording(found.runs[0].path).samples
    assert samples.names == tuple(columns)
    assert np.array_equal(samples["phase"], columns["phase"])
