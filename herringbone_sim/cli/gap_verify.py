"""Measure the augmented model of an earlier diagnosis (DIR/augmented.yaml) on further runs of the
same rig, with the measures of its report: residual, prediction error over a horizon short
against the Lyapunov time, distance of the attractors; each for the nominal model, the augmented
one and the noise floor. Nothing of the gear is fitted, so every run counts, whatever its role.
Prints the numbers beside those of the report and writes verify.json and verify.html. The example
continues that of `gap`.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

from herringbone_sim.cli.options import File, Folder, Out, progress
from herringbone_sim.gap.data.prepare import prepare
from herringbone_sim.gap.further_runs import Repetition, repeat
from herringbone_sim.gap.report_file import read_report
from herringbone_sim.gap.verification.residual_gap import GapNumbers
from herringbone_sim.recording.parameter_file import load_gear, load_parameters
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.pages.gap.senses import verify_page
from herringbone_sim.views.pages.html import write_page

EXAMPLES = """\
python -m herringbone_sim rig make --out rigs/pin_later --seed 7 --later 1 \\
    --effect pin_position@all/2/all:offset=1.5e-5
python -m herringbone_sim gap verify rigs/pin_later --nominal config/rig.yaml --report gap_pin \\
    --out verified
"""


def run(
    campaign: Annotated[Path, "CAMPAIGN", "folder of further runs"],
    /,
    *,
    nominal: Annotated[File, "parameters of the rig"],
    report: Annotated[Folder, "folder that `gap` wrote"],
    out: Out,
) -> int:
    """Measure what separates rig and models on further runs, and print it; exit code 0.

    Writes ``verify.json`` and ``verify.html``. Nothing of the gear is fitted to these runs.
    """
    earlier = read_report(report / "report.json")
    own, actives = load_gear(report / "augmented.yaml")
    gear = load_parameters(nominal).changed({"model": "full"})
    prepared = prepare(campaign, gear)
    make_folder(out)
    with progress(1 + len(prepared.runs)) as step:
        result = repeat(prepared, own, actives, earlier, step)
    text = json.dumps(result.to_dict(), indent=2, allow_nan=False) + "\n"
    (out / "verify.json").write_text(text, encoding="utf-8")
    page = write_page(out / "verify.html", verify_page(result))
    print(table(result))
    print(f"written: {out / 'verify.json'}, {page}")
    return 0


def table(result: Repetition) -> str:
    """Text table: the gap by each measure, on these runs and below it as in the report."""
    earlier, gaps = result.earlier, result.senses.gaps
    effects = ", ".join(earlier.effects) or "no effect"
    lines = [
        f"verdict on {earlier.campaign}: {earlier.verdict}  ({effects})",
        f"{'':34s} {'nominal':>10s} {'augmented':>10s} {'floor':>10s} {'closure':>8s}",
    ]
    for name, gap in gaps.items():
        lines.append(_line(gap.numbers(None), f"{len(gap.runs)} runs"))
        if name in earlier.numbers:
            lines.append(_line(earlier.numbers[name], "report"))
    lines += [f"can't tell: {text}" for text in result.undecidable]
    return "\n".join(lines)


def _line(gap: GapNumbers, where: str) -> str:
    title = f"{gap.metric} [{gap.unit}], {where}"
    values = (gap.nominal, gap.augmented, gap.noise_floor)
    cells = " ".join(f"{v:10.3g}" if math.isfinite(v) else "         -" for v in values)
    closure = f"{gap.closure:8.1%}" if math.isfinite(gap.closure) else "       -"
    return f"{title:34s} {cells} {closure}"
