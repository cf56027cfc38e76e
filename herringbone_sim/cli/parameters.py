"""``parameters``: every parameter with its unit, default, range and meaning."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters, meaning, names, obstacle_text, obstacles
from herringbone_sim.effects.sensors import check_effects
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.node_parameters import gear_of_node

DESCRIPTION = """\
List every parameter of the model: name, default, unit, range or choices, meaning with its equation
in the paper. A star marks those that may change while the node runs; the others are set in a
parameter file such as config/rig.yaml. Those of the node itself (real_time_factor, record,
mirror, ...) are in docs/ros2.md.
"""
EXAMPLES = """\
python -m herringbone_sim parameters
python -m herringbone_sim parameters --check config/rig.yaml
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``parameters``."""
    parser = add_verb(subparsers, "parameters", DESCRIPTION, EXAMPLES)
    parser.add_argument(
        "--check",
        type=Path,
        metavar="FILE",
        help="instead: read a parameter file, say what gear it is, and what is odd about it",
    )
    parser.set_defaults(func=parameters)


def parameters(args: argparse.Namespace) -> int:
    """Exit code 0; a file that no gear can have is an error."""
    return check(args.check) if args.check else show()


def check(file: Path) -> int:
    """Say what gear a node has that is started with a file, and of what it would warn.

    Raises:
        ParameterError: a file that can't be read, or one that no model can be made of.
    """
    p, actives, warnings = gear_of_node(file)
    try:
        check_effects(build(p), actives)
    except ParameterError as error:
        raise ParameterError(f"{file}: {error}") from None
    teeth = f"{p.z_s}, {p.z_p} and {p.z_r} teeth"
    effects = f", with {effects_text(actives)}" if actives else ""
    print(f"{file}: {p.model} model, {p.n_planets} planets, {teeth}{effects}")
    for warning in warnings:
        print(f"note: {warning}")
    for rule in obstacles(p):
        print(f"note: {obstacle_text(rule)}")
    return 0


def show() -> int:
    """Print the table; a star marks what may change while the model runs."""
    for name in names():
        about = meaning(name)
        default = Parameters.__dataclass_fields__[name].default
        shown = list(default) if isinstance(default, tuple) else default
        limits = ", ".join(about.choices)
        if math.isfinite(about.low):
            limits = f"{about.low:g} .. {about.high:g}"
        star = "*" if about.live else " "
        print(f"{star} {name:18s} {shown!s:22s} {about.unit:12s} {limits}\n    {about.text}")
    return 0
