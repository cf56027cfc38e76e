"""Commands that a text shows, such as the example at the end of a verb's help."""

from __future__ import annotations

import importlib.util
import re
import shlex

import pytest

from herringbone_sim.__main__ import VERBS, main, split_ros
from herringbone_sim.cli.arguments import parse

NAME = "herringbone_sim"
COMMAND = re.compile(rf"^ *python -m ({NAME}\b(?:[^\n\\]|\\\n|\\.)*)", re.MULTILINE)


def commands_in(text: str) -> list[list[str]]:
    """Words of every command on a line of its own, module first; ... stands in sketches."""
    found = [shlex.split(one.replace("\\\n", " "), comments=True) for one in COMMAND.findall(text)]
    return [words for words in found if "..." not in words]


def check_command(words: list[str], where: str) -> None:
    """A verb with arguments that it knows, or a module that there is."""
    module, *rest = words
    if module != NAME:
        assert importlib.util.find_spec(module), f"{where}: {module}"
    elif rest and rest[0] != "--help":
        count = 2 if " ".join(rest[:2]) in VERBS else 1
        assert " ".join(rest[:count]) in VERBS, f"{where}: {' '.join(words)}"
        parse(" ".join(rest[:count]), *split_ros(rest[count:]))  # refuses what is unknown


def help_of(verb: str, capsys: pytest.CaptureFixture[str]) -> str:
    """What ``VERB --help`` prints."""
    assert main([*verb.split(), "--help"]) == 0
    return capsys.readouterr().out


def example_of(text: str) -> str:
    """The end of a help, from the line after ``example`` on."""
    assert text.count("\nexample") == 1
    return text.partition("\nexample")[2].partition(":\n")[2]
