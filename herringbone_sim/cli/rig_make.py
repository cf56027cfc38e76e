"""Write a campaign (runs as bags, campaign.yaml) of a gear that differs from the nominal one by
its tolerance and by effects, and its label to another folder.

An effect is ID, ID@MESH/PLANET/SIDE or ID@MESH/PLANET/SIDE:NAME=VALUE,...; what is left out of
the place is all, what is left out of the values has its start value; several channels of a sensor
stand as channels=F_sp1_L+F_sp2_L. `rig effects` lists all.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from herringbone_sim.cli.options import Count, File, Folder, Names, flattened, limits
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import obstacle_text, obstacles
from herringbone_sim.effects.written import parse_effect
from herringbone_sim.errors import ParameterError, RecordingError
from herringbone_sim.recording.hidden_effects import hidden_effects
from herringbone_sim.recording.parameter_file import gear_parts
from herringbone_sim.recording.rig import RigPlan, make_campaign, write_label

EXAMPLES = """\
python -m herringbone_sim rig make --out rigs/ripple --effect runout@rp:amplitude=2e-5,member=ring
python -m herringbone_sim rig make --out rigs/mine --hidden --seed 7
"""


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options: the rig, its runs and sensors."""

    out: Annotated[Folder, "campaign to write"]
    labels: Annotated[
        Folder | None, "folder of labels (default: 'labels' beside the campaign's folder)"
    ] = None
    parameters: Annotated[File | None, "nominal gear (default: the nominal rig)"] = None
    effect: Annotated[tuple[str, ...], "TEXT", "once or more, see above"] = ()
    hidden: Annotated[bool, "draw the effects by the seed"] = False
    runs: Annotated[Count, "runs"] = 8
    held_out: Annotated[Count, "of them, of role held_out"] = 3
    cycles: Annotated[Count, limits(gte=1), "mesh cycles of a run"] = 120
    snr: Annotated[
        float, "DB", limits(gt=-200, lt=1000), "signal-to-noise ratio of every channel"
    ] = 40.0
    bits: Annotated[Count, "of the converter; 0: none"] = 16
    tolerance: Annotated[float, "SHARE", limits(gte=0, lt=1), "of the parameters, as a share"] = (
        0.02
    )
    seed: Annotated[Count, "of all random numbers"] = 0
    later: Annotated[
        Count,
        "index of further runs of the rig of that seed, at other operating points: 1, 2, ...",
    ] = 0
    channels: Annotated[
        Names, "channels that the rig has sensors for, such as u_s_L,u_s_R,u_c (default: all)"
    ] = ()


def run(*, options: Options) -> int:
    """Write the campaign and its label, print the hash of the label; exit code 0.

    Raises:
        ParameterError: effects beside --hidden, or no such effect.
        RecordingError: labels inside the campaign.
    """
    file, out = options.parameters, options.out
    nominal, written = gear_parts(file)
    nominal = nominal.changed({"model": "full", "samples_per_cycle": 24})
    actives = (*written, *(parse_effect(text) for text in options.effect))
    if options.hidden and actives:
        raise ParameterError("either --hidden or effects of one's own: leave one out")
    if options.hidden:
        actives = hidden_effects(options.seed, build(nominal))
    place = Path(os.path.abspath(out))
    name, labels = place.name, options.labels or place.parent / "labels"
    of_labels = Path(os.path.abspath(labels))
    if place in (of_labels, *of_labels.parents):
        raise RecordingError(f"labels must lie outside the campaign, got {labels}: set --labels")
    if (of_labels / f"{name}.json").exists():
        raise RecordingError(
            f"{labels / name}.json exists, and a label is never overwritten: set --labels or --out"
        )
    plan = RigPlan(
        nominal=nominal,
        actives=actives,
        runs=options.runs,
        held_out=options.held_out,
        cycles=options.cycles,
        noise_share=10.0 ** (-options.snr / 20.0),
        bits=options.bits,
        tolerance=options.tolerance,
        seed=options.seed,
        later=options.later,
        channels=options.channels,
    )
    for rule in obstacles(nominal):
        print(f"note: {obstacle_text(rule)}")
    label = make_campaign(out, plan, name)
    seal = write_label(labels, name, label)
    print(f"written: {out} ({options.runs} runs)")
    print(f"label: {labels / name}.json, sha256 {seal}")
    return 0
