"""``python -m herringbone_sim``: one command, many verbs."""

from __future__ import annotations

import argparse
import importlib
import sys
import warnings
from collections.abc import Sequence
from typing import Any

from herringbone_sim.core.parameters import ParameterWarning
from herringbone_sim.errors import HerringboneError
from herringbone_sim.version import VERSION

VERBS = (
    "run",
    "demo",
    "analyze",
    "replay",
    "recover",
    "info",
    "show",
    "parameters",
    "gap",
    "gap verify",
    "gap bench",
    "gap live",
    "rig",
    "sweep",
    "map",
    "orbits",
    "exponents",
    "basins",
    "survival",
    "reproduce",
    "control",
)

DESCRIPTION = """\
Herringbone planetary gear dynamics: stream, steer, record, mirror, replay, analyse.

Start with `demo`, which does it all once; every verb has its own --help.
"""


def parser(verbs: Sequence[str] = VERBS) -> argparse.ArgumentParser:
    """The command line; a verb's module is in ``herringbone_sim.cli``, its words joined by _."""
    result = argparse.ArgumentParser(
        prog="python -m herringbone_sim",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    result.add_argument("--version", action="version", version=VERSION)
    subparsers = result.add_subparsers(title="verbs", required=True, metavar="VERB")
    for verb in verbs:
        module = importlib.import_module(f"herringbone_sim.cli.{verb.replace(' ', '_')}")
        module.add_parser(subparsers)
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the verb: 2 with one clear line when the input is wrong."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if " ".join(arguments[:2]) in VERBS:
        arguments[:2] = [" ".join(arguments[:2])]
    asked = arguments[:1]
    if not asked:
        parser().print_help()
        return 2
    commands = parser(asked if asked and asked[0] in VERBS else VERBS)
    args, rest = commands.parse_known_args(arguments)
    if rest and not (hasattr(args, "rest") and rest[0] == "--ros-args"):
        hint = "ROS arguments follow --ros-args" if hasattr(args, "rest") else "see --help"
        commands.error(f"unknown arguments {' '.join(rest)}: {hint}")
    args.rest = rest
    with warnings.catch_warnings():
        _warn_once()
        try:
            return int(args.func(args))
        except HerringboneError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            return 130


def _warn_once() -> None:
    """Say each warning once, in a line.

    The filter "once" would not do: what it remembers is a module's, and is forgotten whenever any
    library changes the filters.
    """
    said: set[str] = set()

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        text = f"warning: {message}"
        if text not in said:
            said.add(text)
            print(text, file=sys.stderr)

    warnings.simplefilter("always", ParameterWarning)
    warnings.showwarning = show


def gap() -> int:
    """``ros2 run herringbone_sim gap``."""
    return main(["gap", *sys.argv[1:]])


def analyze() -> int:
    """``ros2 run herringbone_sim analyze``."""
    return main(["analyze", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
