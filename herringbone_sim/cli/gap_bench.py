"""``gap bench``: how often the diagnosis is right, on rigs whose effect is withheld."""

from __future__ import annotations

import argparse
from pathlib import Path

from herringbone_sim.cli.options import add_seeds, add_workers, workers_from
from herringbone_sim.errors import AnalysisError, ParameterError
from herringbone_sim.practice.bench import read_json, run_bench
from herringbone_sim.practice.noise import NOISES
from herringbone_sim.practice.overview import overview_markdown
from herringbone_sim.practice.pool import Resources
from herringbone_sim.practice.record import CHANNEL_SETS
from herringbone_sim.practice.score import write_table
from herringbone_sim.practice.seeds import SeedOverlap, check_seeds, parse_seeds
from herringbone_sim.practice.stored import read_bench
from herringbone_sim.practice.table import bench_rows, table_markdown, write_cases
from herringbone_sim.practice.trial import Setting, plan_of

DESCRIPTION = """\
Make rigs with none, one, two or foreign effects, seal their labels (their hash is printed before
any diagnosis runs), diagnose them, and write how often the verdict is right: table.md, table.csv,
cases.csv, with 95 % intervals, targets, strata and baselines. Rigs come from a generator of their
own, with another integrator and other laws of the effects than those of the diagnosis.

Repeat the command to continue a bench that was stopped.
"""
EXAMPLES = """\
python -m herringbone_sim gap bench --seeds 810000:810002 --out bench
python -m herringbone_sim gap bench --table bench
python -m herringbone_sim gap bench --seeds 820000:820002 --noise coloured,encoders \\
    --channels few --out few
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add = parser.add_argument
    add_seeds(parser)
    add("--out", type=Path, metavar="DIR", help="folder to write, or to continue in")
    add(
        "--table",
        type=Path,
        nargs="+",
        metavar="DIR",
        help="only print the table of a folder, or one of several folders, a row each",
    )
    add_setting(parser)
    add("--again", action="store_true", help="repeat diagnoses made by another version")
    add(
        "--calibration-family",
        action="store_true",
        help="allow seeds that the thresholds were frozen on; the table is marked",
    )
    add_workers(parser, scheduler=True)


def add_setting(parser: argparse.ArgumentParser) -> None:
    """Add the options of the distribution that campaigns are drawn from, see ``Setting``."""
    add = parser.add_argument
    add("--snr", default="40", metavar="DB", help="noise, a list to draw from [%(default)s]")
    add("--noise", default="white", metavar="KINDS", help=f"{', '.join(NOISES)} [%(default)s]")
    add("--law", default="both", help="curves of the effects: catalogue, other [%(default)s]")
    add(
        "--channels",
        default="full",
        metavar="SETS",
        help=f"{', '.join(CHANNEL_SETS)} [%(default)s]",
    )
    add("--samples", default="24", metavar="N", help="of a mesh cycle, a list [%(default)s]")
    add("--d", default="3,10", metavar="D", help="detectabilities to draw from [%(default)s]")
    add("--regime", default="varied", metavar="R", help="varied, quiet [%(default)s]")
    add("--truth", help="none, single, pair, unknown, unseen, random_physics or an effect")


def run(args: argparse.Namespace) -> int:
    """Run missing campaigns, then print and write the table; exit code 0."""
    if args.table is None:
        if args.seeds is None or args.out is None:
            raise AnalysisError("a bench needs --seeds and --out, a stored one --table: give them")
        seeds = parse_seeds(args.seeds)
        setting = setting_from(args)
        plan_of(setting, seeds[0])
        seen = check_seeds(seeds, args.calibration_family)
        run_bench(
            args.out,
            seeds,
            setting,
            seen,
            Resources(workers_from(args), args.scheduler),
            args.again,
            lambda text: print(text, flush=True),
        )
    folders = args.table or [args.out]
    if len(folders) == 1:
        write_results(folders[0], args.calibration_family)
        return 0
    benches = {}
    for folder in folders:
        marked = _seeds_of(folder, args.calibration_family).seeds
        name = f"{folder}{' (SEEN WHILE CALIBRATING)' if marked else ''}"
        benches[name] = read_bench(folder)
    print(overview_markdown(benches))
    return 0


def write_results(folder: Path, calibration_family: bool) -> None:
    """Write the tables of a bench folder into it, and print the main one.

    Args:
        calibration_family: allow seeds that the thresholds were frozen on.
    """
    seen = _seeds_of(folder, calibration_family)
    results = read_bench(folder)
    text = table_markdown(results, seen)
    (folder / "table.md").write_text(text, encoding="utf-8")
    write_table(bench_rows(results), folder / "table.csv")
    write_cases(results.cases, folder / "cases.csv")
    print(text)
    print(f"written: {folder / 'table.md'}, {folder / 'table.csv'}, {folder / 'cases.csv'}")


def _seeds_of(folder: Path, calibration_family: bool) -> SeedOverlap:
    """Seeds of a bench folder that thresholds were frozen on; see ``check_seeds``."""
    note = read_json(folder / "bench.json")
    allowed = calibration_family or bool(note.get("calibration_family"))
    return check_seeds(note.get("seeds", ()), allowed)


def setting_from(args: argparse.Namespace) -> Setting:
    """Distribution that campaigns are drawn from; ParameterError for a text that is no number."""
    try:
        snr, d = (tuple(float(v) for v in text.split(",")) for text in (args.snr, args.d))
        samples = tuple(int(v) for v in args.samples.split(","))
    except ValueError as error:
        raise ParameterError(
            f"--snr and --d are lists of numbers, --samples of whole ones: {error}"
        ) from None
    channels, regime, noise = (
        tuple(v.strip() for v in text.split(","))
        for text in (args.channels, args.regime, args.noise)
    )
    return Setting(snr, channels, d, regime, args.truth, noise, args.law, samples)
