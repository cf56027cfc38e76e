"""The option ``--rerun [WHERE]`` of commands that mirror what they found."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from herringbone_sim.errors import ParameterError

FORMS = "spawn, connect[=HOST:PORT], serve[=[HOST:]PORT], save[=FILE.rrd]"
MODES = tuple(form.partition("[")[0] for form in FORMS.split(", "))


@dataclass(frozen=True)
class Where:
    """Mode of the mirror, address of a viewer, file to write."""

    mode: str
    address: str
    path: Path


def add_rerun_option(parser: argparse.ArgumentParser, plain: str, file: str) -> None:
    """Add the option; ``plain`` is its value when it stands alone, ``file`` where save writes."""
    parser.add_argument(
        "--rerun",
        nargs="?",
        const=plain,
        default="",
        metavar="WHERE",
        help=f"mirror to the Rerun viewer: {FORMS} [{plain}; save writes {file}]",
    )


def parse_where(text: str, file: Path) -> Where | None:
    """Where to mirror to; None when the option was not given.

    Raises:
        ParameterError: none of the forms.
    """
    if not text:
        return None
    mode, _, rest = text.partition("=")
    if mode not in MODES or (mode == "spawn" and rest):
        raise ParameterError(f"--rerun takes {FORMS}, got {text!r}")
    return Where(
        mode, "" if mode == "save" else rest, Path(rest) if mode == "save" and rest else file
    )
