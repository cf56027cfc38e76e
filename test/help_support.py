"""Commands that a text shows, such as the example at the end of a verb's help."""

from __future__ import annotations

import importlib.util
import re
import shlex

import pytest

from herringbone_sim.__main__ import VERBS, main, parser

NAME = "herringbone_sim"
COMMAND = re.compile(rf"^ *python -m ({NAME}\b(?:[^\n\\]|\\\n|\\.)*)", re.MULTILINE)
EXPLAINED = (*VERBS, "rig effects", "rig make")


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
        if " ".join(rest[:2]) in VERBS:
            rest[:2] = [" ".join(rest[:2])]
        _, unknown = parser([rest[0]]).parse_known_args(rest)  # exits where an option is unknown
        assert not unknown or unknown[0] == "--ros-args", f"{where}: {' '.join(words)}"


def help_of(verb: str, capsys: pytest.CaptureFixture[str]) -> str:
    """What ``VERB --help`` prints."""
    with pytest.raises(SystemExit) as ended:
        main([*verb.split(), "--help"])
    assert ended.value.code == 0
    return capsys.readouterr().out


def example_of(text: str) -> str:
    """The end of a help, from the line after ``example`` on."""
    assert text.count("\nexample") == 1
    return text.partition("\nexample")[2].partition(":\n")[2]
