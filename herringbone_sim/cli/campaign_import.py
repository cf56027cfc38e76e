"""``campaign import``: files of other programs become a campaign."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from herringbone_sim.cli.gap import progress
from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.recording.importing.campaign import NOMINAL, ImportedRun, import_campaign
from herringbone_sim.recording.importing.parse import read_spec
from herringbone_sim.views.pages.imported import by_kind, left_words, write_import_page

DESCRIPTION = """\
Make a campaign of files of other programs: CSV, Parquet, MAT (v5 and v7.3), TDMS, HDF5, rosbag2.
SPEC.yaml says which column of which file is which channel, in which unit, with which scale, sign,
rate and trigger offset, and gives operating point and role of each run (docs/importing.md). All is
written in SI, each run on one clock; units must fit, what is out of the data sheet's range is
told. Prints what it took and left, and writes bags, campaign.yaml, nominal.yaml and import.html.
A wrong entry is one error, and nothing is written.
"""
EXAMPLES = """\
python -m herringbone_sim.examples.files --out files
python -m herringbone_sim campaign import files/spec.yaml --out rigs/files
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``campaign import``."""
    parser = add_verb(subparsers, "campaign import", DESCRIPTION, EXAMPLES)
    parser.add_argument("spec", type=Path, metavar="SPEC.yaml", help="what the files hold")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to make")
    parser.set_defaults(func=campaign_import)


def campaign_import(args: argparse.Namespace) -> int:
    """Write the campaign and its page; print what came in."""
    spec = read_spec(args.spec)
    with progress(len(spec.runs)) as say:
        runs = import_campaign(spec, args.out, say)
    page = write_import_page(args.out, spec.rig, runs)
    print(table(runs))
    print(f"written: {args.out / 'campaign.yaml'}, {args.out / NOMINAL}, {page}")
    print(f"what it allows: python -m herringbone_sim campaign check {args.out}")
    return 0


def table(runs: Sequence[ImportedRun]) -> str:
    """A block a run: its clock, a line a quantity, what was left, what looks odd."""
    return "\n".join(line for run in runs for line in _run(run))


def _run(run: ImportedRun) -> list[str]:
    head = (
        f"{run.name}  {run.role}  {run.samples} samples  {run.rate_hz:.6g} Hz  "
        f"{run.cycles:.1f} mesh cycles  {len(run.taken)} channels"
    )
    return [
        head,
        *(
            f"  taken {name:8s} {low:12.5g} to {high:12.5g} {unit}"
            for name, (unit, low, high) in by_kind(run).items()
        ),
        *(f"  left {text}" for text in left_words(run.left)),
        *(f"  look at: {text}" for text in run.remarks),
    ]
