"""``gap live``: residual of a running rig by mesh, beside its simulator."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from herringbone_sim.cli.options import (
    NO_ROS,
    add_file,
    add_number,
    add_rerun_option,
    mirror_target,
)
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import load_parameters

DESCRIPTION = """\
Listen to the topics of a rig and of the simulator while they run, and show where the rig
disagrees with the nominal model: the residual F - (k(t) f(x) + c v) mesh by mesh, recalibrated
inside the tolerances and over the floor of the noise, and its shares by mesh, kind, side, planet
and contact. Beside it the statistics of both motions: two chaotic motions never match, but their
forces and contacts do. Publishes /gap/residual, /gap/difference and /gap/place. In the example the
last two commands stand in terminals of their own; Ctrl-C ends it.
"""
EXAMPLES = """\
python -m herringbone_sim rig make --out rigs/pin --seed 7 \\
    --effect pin_position@all/2/all:offset=1.5e-5
python -m herringbone_sim replay rigs/pin/run_00 --publish --loop --speed 0.01 \\
    --node-name rig
python -m herringbone_sim gap live --rig /rig --noise 0.01
"""
CLEAR = "\x1b[H\x1b[J"
Output = Callable[[Any, tuple[str, ...]], None]  # of a comparison and the topics with samples


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    for option, default, source in (
        ("--rig", "/rig", "rig"),
        ("--sim", "/herringbone_sim", "simulator"),
    ):
        text = f"prefix of the topics of the {source} [%(default)s]"
        parser.add_argument(option, default=default, metavar="PREFIX", help=text)
    add_file(parser, "--nominal", "parameters of the rig [the built-in ones]")
    text = "RMS of the noise over that of each channel [from the spectra: an upper bound]"
    parser.add_argument("--noise", type=float, metavar="SHARE", help=text)
    add_number(parser, "--every", 1.0, "seconds between updates", "S")
    text = "seconds between lines of a log, where the output is no terminal"
    add_number(parser, "--log-every", 5.0, text, "S")
    add_number(parser, "--seconds", float("inf"), "duration", "S")
    add_rerun_option(parser, "spawn", "gap_live.rrd")


def run(args: argparse.Namespace) -> int:
    """Listen and print until Ctrl-C or the end of the time; exit code 0, 2 without ROS."""
    check_numbers(args)
    target = mirror_target(args.rerun, Path("gap_live.rrd"))
    try:
        from herringbone_sim.ros.gap_live import Plan, listen
    except ImportError as error:
        print(NO_ROS.format(error=error))
        return 2
    nominal = load_parameters(args.nominal) if args.nominal else Parameters()
    plan = Plan(args.rig, args.sim, nominal, args.noise, args.every, args.seconds)
    outputs = [table_printer() if sys.stdout.isatty() else line_printer(args.log_every)]
    mirror = None
    if target is not None:
        from herringbone_sim.views.mirror.live import LiveMirror

        mirror = LiveMirror(target)
        outputs.append(mirror.show)

    def show(picture: Any, topics: tuple[str, ...]) -> None:
        for output in outputs:
            output(picture, topics)

    try:
        return listen(plan, show)
    finally:
        if mirror is not None:
            print(mirror.close())


def check_numbers(args: argparse.Namespace) -> None:
    """ParameterError if a number is out of range."""
    for name in ("every", "log_every", "seconds"):
        if not getattr(args, name) > 0.0:
            option = name.replace("_", "-")
            raise ParameterError(f"--{option} must be positive, got {getattr(args, name)!r}")
    if args.noise is not None and not 0.0 < args.noise < 1.0:
        raise ParameterError(f"--noise must be a share between 0 and 1, got {args.noise!r}")


def table_printer() -> Output:
    """Output that prints each comparison as a table in the place of the one before."""
    from herringbone_sim.views.mirror.live_text import table

    def show(picture: Any, topics: tuple[str, ...]) -> None:
        print(f"{CLEAR}{table(picture)}{other_topics(picture, topics)}", flush=True)

    return show


def line_printer(every_s: float) -> Output:
    """Output that prints a comparison as one line, at most every ``every_s`` seconds.

    The first comparison with a residual, also after one was lost, is printed at once.
    """
    from herringbone_sim.views.mirror.live_text import line

    printed_at, had_residual = -every_s, False

    def show(picture: Any, topics: tuple[str, ...]) -> None:
        nonlocal printed_at, had_residual
        now = time.monotonic()
        first = picture.residual is not None and not had_residual
        if first or now - printed_at >= every_s:
            printed_at, had_residual = now, picture.residual is not None
            print(f"{line(picture)}{other_topics(picture, topics)}", flush=True)

    return show


def other_topics(picture: Any, topics: tuple[str, ...]) -> str:
    """Line on other topics with samples; empty unless the rig or the simulator is silent."""
    expected = {picture.rig.topic, picture.simulator.topic}
    others = [topic for topic in topics if topic not in expected]
    silent = picture.rig.age_s is None or picture.simulator.age_s is None
    return f"\n! there are samples on {', '.join(others)}" if silent and others else ""
