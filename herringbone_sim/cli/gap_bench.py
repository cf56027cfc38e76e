"""Make rigs with none, one, two or foreign effects, seal their labels (their hash is printed
before any diagnosis runs), diagnose them, and write how often the verdict is right: table.md,
table.csv, cases.csv, with 95 % intervals, targets, strata and baselines. Rigs come from a
generator of their own, with another integrator and other laws of the effects than those of the
diagnosis.

Repeat the command to continue a bench that was stopped.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from herringbone_sim.cli.options import Folder, Names, Numbers, Pool, Seeds, flattened
from herringbone_sim.errors import AnalysisError, ParameterError
from herringbone_sim.practice.bench import read_json, run_bench
from herringbone_sim.practice.channels import CHANNEL_SETS
from herringbone_sim.practice.noise import NOISES
from herringbone_sim.practice.overview import overview_markdown
from herringbone_sim.practice.pool import Resources
from herringbone_sim.practice.score import write_table
from herringbone_sim.practice.seeds import SeedOverlap, check_seeds, parse_seeds
from herringbone_sim.practice.stored import read_bench
from herringbone_sim.practice.table import bench_rows, table_markdown, write_cases
from herringbone_sim.practice.trial import Setting, plan_of

EXAMPLES = """\
python -m herringbone_sim gap bench --seeds 810000:810002 --out bench
python -m herringbone_sim gap bench --table bench
python -m herringbone_sim gap bench --seeds 820000:820002 --noise coloured,encoders \\
    --channels few --out few
"""


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class SettingOptions:
    """Options of the distribution from which campaigns are drawn, see ``Setting``."""

    snr: Annotated[Numbers, "DB,...", "noise, a list to draw from"] = (40.0,)
    noise: Annotated[Names, "KINDS", ", ".join(NOISES)] = ("white",)
    law: Annotated[str, "LAW", "curves of the effects: catalogue, other"] = "both"
    channels: Annotated[Names, "SETS", ", ".join(CHANNEL_SETS)] = ("full",)
    samples: Annotated[Numbers, "N,...", "samples of a mesh cycle, a list"] = (24.0,)
    d: Annotated[Numbers, "D,...", "detectabilities to draw from"] = (3.0, 10.0)
    regime: Annotated[Names, "R,...", "varied, quiet"] = ("varied",)
    truth: Annotated[
        str | None, "TRUTH", "none, single, pair, unknown, unseen, random_physics or an effect"
    ] = None


def run(
    *,
    seeds: Seeds = None,
    out: Annotated[Folder | None, "folder to write, or to continue in"] = None,
    table: Annotated[
        tuple[Path, ...],
        "DIR ...",
        Parameter(consume_multiple=1),
        "diagnose nothing: make the table of a folder again, or print one of several, a row each",
    ] = (),
    setting: SettingOptions = SettingOptions(),
    again: Annotated[bool, "repeat diagnoses made by another version"] = False,
    calibration_family: Annotated[
        bool, "allow seeds that the thresholds were frozen on; the table is marked"
    ] = False,
    pool: Pool = Pool(),
) -> int:
    """Diagnose missing campaigns, then print and write the table; exit code 0.

    With ``table`` nothing is diagnosed; several folders only get an overview printed.

    Raises:
        AnalysisError: nothing to diagnose or print, or seeds that the judge was fitted on.
    """
    if table and (seeds is not None or out is not None):
        raise AnalysisError("--table takes stored benches, without --seeds and --out")
    if not table:
        if seeds is None or out is None:
            raise AnalysisError("a bench needs --seeds and --out, a stored one --table: give them")
        numbers, drawn = parse_seeds(seeds), setting_from(setting)
        plan_of(drawn, numbers[0])
        seen = check_seeds(numbers, calibration_family)
        resources = Resources(pool.workers, pool.scheduler)
        say = partial(print, flush=True)
        run_bench(out, numbers, drawn, seen, resources, again, say)
        table = (out,)
    if len(table) == 1:
        write_results(table[0], calibration_family)
        return 0
    benches = {}
    for folder in table:
        marked = _seeds_of(folder, calibration_family).seeds
        name = f"{folder}{' (SEEN WHILE CALIBRATING)' if marked else ''}"
        benches[name] = read_bench(folder)
    print(overview_markdown(benches))
    return 0


def write_results(folder: Path, calibration_family: bool) -> None:
    """Write table.md, table.csv and cases.csv into a bench folder, and print the first.

    Args:
        folder: folder with the diagnosed campaigns.
        calibration_family: allow seeds that the weights of the judge were fitted on.
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
    """Overlap of a bench folder's seeds with those that the judge's weights were fitted on."""
    note = read_json(folder / "bench.json")
    allowed = calibration_family or bool(note.get("calibration_family"))
    return check_seeds(note.get("seeds", ()), allowed)


def setting_from(options: SettingOptions) -> Setting:
    """Distribution of the campaigns that the options set; ParameterError for an invalid value."""
    if not all(number.is_integer() for number in options.samples):
        raise ParameterError(f"--samples takes whole numbers, got {options.samples}")
    return Setting(
        options.snr,
        options.channels,
        options.d,
        options.regime,
        options.truth,
        options.noise,
        options.law,
        tuple(map(int, options.samples)),
    )
