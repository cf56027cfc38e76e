"""``gap calibrate``: weights that turn evidence into probabilities, from practice campaigns."""

from __future__ import annotations

import argparse
from pathlib import Path

from herringbone_sim.cli.gap_bench import add_setting, setting_from
from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.cli.workers import add_workers, workers_from
from herringbone_sim.errors import AnalysisError
from herringbone_sim.practice.bench import check_seeds, run_bench
from herringbone_sim.practice.calibrate import (
    bench_evidence,
    calibrate,
    read_evidence,
    write_evidence,
    write_weights,
)
from herringbone_sim.practice.pool import Resources
from herringbone_sim.practice.seeds import parse_seeds
from herringbone_sim.practice.trial import sources

DESCRIPTION = """\
Diagnose practice campaigns, keep what the diagnosis found of each (FOLDER/evidence.jsonl), and
fit the few weights with which evidence becomes probability. The file says seeds, code and what
campaigns that were left out of the fit got. A campaign takes about a minute, 300 of them are a
fair number; evidence that was kept (--evidence) takes seconds.
"""
EXAMPLES = """\
python -m herringbone_sim gap calibrate --evidence test/data/evidence.jsonl --out weights.json
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``gap calibrate``."""
    parser = add_verb(subparsers, "gap calibrate", DESCRIPTION, EXAMPLES)
    add = parser.add_argument
    add("--seeds", metavar="A:B", help="one campaign each; ranges without their end, or lists")
    add("--folder", type=Path, metavar="DIR", help="where campaigns go, or to go on in")
    add("--evidence", type=Path, metavar="FILE", help="evidence that was kept, instead of seeds")
    add("--out", type=Path, required=True, metavar="FILE", help="weights to write")
    add_setting(parser)
    add_workers(parser)
    add("--scheduler", metavar="ADDRESS", help="run on this Dask cluster, as tcp://HOST:8786")
    parser.set_defaults(func=run)


def run(args: argparse.Namespace) -> int:
    """Run what is missing, fit, write, and tell the figures."""
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
    found = calibrate(campaigns)
    write_weights(args.out, found, campaigns, sources())
    names = list(next(iter(found.figures.values())))
    print("campaigns left out".ljust(20) + "".join(f"{name:>26}" for name in names))
    for stratum, row in found.figures.items():
        print(stratum.ljust(20) + "".join(f"{row[name]:26.3f}" for name in names))
    print(f"models miss {found.relative:.1%} of a size")
    print(f"written: {args.out}")
    return 0
