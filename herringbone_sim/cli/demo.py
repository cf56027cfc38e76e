"""All main steps in under two minutes: the node runs at real_time_factor 1 in its own
process with the paper's parameters in chaos; a control experiment in another process raises K over
ROS topics until the motion has period 1, and lowers it again; the run is recorded and mirrored;
it is repeated to the bit, drawn by the real Rerun viewer, and analysed into figures and a report.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated

from herringbone_sim.cli.options import Folder
from herringbone_sim.errors import HerringboneError, RecordingError

EXAMPLES = """\
python -m herringbone_sim demo --out demo
"""

NODE_WAIT_S = 60.0
NODE_END_S = 30.0


def run(
    *,
    out: Annotated[Folder, "folder to write to"] = Path("demo"),
    force: Annotated[bool, "replace the folder if it is there"] = False,
) -> int:
    """Run all steps of the demo; exit code 0, HerringboneError if one fails or ``out`` exists."""
    out = out.resolve()
    if Path.cwd().is_relative_to(out):
        raise RecordingError(f"{out} is where you are, or above it: name another --out")
    if out.exists() and not force:
        raise RecordingError(f"{out} is there already: name another --out, or give --force")
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    run = out / "runs" / "demo"
    began = time.monotonic()
    experiment(out, run)
    verb("info", str(run))
    verb("replay", str(run), "--verify")
    if verb(
        "show",
        str(run),
        "--save",
        str(out / "demo.rrd"),
        "--screenshot",
        str(out / "rerun.png"),
        check=False,
    ):
        heading("the picture of the viewer is left out: see the line above")
    verb("analyze", str(run), "--out", str(out / "analysis"))
    heading(f"done in {time.monotonic() - began:.0f} s")
    for name in ("analysis/report.html", "rerun.png", "demo.rrd", "live.rrd", "runs/demo"):
        if (out / name).exists():
            print(f"  {out / name}")
    return 0


def experiment(out: Path, run: Path) -> None:
    """Run node and control experiment, each as a process; HerringboneError if one fails.

    Args:
        out: folder of the demo.
        run: folder of the recording.
    """
    heading("starting the node (real_time_factor 1, recording, mirroring to live.rrd)")
    overrides = {
        "record": "true",
        "record_dir": quoted(run.parent),
        "record_name": run.name,
        "mirror": "save",
        "mirror_path": quoted(out / "live.rrd"),
        "delta_T": "50.0",
        "xi": "0.1",
    }
    node = subprocess.Popen(
        [*python("herringbone_sim"), "run", "--ros-args", "--params-file", config("paper.yaml")]
        + [word for k, v in overrides.items() for word in ("-p", f"{k}:={v}")]
    )
    try:
        wait_for(run, node)
        heading("steering it from another process: raise K to period 1, and lower it again")
        options = ["-p", "wanted:=P1", "-p", "step:=0.02", "-p", "dwell:=0.3"]
        subprocess.run(
            [*python("herringbone_sim.examples.chaos_control"), "--ros-args", *options],
            check=True,
            timeout=90.0,
        )
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        raise HerringboneError(f"the control experiment failed: {error}") from error
    finally:
        node.send_signal(signal.SIGINT)
        try:
            node.wait(NODE_END_S)
        except subprocess.TimeoutExpired:
            node.kill()
            heading(f"the node did not end within {NODE_END_S:g} s, and was killed")


def quoted(path: Path) -> str:
    """Path as a text in YAML, as which ROS reads values, whatever is in it."""
    return json.dumps(str(path), ensure_ascii=False)


def wait_for(run: Path, node: subprocess.Popen[bytes]) -> None:
    """Wait until the run folder exists; HerringboneError if the node ends, or after 60 s."""
    limit = time.monotonic() + NODE_WAIT_S
    while not run.exists():
        if node.poll() is not None or time.monotonic() > limit:
            raise HerringboneError("the node did not start: see its lines above")
        time.sleep(0.1)


def verb(name: str, *arguments: str, check: bool = True) -> int:
    """Run a verb as a process, return its exit code; with ``check``, HerringboneError unless 0."""
    heading(f"{name} {' '.join(arguments)}")
    code = subprocess.run([*python("herringbone_sim"), name, *arguments], check=False).returncode
    if check and code:
        raise HerringboneError(f"{name} ended with exit code {code}: see its lines above")
    return code


def python(module: str) -> list[str]:
    """Command line that runs a module with this interpreter, user warnings ignored."""
    return [sys.executable, "-W", "ignore::UserWarning", "-m", module]


def config(name: str) -> str:
    """Path of a file in config/, beside the package or installed; HerringboneError if missing."""
    root = Path(__file__).parents[2]
    places = [root / "config", Path(sys.prefix) / "share/herringbone_sim/config"]
    places += [p / "share/herringbone_sim/config" for p in Path(__file__).parents]
    for place in places:
        if (place / name).exists():
            return str(place / name)
    raise HerringboneError(f"{name} is in none of {', '.join(map(str, places))}")


def heading(text: str) -> None:
    """Print a heading between the outputs of the steps."""
    print(f"\n== {text}", flush=True)
