"""``gap live``: residual and place of a rig that runs, beside its simulator."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from herringbone_sim.cli.rerun_option import add_rerun_option, parse_where
from herringbone_sim.cli.verbs import add_verb
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


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``gap live``."""
    parser = add_verb(subparsers, "gap live", DESCRIPTION, EXAMPLES)
    parser.add_argument(
        "--rig", default="/rig", metavar="PREFIX", help="of the rig's topics [%(default)s]"
    )
    parser.add_argument(
        "--sim",
        default="/herringbone_sim",
        metavar="PREFIX",
        help="of the simulator's topics [%(default)s]",
    )
    parser.add_argument(
        "--nominal", type=Path, metavar="FILE", help="parameters of the rig [the built-in ones]"
    )
    parser.add_argument(
        "--noise",
        type=float,
        metavar="SHARE",
        help="RMS of the noise over that of each channel [from the spectra: an upper bound]",
    )
    parser.add_argument(
        "--every", type=float, default=1.0, metavar="S", help="between looks [%(default)s]"
    )
    parser.add_argument(
        "--log-every",
        type=float,
        default=5.0,
        metavar="S",
        help="between lines of a log, where the output is no terminal [%(default)s]",
    )
    parser.add_argument(
        "--seconds", type=float, default=float("inf"), metavar="S", help="to end after [never]"
    )
    add_rerun_option(parser, "spawn", "gap_live.rrd")
    parser.set_defaults(func=gap_live)


def gap_live(args: argparse.Namespace) -> int:
    """Exit code 0 on Ctrl-C or when the time is over; 2 without ROS."""
    check_numbers(args)
    where = parse_where(args.rerun, Path("gap_live.rrd"))
    try:
        from herringbone_sim.ros.gap_live import Plan, listen
    except ImportError as error:
        print(
            f"no ROS 2 here ({error}): source /opt/ros/jazzy/setup.bash, or "
            "pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces"
        )
        return 2
    nominal = load_parameters(args.nominal) if args.nominal else Parameters()
    plan = Plan(args.rig, args.sim, nominal, args.noise, args.every, args.seconds)
    showers = [in_place() if sys.stdout.isatty() else as_log(args.log_every)]
    mirror = None
    if where is not None:
        from herringbone_sim.views.mirror.live import LiveMirror

        mirror = LiveMirror(where.mode, where.address, where.path)
        showers.append(mirror.show)

    def show(picture: Any, topics: tuple[str, ...]) -> None:
        for one in showers:
            one(picture, topics)

    try:
        return listen(plan, show)
    finally:
        if mirror is not None:
            print(mirror.close())


def check_numbers(args: argparse.Namespace) -> None:
    """Refuse what can't be; raises ParameterError."""
    for name in ("every", "log_every", "seconds"):
        if not getattr(args, name) > 0.0:
            option = name.replace("_", "-")
            raise ParameterError(f"--{option} must be positive, got {getattr(args, name)!r}")
    if args.noise is not None and not 0.0 < args.noise < 1.0:
        raise ParameterError(f"--noise must be a share between 0 and 1, got {args.noise!r}")


def in_place() -> Callable[[Any, tuple[str, ...]], None]:
    """Draws the table over the one before."""
    from herringbone_sim.views.mirror.live_text import table

    def show(picture: Any, topics: tuple[str, ...]) -> None:
        print(f"{CLEAR}{table(picture)}{heard_elsewhere(picture, topics)}", flush=True)

    return show


def as_log(every_s: float) -> Callable[[Any, tuple[str, ...]], None]:
    """Prints a line from time to time, the first when there is a residual."""
    from herringbone_sim.views.mirror.live_text import line

    said_at, known = -every_s, False

    def show(picture: Any, topics: tuple[str, ...]) -> None:
        nonlocal said_at, known
        now = time.monotonic()
        news = picture.residual is not None and not known
        if news or now - said_at >= every_s:
            said_at, known = now, picture.residual is not None
            print(f"{line(picture)}{heard_elsewhere(picture, topics)}", flush=True)

    return show


def heard_elsewhere(picture: Any, topics: tuple[str, ...]) -> str:
    """Topics of samples that nobody listens to, as long as one that was asked for is silent."""
    asked = {picture.rig.topic, picture.simulator.topic}
    others = [topic for topic in topics if topic not in asked]
    silent = picture.rig.age_s is None or picture.simulator.age_s is None
    return f"\n! samples there are on {', '.join(others)}" if silent and others else ""
