"""The verbs with a line on each, and the texts printed without a verb."""

from __future__ import annotations

import contextlib
from pathlib import Path

from herringbone_sim.errors import HerringboneError
from herringbone_sim.version import VERSION

PROGRAM = "python -m herringbone_sim"
GROUPS = {
    "run a gear, record it, look at what it did": {
        "run": "start the simulator node (needs ROS 2, also from PyPI)",
        "demo": "do the main job once: run, steer, record, repeat, analyse",
        "info": "tell what a recorded run holds",
        "replay": "integrate a run again and compare every bit, or publish it",
        "show": "show a recorded run in the Rerun viewer, or draw a picture",
        "analyze": "tell the motion in recorded runs: period, exponent, spectrum",
        "recover": "make a run whole again that was cut off",
        "parameters": "list every parameter with unit, range and meaning",
    },
    "nonlinear dynamics": {
        "sweep": "draw a bifurcation diagram over a parameter",
        "map": "draw period, exponent and contact over two parameters",
        "exponents": "tell chaos from order, by every method at once",
        "orbits": "follow periodic orbits and name their boundaries",
        "basins": "tell coexisting motions apart, and what each attracts",
        "survival": "tell whether a real gear would show the motion from rest",
        "compare": "tell what moves between two gears",
        "control": "tell what it takes to make a gear run periodically",
    },
    "the paper": {
        "reproduce": "run its figures and statements again, tell which come out",
    },
    "what a rig has that the model lacks": {
        "rig effects": "list the effects that a rig may have",
        "rig make": "make recordings of a rig with an effect, to practise on",
        "campaign import": "make a campaign of CSV, Parquet, MAT, TDMS, HDF5, bag files",
        "campaign check": "tell what a campaign holds and what a diagnosis can form",
        "gap": "tell where a rig disagrees with the nominal model, and why",
        "gap plan": "tell which effects sensors would tell, before recording",
        "gap verify": "measure the verdict of a diagnosis on further runs",
        "gap live": "show residual and place while a rig runs (needs ROS 2)",
        "gap bench": "tell how often the diagnosis is right, on practice rigs",
        "gap calibrate": "fit what turns evidence into probabilities",
    },
}
VERBS = tuple(verb for group in GROUPS.values() for verb in group)

_GREETING = f"""\
herringbone_sim {VERSION}
A herringbone planetary gear, often chaotic: run and steered in real time, swept
over its parameters, and held against the recordings of a rig.

Four ways in{{where}}:

  ROS 2: run a gear, record it, and steer it from another terminal
    {PROGRAM} run --ros-args -p record:=true
    python -m herringbone_sim.examples.chaos_control

  Nonlinear dynamics: a bifurcation diagram; then orbits, basins, map
    {PROGRAM} sweep --over delta_T=0:100:200 --out diagram
    In Python: import herringbone_sim as hb

  The paper: its Fig. 5 again, with the statements about it
    {PROGRAM} reproduce --only A --compared 0 --out fig05

  A rig: which effect is in its recordings? `campaign import` reads your own
    {PROGRAM} rig make --out rigs/mine --hidden --seed 7
    {PROGRAM} gap rigs/mine --nominal config/rig.yaml --out gap
    The answer is in rigs/labels/mine.json

All verbs: {PROGRAM} --help; each has its own --help, which
ends with an example. More: README.md and docs/.
"""


def greeting() -> str:
    """Text of a call without a verb: four first commands, and the folder of their config files."""
    from herringbone_sim.cli.demo import config

    where = ""
    if not Path("config", "rig.yaml").exists():
        with contextlib.suppress(HerringboneError):  # installed without its share folder
            where = f"; config/ is in {Path(config('rig.yaml')).parents[1]}"
    return _GREETING.format(where=where).rstrip()


def overview(word: str = "") -> str:
    """List of the verbs in groups, each with a line on what it does.

    Args:
        word: beginning of the verbs to list; empty for all.
    """
    width = max(map(len, VERBS)) + 2
    lines = [f"usage: {PROGRAM} [--help] [--version] VERB ..."]
    for title, group in GROUPS.items():
        listed = [f"  {v:{width}s}{t}" for v, t in group.items() if v.startswith(word)]
        lines += ["", f"{title}:", *listed] if listed else []
    return "\n".join([*lines, "", "Each has its own --help, which ends with an example."])
