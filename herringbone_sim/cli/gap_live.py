"""Listen to the topics of a rig and of the simulator while they run, and show where the rig
disagrees with the nominal model: the residual F - (k(t) f(x) + c v) mesh by mesh, recalibrated
inside the tolerances and over the floor of the noise, and its shares by mesh, kind, side, planet
and contact. Beside it the statistics of both motions: two chaotic motions never match, but their
forces and contacts do. Publishes /gap/residual, /gap/difference and /gap/place. In the example the
last two commands stand in terminals of their own; Ctrl-C ends it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from herringbone_sim.cli.arguments import Alone
from herringbone_sim.cli.options import FORMS, NO_ROS, File, flattened, limits, mirror_target
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import HerringboneError
from herringbone_sim.recording.parameter_file import load_parameters

EXAMPLES = """\
python -m herringbone_sim rig make --out rigs/pin --seed 7 \\
    --effect pin_position@all/2/all:offset=1.5e-5
python -m herringbone_sim replay rigs/pin/run_00 --publish --loop --speed 0.01 \\
    --node-name rig
python -m herringbone_sim gap live --rig /rig --noise 0.01
"""
Seconds = Annotated[float, "S", limits(gt=0.0)]
CLEAR = "\x1b[H\x1b[J"
Output = Callable[[Any, tuple[str, ...]], None]  # shows a comparison; topics with samples


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options: the topics to compare, and how often the comparison is shown."""

    rig: Annotated[str, "PREFIX", "prefix of the topics of the rig"] = "/rig"
    sim: Annotated[str, "PREFIX", "prefix of the topics of the simulator"] = "/herringbone_sim"
    nominal: Annotated[File | None, "parameters of the rig (default: the built-in ones)"] = None
    noise: Annotated[
        float | None,
        "SHARE",
        limits(gt=0.0, lt=1.0),
        "RMS of the noise over that of each channel (default: from the spectra, an upper bound)",
    ] = None
    every: Annotated[Seconds, "seconds between updates"] = 1.0
    log_every: Annotated[
        Seconds, "seconds between lines of a log, where the output is no terminal"
    ] = 5.0
    seconds: Annotated[Seconds, "duration"] = float("inf")
    rerun: Annotated[
        str | None,
        "[WHERE]",
        Alone("spawn"),
        f"mirror to the Rerun viewer: {FORMS} [spawn; save writes gap_live.rrd]",
    ] = None


def run(*, options: Options = Options()) -> int:
    """Compare rig and simulator until Ctrl-C or the time limit; exit code 0, 2 without ROS."""
    target = mirror_target(options.rerun, Path("gap_live.rrd"))
    try:
        from herringbone_sim.ros.gap_live import Plan, listen
    except ImportError as error:
        print(NO_ROS.format(error=error))
        return 2
    nominal = load_parameters(options.nominal) if options.nominal else Parameters()
    plan = Plan(options.rig, options.sim, nominal, options.noise, options.every, options.seconds)
    outputs = [table_printer() if sys.stdout.isatty() else line_printer(options.log_every)]
    mirror = None
    if target is not None:
        from herringbone_sim.views.mirror.live import LiveMirror

        mirror = LiveMirror(target)
        if mirror.state != "running":
            raise HerringboneError(f"--rerun {options.rerun}: mirror {mirror.state}")
        outputs.append(mirror.show)

    def show(picture: Any, topics: tuple[str, ...]) -> None:
        for output in outputs:
            output(picture, topics)

    try:
        return listen(plan, show)
    finally:
        if mirror is not None:
            print(mirror.close())


def table_printer() -> Output:
    """Return an output that clears the terminal and prints each comparison as a table."""
    from herringbone_sim.views.mirror.live_text import table

    def show(picture: Any, topics: tuple[str, ...]) -> None:
        print(f"{CLEAR}{table(picture)}{other_topics(picture, topics)}", flush=True)

    return show


def line_printer(every_s: float) -> Output:
    """Return an output that prints a comparison as one line, at most every ``every_s`` seconds.

    A comparison with a residual is printed at once if the line before had none.
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
    """Line on other topics with samples; empty once rig and simulator have sent some."""
    expected = {picture.rig.topic, picture.simulator.topic}
    others = [topic for topic in topics if topic not in expected]
    silent = picture.rig.age_s is None or picture.simulator.age_s is None
    return f"\n! there are samples on {', '.join(others)}" if silent and others else ""
