"""Show a recorded run as the live mirror shows a running one: displacements and forces over time,
phase portrait, stroboscopic section, bifurcation over the parameter that was changed last,
contact states, parameters and events. Takes any rosbag2 MCAP bag with a `samples` topic, with any
subset of the channels.

Long runs are thinned: each of at most --blocks blocks shows its last --burst mesh cycles at full
rate, and all of its section points. Without parameters in the recording there is no backlash to
compare with; --nominal takes that of the nominal rig. A picture needs no screen.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from herringbone_sim.cli.arguments import Alone
from herringbone_sim.cli.options import Count, Cycles, Mesh, Run, flattened, limits, one_of
from herringbone_sim.errors import HerringboneError, ParameterError

EXAMPLES = """\
python -m herringbone_sim run --ros-args -p record:=true -p record_name:=first
python -m herringbone_sim show runs/first
python -m herringbone_sim show runs/first --save first.rrd --screenshot first.png
"""
PORT = "9876"
TARGET = one_of("where, at most one of", least=0)


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options: where a run is shown, the picture, and the thinning of long runs."""

    spawn: Annotated[bool, TARGET, "open a viewer (the default)"] = False
    save: Annotated[Path | None, "FILE.rrd", TARGET, "write a file for `rerun`"] = None
    serve: Annotated[
        str | None,
        "[[HOST:]PORT]",
        Alone(PORT),
        TARGET,
        "wait for viewers of this machine at a port, 9876 by default, until Ctrl-C; HOST is "
        "0.0.0.0 for those of other machines too",
    ] = None
    connect: Annotated[str | None, "HOST:PORT", TARGET, "send to a viewer that is open"] = None
    screenshot: Annotated[Path | None, "PNG", "also draw a picture"] = None
    size: Annotated[str, "WxH", "of the picture"] = "1400x900"
    mesh: Mesh = None
    nominal: Annotated[
        bool, "scale and backlash of the nominal rig when the recording has no parameters"
    ] = False
    burst: Annotated[Cycles, "mesh cycles of a block at full rate"] = 20
    blocks: Annotated[Count, limits(gte=1), "largest number of blocks"] = 400


def run(run: Run, /, *, options: Options = Options()) -> int:
    """Show the run; exit code 0, HerringboneError if the viewer did not take all of it."""
    size, mode = parse_size(options.size), mode_of(options)
    with tempfile.TemporaryDirectory() as folder:
        rrd = options.save or Path(folder) / "run.rrd"
        mirror_run(run, options, mode, rrd)
        if options.screenshot:
            if mode != "save":
                mirror_run(run, options, "save", rrd)
            draw(rrd, options.screenshot, size)
    return 0


def mode_of(options: Options) -> str:
    """Mode of the mirror by the options: serve, connect, spawn or, for a picture alone, save."""
    if options.serve:
        return "serve"
    if options.connect or options.spawn:
        return "connect" if options.connect else "spawn"
    return "save" if options.save or options.screenshot else "spawn"


def mirror_run(run: Path, options: Options, mode: str, rrd: Path) -> None:
    """Send a recording through the mirror; HerringboneError if not all of it was shown.

    Args:
        mode: mode of ``MirrorTarget``.
        rrd: file to write in mode ``save``.
    """
    from herringbone_sim.recording.reader import read_recording
    from herringbone_sim.views.mirror.block import Drawing
    from herringbone_sim.views.mirror.mirror import RerunMirror
    from herringbone_sim.views.mirror.replay import prepare, replay_blocks
    from herringbone_sim.views.mirror.target import MirrorTarget

    recording = read_recording(run)
    address = options.connect or options.serve or ""
    replay = prepare(recording, options.nominal)
    mirror = RerunMirror(
        MirrorTarget(mode, address, rrd),
        Drawing(replay.layout, replay.scale, options.burst, options.mesh or ""),
        report=lambda text: print(f"warning: mirror {text}", file=sys.stderr),
    )
    for block in replay_blocks(recording, replay, options.burst, options.blocks):
        if not mirror.put(block, wait_s=60.0):
            raise HerringboneError(f"the viewer took no more of {run}: {mirror.state}")
    if mode == "serve":
        wait_for_interrupt(mirror.address)
    mirror.close(60.0)
    if mirror.state.startswith("failed"):
        raise HerringboneError(f"{run} was not shown: {mirror.state}")
    if mirror.dropped:
        raise HerringboneError(f"{mirror.dropped} blocks of {run} were not shown")
    if mode == "save" and options.save:
        print(f"wrote {rrd}")


def wait_for_interrupt(address: str) -> None:
    """Print the address that viewers can open, and wait until Ctrl-C."""
    print(f"serving, open it with: rerun '{address}'    (Ctrl-C ends)", flush=True)
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        print()


def draw(rrd: Path, png: Path, size: tuple[int, int]) -> None:
    """Write a PNG of a .rrd file, for a window of the given size (width, height)."""
    from herringbone_sim.views.mirror.screenshot import take_screenshot

    take_screenshot(rrd, png, size)
    print(f"wrote {png}")


def parse_size(text: str) -> tuple[int, int]:
    """Parse ``WxH`` into width and height; ParameterError for another form."""
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise ParameterError(f"--size must read WxH, got {text!r}: try 1400x900")
    return int(width), int(height)
