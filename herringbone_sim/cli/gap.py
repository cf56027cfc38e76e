"""``gap``: where a rig's forces disagree with the nominal model, and what causes it."""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tqdm import tqdm

from herringbone_sim.cli.gap_rerun import mirror_gap
from herringbone_sim.cli.rerun_option import add_rerun_option, parse_where
from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import HerringboneError
from herringbone_sim.gap.data.prepare import prepare
from herringbone_sim.gap.diagnose import Diagnosis, diagnose
from herringbone_sim.gap.report import write_report
from herringbone_sim.gap.residuals.residual import ForceResidual, force_residual
from herringbone_sim.gap.verdict.augmented import save_augmented
from herringbone_sim.gap.verification.verify import Gap
from herringbone_sim.recording.campaign import Campaign, CampaignRun, read_campaign
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.gap_arrays import gap_arrays
from herringbone_sim.views.pages.gap.page import write_gap_page

DESCRIPTION = """\
Compare a campaign (a folder of runs with campaign.yaml) with the nominal model: first mesh by
mesh the residual F - (k(t) f(x) + c v) of every run, then which effect explains it, with what
probability and size, and how far the gap shrinks on runs of role held_out, which no choice and
no fit has seen: as a residual, as a prediction over a horizon short against the Lyapunov time,
and as an attractor. No trajectory is held against another beyond that. Writes residual.csv,
report.json, augmented.yaml (the model that the node runs, recalibrated and with the effects), and
report.html: where, which, how much, what is open, what to measure next.
"""
EXAMPLES = """\
python -m herringbone_sim rig make --out rigs/pin --seed 7 \\
    --effect pin_position@all/2/all:offset=1.5e-5
python -m herringbone_sim gap rigs/pin --nominal config/rig.yaml --out gap_pin
"""
STEPS = 16  # of a diagnosis, about; a run is one more
SHOWN = 48  # letters of what is told
POINT = {"delta_T": " K", "T_1": " N m", "Omega": "", "K": ""}


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``gap``."""
    parser = add_verb(subparsers, "gap", DESCRIPTION, EXAMPLES)
    parser.add_argument("campaign", type=Path, metavar="CAMPAIGN", help="folder of runs")
    parser.add_argument(
        "--nominal", type=Path, required=True, metavar="FILE", help="parameters of the rig"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    add_rerun_option(parser, "save", "DIR/gap.rrd")
    parser.set_defaults(func=gap)


def gap(args: argparse.Namespace) -> int:
    """Print a line a run and the verdict; write the residuals, the report and its page."""
    where = parse_where(args.rerun, args.out / "gap.rrd")
    campaign = read_campaign(args.campaign)
    nominal = load_parameters(args.nominal).changed({"model": "full"})
    make_folder(args.out)
    residual_table(campaign, nominal, args.out / "residual.csv")
    prepared = prepare(args.campaign, nominal)
    with progress(STEPS + len(prepared.runs)) as say:
        found = diagnose(prepared, say)
    write_report(args.out / "report.json", found.report)
    save_augmented(args.out / "augmented.yaml", nominal, found.augmented, prepared.rig)
    page = write_gap_page(found.report, args.out, gap_arrays(found.calibrated), args.nominal)
    print(summary(found))
    names = ("residual.csv", "report.json", "augmented.yaml")
    print(f"written: {', '.join(str(args.out / name) for name in names)}, {page}")
    if where is not None:
        print(mirror_gap(where, prepared, found))
    return 0


@contextmanager
def progress(steps: int) -> Iterator[Callable[[str], None]]:
    """A bar on a terminal, nothing in a log; yields what is told of each step."""
    with tqdm(total=steps, unit="step", disable=None) as bar:

        def say(text: str) -> None:
            bar.set_description(text[:SHOWN])
            bar.total = max(bar.total or 0, bar.n + 1)
            bar.update()

        yield say
        bar.total = bar.n


def residual_table(campaign: Campaign, nominal: Parameters, path: Path) -> None:
    """Print and write the nominal residual of every run that has forces."""
    print(f"{'run':10s} {'role':9s} {'residual [N]':>13s} {'of force':>9s}  largest mesh (share)")
    told: set[str] = set()
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["run", "role", "mesh", "residual_rms_n", "force_rms_n", "share"])
        for run in campaign.runs:
            try:
                model = build(nominal.changed(run.point))
                found = force_residual(model, read_recording(run.path).samples)
            except HerringboneError as error:
                text = str(error)
                print(f"{run.path.name:10s} {run.role:9s} {'as above' if text in told else text}")
                told.add(text)
                continue
            print(line(run, found))
            force = (found.force_n**2).mean(axis=0) ** 0.5
            for row in zip(found.meshes, found.rms_n, force, found.shares, strict=True):
                table.writerow([run.path.name, run.role, row[0], *(f"{v:.6g}" for v in row[1:])])


def line(run: CampaignRun, found: ForceResidual) -> str:
    """Residual of a run over all meshes, as force and as share, and its largest mesh."""
    total = float((found.residual_n**2).mean() ** 0.5)
    force = float((found.force_n**2).mean() ** 0.5)
    worst = int(found.shares.argmax())
    return (
        f"{run.path.name:10s} {run.role:9s} {total:13.1f} {total / force:8.2%}  "
        f"{found.meshes[worst]} ({found.shares[worst]:.0%})"
    )


def summary(found: Diagnosis) -> str:
    """The verdict, the likeliest causes and the gap, in a few lines."""
    verdict, gap = found.verdict, found.gap
    lines = [f"verdict: {verdict.verdict}  {', '.join(verdict.effects)}".rstrip()]
    for cause in found.report["causes"][:4]:
        values = ", ".join(
            f"{name} {p['value']:.4g} {p['unit']} [{p['ci90'][0]:.4g}, {p['ci90'][1]:.4g}]"
            if p["ci90"]
            else f"{name} {p['value']}"
            for name, p in cause["parameters"].items()
        )
        place = "/".join(cause["locus"].values())
        lines.append(f"  {cause['probability']:7.2%}  {cause['effect']:22s} {place:10s} {values}")
    if math.isfinite(gap.rms("nominal")):
        lines.append(
            f"{gap.metric} on held-out runs: nominal {gap.rms('nominal'):.4g}, augmented "
            f"{gap.rms('augmented'):.4g}, floor {gap.rms('floor'):.4g}, closure "
            f"{gap.closure:.1%}"
        )
    control = gap.closed("runner_up")
    if math.isfinite(control):
        lines.append(f"  runner-up as a control: closure {control:.1%}")
    if found.senses is not None:
        others = (found.senses.prediction, found.senses.attractor)
        lines += [sense_line(one) for one in others if math.isfinite(one.rms("nominal"))]
    wrong = [finding["text"] for finding in found.report["findings"]]
    lines += [f"wrong with the recording: {text}" for text in wrong]
    open_ = [text for text in found.report["undecidable"] if text not in wrong]
    lines += [f"can't tell: {text}" for text in open_]
    return "\n".join([*lines, next_line(found.report["next_experiment"])])


def next_line(asked: Mapping[str, Any]) -> str:
    """The operating point to run next, and why."""
    point = ", ".join(f"{name} {asked[name]:g}{unit}" for name, unit in POINT.items())
    return f"next to run: {point}; {asked['why']}"


def sense_line(gap: Gap) -> str:
    """Before, after and floor of a sense on held-out runs, and what the runner-up closes."""
    values = ", ".join(f"{name} {gap.rms(name):.3g}" for name in ("nominal", "augmented", "floor"))
    return (
        f"{gap.metric} on held-out runs [{gap.unit}]: {values}, closure {gap.closure:.1%}, "
        f"runner-up {gap.closed('runner_up'):.1%}"
    )
