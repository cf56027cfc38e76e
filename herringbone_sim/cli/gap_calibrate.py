"""``gap calibrate``: fit the weights of the judge to practice campaigns."""

from __future__ import annotations

import argparse
from pathlib import Path

from herringbone_sim.cli.gap_bench import add_setting, setting_from
from herringbone_sim.cli.options import add_file, add_seeds, add_workers, workers_from
from herringbone_sim.errors import AnalysisError
from herringbone_sim.practice.bench import run_bench
from herringbone_sim.practice.calibrate import calibrate, write_weights
from herringbone_sim.practice.case_evidence import bench_evidence, read_evidence, write_evidence
from herringbone_sim.practice.pool import Resources
from herringbone_sim.practice.seeds import check_seeds, parse_seeds
from herringbone_sim.practice.trial import sources

DESCRIPTION = """\
Diagnose practice campaigns, store the evidence of each (FOLDER/evidence.jsonl), and fit the
weights that turn evidence into probabilities. The file of weights also holds seeds, code version
and scores on campaigns left out of the fit. A campaign takes about a minute, and 300 of them are
reasonable; a fit to stored evidence (--evidence) takes seconds.
"""
EXAMPLES = """\
python -m herringbone_sim gap calibrate --evidence test/data/evidence.jsonl --out weights.json
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_seeds(parser)
    text = "folder of the campaigns; an interrupted one is continued"
    parser.add_argument("--folder", type=Path, metavar="DIR", help=text)
    add_file(parser, "--evidence", "stored evidence, instead of seeds")
    add_file(parser, "--out", "weights to write", required=True)
    add_setting(parser)
    add_workers(parser, scheduler=True)


def run(args: argparse.Namespace) -> int:
    """Diagnose missing campaigns, fit and write the weights, print the scores; exit code 0.

    Raises:
        AnalysisError: neither seeds with a folder nor evidence is given.
    """
    if args.evidence is not None:
        campaigns = read_evidence(args.evidence)
    elif args.seeds is None or args.folder is None:
        raise AnalysisError("a calibration needs --seeds and --folder, or --evidence: give them")
    else:
        seeds = parse_seeds(args.seeds)
        seen = check_seeds(seeds, True)
        workers, scheduler = workers_from(args), args.scheduler
        run_bench(args.folder, seeds, setting_from(args), seen, Resources(workers, scheduler))
        campaigns = bench_evidence(args.folder)
        write_evidence(args.folder / "evidence.jsonl", campaigns)
    calibration = calibrate(campaigns)
    write_weights(args.out, calibration, campaigns, sources())
    names = list(next(iter(calibration.figures.values())))
    print("campaigns left out".ljust(20) + "".join(f"{name:>26}" for name in names))
    for stratum, row in calibration.figures.items():
        print(stratum.ljust(20) + "".join(f"{row[name]:26.3f}" for name in names))
    print(f"models miss {calibration.relative:.1%} of a size")
    print(f"written: {args.out}")
    return 0
