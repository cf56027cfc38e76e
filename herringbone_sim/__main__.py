"""``python -m herringbone_sim``: one command, many verbs."""

from __future__ import annotations

import difflib
import os
import sys
import warnings
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Any

# Matrices here are small: threads of a linear algebra library only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from herringbone_sim.cli.verbs import PROGRAM, VERBS, greeting, overview
from herringbone_sim.core.parameters import ParameterWarning
from herringbone_sim.errors import HerringboneError
from herringbone_sim.version import VERSION

EXECUTABLES = {"simulator": "run"}  # name for ``ros2 run`` -> verb, where they differ
HELP = {"-h", "--help"}


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the verb: 2 with one clear line when input or output can't be had.

    Where whoever reads the output has gone, as ``head`` does, it ends quietly with 1.
    """
    try:
        try:
            return _run(argv)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        _forget_output()
        return 1
    except OSError as error:
        _forget_output()
        named = error.filename or "the output"
        print(f"error: {named} can't be used: {error.strerror or error}", file=sys.stderr)
        return 2


def _forget_output() -> None:
    """Let the interpreter, which flushes once more when it ends, write what is left to nowhere."""
    if sys.__stdout__ is not None and sys.stdout is sys.__stdout__:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.__stdout__.fileno())
        os.close(nowhere)


def _run(argv: Sequence[str] | None) -> int:
    arguments = list(sys.argv[1:] if argv is None else argv)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # Names of files and texts in them need not be characters that a terminal has.
            stream.reconfigure(errors="backslashreplace")
    count = 2 if " ".join(arguments[:2]) in VERBS else 1
    verb, words = " ".join(arguments[:count]), arguments[count:]
    if verb not in VERBS:
        return _without_verb(verb, words)
    from herringbone_sim.cli.arguments import help_of, parse

    own, of_ros = split_ros(words)
    if HELP & set(own[: own.index("--")] if "--" in own else own):
        print(help_of(verb))
        return 0
    with warnings.catch_warnings():
        _warn_once()
        try:
            return parse(verb, own, of_ros)()
        except HerringboneError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            return 130


def _without_verb(asked: str, words: Sequence[str]) -> int:
    """Greet, list the verbs or tell the version, without importing any; 2 for what is none."""
    begun = [verb for verb in VERBS if verb.startswith(f"{asked} ")] if asked else []
    if asked in ("", "--version", *HELP):
        print(VERSION if asked == "--version" else overview() if asked else greeting())
        return 0
    if begun and HELP & set(words[:1]):
        print(overview(f"{asked} "))
        return 0
    meant = begun or difflib.get_close_matches(asked, VERBS)
    hint = f"did you mean {' or '.join(meant)}? " if meant else ""
    print(f"error: there is no verb {asked!r}: {hint}{PROGRAM} --help lists all", file=sys.stderr)
    return 2


def split_ros(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Arguments of the command, and those of ROS: from ``--ros-args`` to ``--`` or the end."""
    parts: tuple[list[str], list[str]] = [], []
    inside = False
    for word in arguments:
        inside |= word == "--ros-args"
        parts[inside].append(word)
        inside &= word != "--"
    return parts


def _warn_once() -> None:
    """Say each warning once, in a line.

    The filter "once" would not do: what it remembers is a module's, and is forgotten whenever any
    library changes the filters. Whether such a gear can be built is not said at each command, but
    where a file is made or checked: ``rig make`` and ``parameters --check`` ask for it.
    """
    said: set[str] = set()

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        text = f"warning: {message}"
        if text not in said:
            said.add(text)
            print(text, file=sys.stderr)

    warnings.simplefilter("ignore", ParameterWarning)
    warnings.showwarning = show


def executable() -> int:
    """``ros2 run herringbone_sim NAME``: the verb that the executable is called after."""
    name = Path(sys.argv[0]).name
    return main([EXECUTABLES.get(name, name), *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
