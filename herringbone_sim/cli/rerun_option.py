"""Option ``--rerun [WHERE]`` of verbs that send results to the Rerun viewer."""

from __future__ import annotations

import argparse
from pathlib import Path

from herringbone_sim.errors import ParameterError
from herringbone_sim.views.mirror.target import MirrorTarget

FORMS = "spawn, connect[=HOST:PORT], serve[=[HOST:]PORT], save[=FILE.rrd]"
MODES = tuple(form.partition("[")[0] for form in FORMS.split(", "))


def add_rerun_option(parser: argparse.ArgumentParser, default: str, file: str) -> None:
    """Add the option.

    Args:
        default: value of the option without an argument.
        file: name of the file that ``save`` writes, for the help.
    """
    parser.add_argument(
        "--rerun",
        nargs="?",
        const=default,
        default="",
        metavar="WHERE",
        help=f"mirror to the Rerun viewer: {FORMS} [{default}; save writes {file}]",
    )


def mirror_target(text: str, file: Path) -> MirrorTarget | None:
    """Target of the value of ``--rerun``; None if it is empty.

    Args:
        file: written by ``save`` without a name.

    Raises:
        ParameterError: a text of another form.
    """
    if not text:
        return None
    mode, _, rest = text.partition("=")
    if mode not in MODES or (mode == "spawn" and rest):
        raise ParameterError(f"--rerun takes {FORMS}, got {text!r}")
    return MirrorTarget(
        mode, "" if mode == "save" else rest, Path(rest) if mode == "save" and rest else file
    )
