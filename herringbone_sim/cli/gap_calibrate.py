"""Diagnose practice campaigns, store the evidence of each (FOLDER/evidence.jsonl), and fit the
weights that turn evidence into probabilities. The file of weights also holds seeds, code version
and scores on campaigns left out of the fit. A campaign takes about a minute, and 300 of them are
reasonable; a fit to stored evidence (--evidence) takes seconds.
"""

from __future__ import annotations

from typing import Annotated

from herringbone_sim.cli.gap_bench import SettingOptions, setting_from
from herringbone_sim.cli.options import File, Folder, Pool, Seeds
from herringbone_sim.errors import AnalysisError
from herringbone_sim.practice.bench import run_bench
from herringbone_sim.practice.calibrate import calibrate, write_weights
from herringbone_sim.practice.case_evidence import bench_evidence, read_evidence, write_evidence
from herringbone_sim.practice.pool import Resources
from herringbone_sim.practice.seeds import check_seeds, parse_seeds
from herringbone_sim.practice.trial import sources
from herringbone_sim.sweeps.output import make_folder

EXAMPLES = """\
python -m herringbone_sim gap calibrate --evidence test/data/evidence.jsonl --out weights.json
"""


def run(
    *,
    seeds: Seeds = None,
    folder: Annotated[Folder | None, "of the campaigns; an interrupted one is continued"] = None,
    evidence: Annotated[File | None, "stored evidence, instead of seeds"] = None,
    out: Annotated[File, "weights to write"],
    setting: SettingOptions = SettingOptions(),
    pool: Pool = Pool(),
) -> int:
    """Fit the weights of the judge to evidence, write them and print their scores; exit code 0.

    The evidence is read from ``evidence``; else campaigns of ``seeds`` that ``folder`` lacks are
    diagnosed first, and the evidence is written there.

    Raises:
        AnalysisError: neither seeds with a folder nor evidence is given.
    """
    if evidence is not None and (seeds is not None or folder is not None):
        raise AnalysisError("--evidence stands instead of --seeds and --folder: leave one out")
    make_folder(out.parent)
    if evidence is not None:
        campaigns = read_evidence(evidence)
    elif seeds is None or folder is None:
        raise AnalysisError("a calibration needs --seeds and --folder, or --evidence: give them")
    else:
        numbers, resources = parse_seeds(seeds), Resources(pool.workers, pool.scheduler)
        run_bench(folder, numbers, setting_from(setting), check_seeds(numbers, True), resources)
        campaigns = bench_evidence(folder)
        write_evidence(folder / "evidence.jsonl", campaigns)
    calibration = calibrate(campaigns)
    write_weights(out, calibration, campaigns, sources())
    names = list(next(iter(calibration.figures.values())))
    print("campaigns left out".ljust(20) + "".join(f"{name:>26}" for name in names))
    for stratum, row in calibration.figures.items():
        print(stratum.ljust(20) + "".join(f"{row[name]:26.3f}" for name in names))
    print(f"models miss {calibration.relative:.1%} of a size")
    print(f"written: {out}")
    return 0
