"""``python -m herringbone_sim``: one command, many verbs."""

from __future__ import annotations

import argparse
import difflib
import importlib
import os
import sys
import warnings
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Any

# Matrices here are small: threads of a linear algebra library only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from herringbone_sim.cli.verbs import PROGRAM, VERBS, add_verb, greeting, overview
from herringbone_sim.core.parameters import ParameterWarning
from herringbone_sim.errors import HerringboneError
from herringbone_sim.version import VERSION

EXECUTABLES = {"simulator": "run"}  # name for ``ros2 run`` -> verb, where they differ


def parser(verbs: Sequence[str] = VERBS) -> argparse.ArgumentParser:
    """The command line; a verb's module is in ``herringbone_sim.cli``, its words joined by _.

    A module has the parts of the help ``DESCRIPTION`` and ``EXAMPLES``, ``add_options`` and
    ``run``.
    """
    result = argparse.ArgumentParser(prog=PROGRAM)
    subparsers = result.add_subparsers(required=True, metavar="VERB")
    for verb in verbs:
        module = importlib.import_module(f"herringbone_sim.cli.{verb.replace(' ', '_')}")
        added = add_verb(subparsers, verb, module.DESCRIPTION, module.EXAMPLES)
        module.add_options(added)
        added.set_defaults(func=module.run)
    return result


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
    if " ".join(arguments[:2]) in VERBS:
        arguments[:2] = [" ".join(arguments[:2])]
    if not arguments or arguments[0] not in VERBS:
        return _without_verb(arguments)
    own, of_ros = split_ros(arguments)
    args, unknown = parser(arguments[:1]).parse_known_args(own)
    takes_ros = hasattr(args, "of_ros")
    if not takes_ros:
        unknown += of_ros
    if unknown:
        hint = "what is for ROS follows --ros-args" if takes_ros else "see --help"
        print(f"error: unknown arguments {' '.join(unknown)}: {hint}", file=sys.stderr)
        return 2
    args.of_ros = of_ros
    with warnings.catch_warnings():
        _warn_once()
        try:
            return int(args.func(args))
        except HerringboneError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            return 130


def _without_verb(arguments: Sequence[str]) -> int:
    """Greet, list the verbs or tell the version, without importing any; 2 for what is none."""
    asked = arguments[0] if arguments else ""
    if asked in ("", "-h", "--help", "--version"):
        print(VERSION if asked == "--version" else overview() if asked else greeting())
        return 0
    begun = [verb for verb in VERBS if verb.startswith(f"{asked} ")]
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
