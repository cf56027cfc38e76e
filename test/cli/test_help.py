"""What a bare call and every --help say: short, quick, and with examples that can be pasted."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from help_support import check_command, commands_in, example_of, help_of

from herringbone_sim.__main__ import VERBS, main, overview

ROOT = Path(__file__).resolve().parents[2]
WAYS = {"run", "sweep", "reproduce", "rig", "gap"}  # in, of a bare call
COLUMNS, LINES = 80, 28


@pytest.mark.parametrize("argument", ["", "--help", "--version"])
def test_what_needs_no_verb_loads_none(argument: str) -> None:
    code = (
        "import sys; from herringbone_sim.__main__ import main\n"
        "code = main(sys.argv[1:])\n"
        "loaded = {'numpy', 'numba', 'matplotlib', 'herringbone_sim.cli.run'} & set(sys.modules)\n"
        "sys.exit(str(loaded) if loaded else code)"
    )
    words = [sys.executable, "-c", code, *argument.split()]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout


def test_a_bare_call_shows_the_ways_in_on_one_screen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    assert main([]) == 0
    greeting = capsys.readouterr().out
    lines = greeting.splitlines()
    assert len(lines) <= LINES
    assert max(map(len, lines)) <= COLUMNS
    shown = commands_in(greeting)
    assert {words[1] for words in shown if words[1:]} == WAYS
    for words in shown:
        check_command(words, "greeting")
    monkeypatch.chdir(tmp_path)
    assert main([]) == 0
    elsewhere = capsys.readouterr().out
    assert elsewhere == greeting.replace("ways in:", f"ways in; config/ is in {ROOT}:")


def test_the_overview_has_a_line_on_every_verb() -> None:
    listed = [line for line in overview().splitlines() if line.startswith("  ")]
    width = max(map(len, VERBS)) + 4
    assert tuple(line[:width].strip() for line in listed) == VERBS
    assert all(len(line[width:]) > 20 for line in listed)
    assert max(map(len, listed)) <= COLUMNS


@pytest.mark.parametrize("verb", VERBS)
def test_every_option_is_explained(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = help_of(verb, capsys)
    assert text.startswith(f"usage: python -m herringbone_sim {verb} [options]")
    assert "None" not in text
    entries = re.split(r"\n  (?=-)", text.partition("options:")[2].partition("\nexample")[0])
    assert all(re.match(r"\S.*\s{2,}\w", entry, re.DOTALL) for entry in entries[1:])
    assert entries[-1].split() == ["-h,", "--help", "show", "this", "help"]


@pytest.mark.parametrize("verb", VERBS)
def test_every_help_ends_with_an_example_that_parses(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = example_of(help_of(verb, capsys))
    shown = commands_in(text)
    lines = text.rstrip("\n").replace("\\\n", " ").split("\n")
    assert len(lines) == len(shown)  # nothing else follows
    assert 1 <= len(shown) <= 3
    assert any(words[1:][: len(verb.split())] == verb.split() for words in shown)
    for words in shown:
        check_command(words, verb)
        files = [word for word in words if word.startswith(("config/", "test/"))]
        assert all((ROOT / file).exists() for file in files)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("swep", "did you mean sweep? "),
        ("campaign", "campaign import or campaign check? "),
        ("rig", "rig effects or rig make? "),
    ],
)
def test_a_verb_that_there_is_not_gives_one_line(
    asked: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([asked, "--out", "x"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: there is no verb {asked!r}: ")
    assert said in line


def test_the_first_word_of_verbs_lists_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rig", "--help"]) == 0
    listed = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  ")]
    assert [line.split()[:2] for line in listed] == [["rig", "effects"], ["rig", "make"]]
