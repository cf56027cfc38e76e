"""The examples that helps end with do what they say, one after another in one folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from help_support import commands_in, example_of, help_of

from herringbone_sim.__main__ import VERBS, main
from herringbone_sim.examples import files

ROOT = Path(__file__).resolve().parents[2]
QUICK = {  # and what they write
    "parameters": "",
    "sweep": "over_K/bifurcation.png",
    "exponents": "chaos/exponents.csv",
    "orbits": "orbits/boundaries.csv",
    "rig effects": "",
    "rig make": "rigs/mine/campaign.yaml",
    "campaign import": "rigs/files/import.html",
    "campaign check": "rigs/pin/campaign.yaml",
    "gap calibrate": "weights.json",
}
OF_NODES = {"run", "info", "replay", "show", "analyze", "recover", "gap live"}  # test/ros
MINUTES = {
    *("demo", "map", "basins", "survival", "compare", "control", "reproduce"),
    *("gap", "gap plan", "gap verify", "gap bench"),
}
Shell = Callable[[list[str]], int]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("user")
    for name in ("config", "test"):
        (made / name).symlink_to(ROOT / name)
    return made


@pytest.fixture(scope="module")
def shell() -> Shell:
    """Runs a command, unless it ran already."""
    done: dict[tuple[str, ...], int] = {}

    def run(words: list[str]) -> int:
        if tuple(words) not in done:
            program = files.main if words[0] == files.__name__ else main
            done[tuple(words)] = program(words[1:]) or 0
        return done[tuple(words)]

    return run


def test_every_verb_is_here_or_elsewhere() -> None:
    assert sorted([*QUICK, *OF_NODES, *MINUTES]) == sorted(VERBS)


@pytest.mark.parametrize("verb", QUICK)
def test_an_example_works(
    verb: str,
    folder: Path,
    shell: Shell,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(folder)
    for words in commands_in(example_of(help_of(verb, capsys))):
        assert shell(words) == 0, " ".join(words)
    assert (folder / QUICK[verb]).exists()
