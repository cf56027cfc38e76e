"""Options ``--parameters``, ``--set`` and ``--effects``: the gear that a verb works on."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from herringbone_sim.cli.options import add_file
from herringbone_sim.core.mirror import has_equal_halves
from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters, meaning
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import effects_text, number, read_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import load_gear

UNEQUAL_HALVES = (
    "left and right of this gear are not alike: both are integrated, and there are no exponents "
    "within symmetry and across it"
)


def add_parameter_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--parameters``, ``--set`` and ``--effects``; ``gear_from`` reads them."""
    text = "parameter file, such as config/paper.yaml (default: the nominal rig)"
    add_file(parser, "--parameters", text)
    add_set_option(parser)
    add_effects_option(parser)


def add_set_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--set``; ``settings`` reads it."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="change a parameter, once or more; a list has commas: k_amp=0.25,0.1",
    )


def add_effects_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--effects``; ``effects_from`` reads it."""
    parser.add_argument(
        "--effects",
        metavar="TEXT",
        help="effects of the gear, instead of those in the file, such as "
        "'tooth_crack@sp/all/L:depth=0.3; runout@rp:amplitude=2e-5,member=ring'; '' for none",
    )


def gear_from(args: argparse.Namespace) -> tuple[Parameters, tuple[Active, ...]]:
    """Parameters of the file changed by ``--set``; effects of the option, else of the file.

    Raises:
        ParameterError: no such file, name or effect, or a value out of range.
    """
    base, actives = load_gear(args.parameters) if args.parameters else (Parameters(), ())
    return base.changed(settings(args.set)), effects_from(args, actives)


def effects_from(args: argparse.Namespace, of_file: tuple[Active, ...]) -> tuple[Active, ...]:
    """Effects of ``--effects``, else those of the file; ParameterError for an unknown effect."""
    return of_file if args.effects is None else read_effects(args.effects)


def model_from(args: argparse.Namespace) -> Model:
    """Model of the gear of ``gear_from``; ParameterError if it can't be built."""
    return build_with(*gear_from(args))


def print_gear_notes(model: Model) -> None:
    """Print the effects of a gear, and a line if its halves differ: there are no transverse
    exponents then."""
    if model.effects:
        print(f"with effects: {effects_text(model.effects)}")
    if not has_equal_halves(model):
        print(UNEQUAL_HALVES)


def settings(texts: Sequence[str]) -> dict[str, Any]:
    """Values by name from texts ``NAME=VALUE``; of a repeated name the last one.

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
