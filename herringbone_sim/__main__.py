"""Entry point of ``python -m herringbone_sim VERB ...`` and of ``ros2 run``."""

from __future__ import annotations

import difflib
import os
import sys
import warnings
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Any

# The matrices here are small: threads of the linear algebra library would only wait.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from herringbone_sim.cli.verbs import PROGRAM, VERBS, greeting, overview
from herringbone_sim.core.parameters import ParameterWarning
from herringbone_sim.errors import HerringboneError
from herringbone_sim.version import VERSION

EXECUTABLES = {"simulator": "run"}  # name for ``ros2 run`` -> verb, where they differ
HELP = {"-h", "--help"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb that the arguments name and return the exit code.

    A wrong argument, or input or output that can't be used, gives one line on stderr and 2;
    Ctrl-C gives 130. If the reader of the output has closed it, as ``head`` does, the command ends
    silently with 1.

    Args:
        argv: words after the name of the program; None for those of ``sys.argv``.
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
    """Redirect stdout to the null device, so that the interpreter's flush at exit can't fail."""
    if sys.__stdout__ is not None and sys.stdout is sys.__stdout__:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.__stdout__.fileno())
        os.close(nowhere)


def _run(argv: Sequence[str] | None) -> int:
    arguments = list(sys.argv[1:] if argv is None else argv)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # File names and contents may have characters that the terminal can't encode.
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
    """Print the greeting, the list of verbs or the version, without importing a verb.

    Returns the exit code: 0, or for an unknown verb 2 after an error on stderr.
    """
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
    """Split arguments into those of the command and those of ROS.

    Those of ROS go from ``--ros-args`` to ``--``, both included, or to the end.
    """
    parts: tuple[list[str], list[str]] = [], []
    inside = False
    for word in arguments:
        inside |= word == "--ros-args"
        parts[inside].append(word)
        inside &= word != "--"
    return parts


def _warn_once() -> None:
    """Print each warning once, on one line of stderr, and suppress ``ParameterWarning``.

    The filter "once" is not enough: Python forgets the warnings shown before whenever a library
    changes the filters. Whether such a gear could be built and assembled is reported only where a
    file is made or checked, by ``rig make`` and ``parameters --check``.
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
    """Run the verb that an executable of ``ros2 run`` is named after; return its exit code."""
    name = Path(sys.argv[0]).name
    return main([EXECUTABLES.get(name, name), *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
