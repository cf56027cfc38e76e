"""``parameters``: every parameter with its unit, default, range and meaning."""

from __future__ import annotations

import argparse
import math

from herringbone_sim.core.parameters import Parameters, meaning, names


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``parameters``."""
    parser = subparsers.add_parser(
        "parameters",
        help="list every parameter of the model with unit, range and meaning",
        description="List every parameter of the model: name, default, unit, range or choices, "
        "meaning with its equation in the paper. A star marks those that may change while the "
        "node runs; the others are set in a parameter file such as config/rig.yaml. Those of the "
        "node itself (real_time_factor, record, mirror, ...) are in docs/ros2.md.",
    )
    parser.set_defaults(func=show)


def show(_: argparse.Namespace) -> int:
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
