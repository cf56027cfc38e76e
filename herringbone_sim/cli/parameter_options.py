"""``--parameters FILE --set NAME=VALUE``: the gear of a verb."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from herringbone_sim.core.parameters import Parameters, meaning
from herringbone_sim.effects.effect import Active
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import load_gear, load_parameters


def add_parameter_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--parameters`` and ``--set``; ``parameters_from`` reads them."""
    parser.add_argument(
        "--parameters",
        type=Path,
        metavar="FILE",
        help="parameter file, such as config/paper.yaml (default: the nominal rig)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="change a parameter, once or more; a list has commas: k_amp=0.25,0.1",
    )


def parameters_from(args: argparse.Namespace) -> Parameters:
    """Parameters of the file, changed by what was set.

    Raises:
        ParameterError: no such file, no such name, or a set that no gear can have.
    """
    base = load_parameters(args.parameters) if args.parameters else Parameters()
    return base.changed(settings(args.set))


def gear_from(args: argparse.Namespace) -> tuple[Parameters, tuple[Active, ...]]:
    """Parameters as ``parameters_from``, and the effects that the file holds.

    Raises:
        ParameterError: as there, or an effect that there is not.
    """
    base, actives = load_gear(args.parameters) if args.parameters else (Parameters(), ())
    return base.changed(settings(args.set)), actives


def settings(texts: Sequence[str]) -> dict[str, Any]:
    """Values by name from texts ``NAME=VALUE``; the last of a name counts.

    Raises:
        ParameterError: a text of another form, or an unknown name.
    """
    return dict(_setting(text) for text in texts)


def _setting(text: str) -> tuple[str, Any]:
    name, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not value:
        raise ParameterError(f"--set takes NAME=VALUE, got {text!r}: write it like delta_T=20")
    meaning(name)
    if isinstance(getattr(Parameters, name), tuple):
        return name, [number(part) for part in value.strip("[]").split(",") if part.strip()]
    return name, number(value)


def number(text: str) -> float | int | str:
    """A text as an integer, a float, or itself."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text.strip()
