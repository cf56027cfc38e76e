"""Make a campaign of files of other programs: CSV, Parquet, MAT (v5 and v7.3), TDMS, HDF5,
rosbag2. SPEC.yaml says which column of which file is which channel, in which unit, with which
scale, sign, rate and trigger offset, and gives operating point and role of each run
(docs/importing.md). All is written in SI, each run on one clock; units must fit, values outside
the range of the data sheet are reported. Prints which columns were used and which not, and writes
bags, campaign.yaml, nominal.yaml and import.html. A wrong entry is an error, and then nothing is
written.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from herringbone_sim.cli.options import Folder, progress
from herringbone_sim.recording.importing.campaign import NOMINAL, ImportedRun, import_campaign
from herringbone_sim.recording.importing.parse import read_spec
from herringbone_sim.views.pages.imported import (
    ranges_by_quantity,
    unused_texts,
    write_import_page,
)

EXAMPLES = """\
python -m herringbone_sim.examples.files --out files
python -m herringbone_sim campaign import files/spec.yaml --out rigs/files
"""


def run(
    spec: Annotated[Path, "SPEC.yaml", "what the files hold"],
    /,
    *,
    out: Annotated[Folder, "campaign folder to make"],
) -> int:
    """Import files into a campaign: write it and its page, print each run; exit code 0."""
    content = read_spec(spec)
    with progress(len(content.runs)) as report:
        runs = import_campaign(content, out, report)
    page = write_import_page(out, content.rig, runs)
    print(table(runs))
    print(f"written: {out / 'campaign.yaml'}, {out / NOMINAL}, {page}")
    print(f"what it allows: python -m herringbone_sim campaign check {out}")
    return 0


def table(runs: Sequence[ImportedRun]) -> str:
    """Text: per run its sampling rate, range of each quantity, unused columns and remarks."""
    return "\n".join(line for run in runs for line in _run_lines(run))


def _run_lines(run: ImportedRun) -> list[str]:
    head = (
        f"{run.name}  {run.role}  {run.samples} samples  {run.rate_hz:.6g} Hz  "
        f"{run.cycles:.1f} mesh cycles  {len(run.taken)} channels"
    )
    return [
        head,
        *(
            f"  taken {name:8s} {low:12.5g} to {high:12.5g} {unit}"
            for name, (unit, low, high) in ranges_by_quantity(run).items()
        ),
        *(f"  left {text}" for text in unused_texts(run.left)),
        *(f"  look at: {text}" for text in run.remarks),
    ]
