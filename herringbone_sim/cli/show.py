"""``show``: draw a recording in the Rerun viewer, a .rrd file or a picture."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from herringbone_sim.cli.options import add_mesh, add_number, add_run
from herringbone_sim.errors import HerringboneError, ParameterError

DESCRIPTION = """\
Show a recorded run as the live mirror shows a running one: displacements and forces over time,
phase portrait, stroboscopic section, bifurcation over the parameter that was changed last,
contact states, parameters and events. Takes any rosbag2 MCAP bag with a `samples` topic, with any
subset of the channels.

Long runs are thinned: each of at most --blocks blocks shows its last --burst mesh cycles at full
rate, and all of its section points. Without parameters in the recording there is no backlash to
compare with; --nominal takes that of the nominal rig. A picture needs no screen.
"""
EXAMPLES = """\
python -m herringbone_sim run --ros-args -p record:=true -p record_name:=first
python -m herringbone_sim show runs/first
python -m herringbone_sim show runs/first --save first.rrd --screenshot first.png
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_run(parser)
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--spawn", action="store_true", help="open a viewer (the default)")
    where.add_argument("--save", type=Path, metavar="FILE.rrd", help="write a file for `rerun`")
    where.add_argument(
        "--serve",
        nargs="?",
        const="9876",
        metavar="[HOST:]PORT",
        help="wait for viewers of this machine at a port, 9876 by default, until Ctrl-C; HOST is "
        "0.0.0.0 for those of other machines too",
    )
    where.add_argument("--connect", metavar="HOST:PORT", help="send to a viewer that is open")
    add_drawing_options(parser)


def add_drawing_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the picture and of the thinning of long runs."""
    parser.add_argument("--screenshot", type=Path, metavar="PNG", help="also draw a picture")
    parser.add_argument(
        "--size", default="1400x900", metavar="WxH", help="of the picture [%(default)s]"
    )
    add_mesh(parser)
    parser.add_argument(
        "--nominal",
        action="store_true",
        help="scale and backlash of the nominal rig when the recording has no parameters",
    )
    add_number(parser, "--burst", 20, "mesh cycles of a block at full rate", "CYCLES")
    add_number(parser, "--blocks", 400, "largest number of blocks")


def run(args: argparse.Namespace) -> int:
    """Show the run; exit code 0, HerringboneError if the viewer did not take all of it."""
    size = parse_size(args.size)
    with tempfile.TemporaryDirectory() as folder:
        rrd = args.save or Path(folder) / "run.rrd"
        picture_only = args.screenshot and not (args.spawn or args.serve or args.connect)
        mirror_run(args, "save" if args.save or picture_only else mode_of(args), rrd)
        if args.screenshot:
            if not (args.save or picture_only):
                mirror_run(args, "save", rrd)
            draw(rrd, args.screenshot, size)
    return 0


def mode_of(args: argparse.Namespace) -> str:
    """Mode of the mirror that the options ask for."""
    return "serve" if args.serve else "connect" if args.connect else "spawn"


def mirror_run(args: argparse.Namespace, mode: str, rrd: Path) -> None:
    """Send a recording through the mirror; raises HerringboneError when that fails."""
    from herringbone_sim.recording.reader import read_recording
    from herringbone_sim.views.mirror.block import Drawing
    from herringbone_sim.views.mirror.mirror import RerunMirror
    from herringbone_sim.views.mirror.replay import prepare, replay_blocks
    from herringbone_sim.views.mirror.target import MirrorTarget

    recording = read_recording(args.run)
    replay = prepare(recording, args.nominal)
    mirror = RerunMirror(
        MirrorTarget(mode, args.connect or args.serve or "", rrd),
        Drawing(replay.layout, replay.scale, args.burst, args.mesh or ""),
        report=lambda text: print(f"warning: mirror {text}", file=sys.stderr),
    )
    for block in replay_blocks(recording, replay, args.burst, args.blocks):
        if not mirror.put(block, wait_s=60.0):
            raise HerringboneError(f"the viewer took no more of {args.run}: {mirror.state}")
    if mode == "serve":
        wait_for_interrupt(mirror.address)
    mirror.close(60.0)
    if mirror.state.startswith("failed"):
        raise HerringboneError(f"{args.run} was not shown: {mirror.state}")
    if mirror.dropped:
        raise HerringboneError(f"{mirror.dropped} blocks of {args.run} were not shown")
    if mode == "save" and args.save:
        print(f"wrote {rrd}")


def wait_for_interrupt(address: str) -> None:
    """Keep serving until Ctrl-C."""
    print(f"serving, open it with: rerun '{address}'    (Ctrl-C ends)", flush=True)
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        print()


def draw(rrd: Path, png: Path, size: tuple[int, int]) -> None:
    """Write a picture of a .rrd file."""
    from herringbone_sim.views.mirror.screenshot import take_screenshot

    take_screenshot(rrd, png, size)
    print(f"wrote {png}")


def parse_size(text: str) -> tuple[int, int]:
    """Width and height of ``WxH``; raises ParameterError."""
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise ParameterError(f"--size must read WxH, got {text!r}: try 1400x900")
    return int(width), int(height)
