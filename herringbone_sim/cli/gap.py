"""``gap``: where a rig's forces disagree with the nominal model."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

from herringbone_sim.core.model import build
from herringbone_sim.gap.residual import ForceResidual, force_residual
from herringbone_sim.recording.campaign import CampaignRun, read_campaign
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.sweeps.kept import make_folder

DESCRIPTION = """\
Compare a campaign (a folder of runs with campaign.yaml) with the nominal model, mesh by mesh:
residual F - (k(t) f(x) + c v) of every run, with the recorded x, v and F. No trajectory is
computed, so chaos does not matter. This version tells where and how much; it does not name the
cause yet.
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``gap``."""
    parser = subparsers.add_parser(
        "gap",
        help="tell where a rig's forces disagree with the nominal model",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("campaign", type=Path, metavar="CAMPAIGN", help="folder of runs")
    parser.add_argument(
        "--nominal", type=Path, required=True, metavar="FILE", help="parameters of the rig"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    parser.set_defaults(func=gap)


def gap(args: argparse.Namespace) -> int:
    """Print a line a run and write ``residual.csv``."""
    campaign = read_campaign(args.campaign)
    nominal = load_parameters(args.nominal).changed({"model": "full"})
    make_folder(args.out)
    print(f"{'run':10s} {'role':9s} {'residual [N]':>13s} {'of force':>9s}  largest mesh (share)")
    with (args.out / "residual.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["run", "role", "mesh", "residual_rms_n", "force_rms_n", "share"])
        for run in campaign.runs:
            model = build(nominal.changed(run.point))
            found = force_residual(model, read_recording(run.path).samples)
            print(line(run, found))
            force = (found.force_n**2).mean(axis=0) ** 0.5
            for row in zip(found.meshes, found.rms_n, force, found.shares, strict=True):
                table.writerow([run.path.name, run.role, row[0], *(f"{v:.6g}" for v in row[1:])])
    print(f"written: {args.out / 'residual.csv'}")
    return 0


def line(run: CampaignRun, found: ForceResidual) -> str:
    """Residual of a run over all meshes, as force and as share, and its largest mesh."""
    total = float((found.residual_n**2).mean() ** 0.5)
    force = float((found.force_n**2).mean() ** 0.5)
    worst = int(found.shares.argmax())
    return (
        f"{run.path.name:10s} {run.role:9s} {total:13.1f} {total / force:8.2%}  "
        f"{found.meshes[worst]} ({found.shares[worst]:.0%})"
    )
