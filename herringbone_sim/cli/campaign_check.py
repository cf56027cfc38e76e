"""Say what a campaign (a folder of runs with campaign.yaml) holds, run by run, what is odd about
it, and which observations a diagnosis could form of it: force_law (mesh by mesh, F against k(t)
f(x) + c v), torque_balance (accelerations against forces and torques), consistency (motion
sensors against one another) and trajectory (short windows of the motion, fitted to few sensors).
Nothing is diagnosed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from herringbone_sim.cli.options import File, Folder
from herringbone_sim.core.layout import QUANTITIES
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import listed
from herringbone_sim.gap.data.prepare import prepare
from herringbone_sim.gap.data.prepared import PreparedCampaign, PreparedRun
from herringbone_sim.gap.data.screen import Finding, finding_texts
from herringbone_sim.gap.feasible_observations import feasible_observations
from herringbone_sim.recording.campaign import read_campaign
from herringbone_sim.recording.importing.campaign import NOMINAL
from herringbone_sim.recording.load import iter_sample_blocks
from herringbone_sim.recording.parameter_file import load_parameters

EXAMPLES = """\
python -m herringbone_sim rig make --out rigs/pin --seed 7 \\
    --effect pin_position@all/2/all:offset=1.5e-5
python -m herringbone_sim campaign check rigs/pin
"""
NEEDS = {
    "force_law": "forces F with the displacements x of their meshes, or what gives these",
    "torque_balance": "displacements of all meshes, or rotations u of all bodies",
    "consistency": "more of x, v and u than the coordinates of the gear",
    "trajectory": "rotations u or accelerations a of both suns and the carrier, where neither of "
    "the first two can be formed",
}


def run(
    campaign: Annotated[Folder, "folder of runs"],
    /,
    *,
    nominal: Annotated[
        File | None,
        f"parameters of the rig (default: {NOMINAL} in the folder, else the nominal rig)",
    ] = None,
) -> int:
    """Print channels of the runs, findings and observations that can be formed; exit code 0."""
    beside = campaign / NOMINAL
    file = nominal or (beside if beside.is_file() else None)
    prepared = prepare(campaign, load_parameters(file) if file else Parameters())
    print(table(campaign, prepared))
    print(verdict(*feasible_observations(prepared)))
    return 0


def table(folder: Path, campaign: PreparedCampaign) -> str:
    """Text table, a row per run: role, mesh cycles, samples a cycle, usable channels, others."""
    titles = f"{'run':12s} {'role':9s} {'cycles':>8s} {'a cycle':>8s}"
    head = titles + "".join(f" {q:>6s}" for q in QUANTITIES) + "  others"
    paths = {run.path.name: run.path for run in read_campaign(folder).runs}
    return "\n".join([head, *(_line(run, paths[run.name]) for run in campaign.runs)])


def _line(run: PreparedRun, path: Path) -> str:
    recorded = [getattr(run, quantity).recorded for quantity in QUANTITIES]
    counts = (f"{int(there.sum())}/{len(there)}" for there in recorded)
    layout = run.model.layout
    known = {*layout.channels, *layout.channels_of("a"), *layout.channels_of("pin")}
    names, _ = next(iter_sample_blocks(path))
    return (
        f"{run.name:12s} {run.role:9s} {run.cycles:8.1f} {(len(run) - 1) / run.cycles:8.1f}"
        + "".join(f" {count:>6s}" for count in counts)
        + f"  {listed([n for n in names if n not in known or n in run.recorded_point])}"
    ).rstrip()


def verdict(observations: Sequence[str], findings: Sequence[Finding]) -> str:
    """Text with a line per observation (whether it can be formed) and per finding."""
    lines = [
        f"{name}: "
        + ("can be formed" if name in observations else f"not formed, it needs {needs}")
        for name, needs in NEEDS.items()
    ]
    if not observations:
        lines.append("a diagnosis of this campaign would name nothing")
    faults = finding_texts([f for f in findings if not f.limit])
    wrong = [f"to look at: {text}" for text in faults]
    return "\n".join([*lines, *wrong, *(f"open: {f.text}" for f in findings if f.limit)])
