"""``reproduce``: recompute figures 5 to 20 of the paper and check its statements."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from tqdm import tqdm

from herringbone_sim.cli.demo import config
from herringbone_sim.cli.options import add_file, add_number, add_out, add_workers, workers_from
from herringbone_sim.cli.parameter_options import (
    add_effects_option,
    effects_from,
    print_gear_notes,
)
from herringbone_sim.core.scaling import scales
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import AnalysisError
from herringbone_sim.paper import reproduction
from herringbone_sim.paper.motions import recorded
from herringbone_sim.paper.observe import BatchRunner
from herringbone_sim.paper.regimes import Sweep
from herringbone_sim.paper.reproduction import Checked, Compared, Point
from herringbone_sim.paper.scenarios import (
    SECTION_4_XI,
    SECTION_4_XI_PRINTED,
    Scenario,
    motion_name,
)
from herringbone_sim.paper.staircase import Reading
from herringbone_sim.recording.parameter_file import load_gear
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures import motion as figures
from herringbone_sim.views.figures import paper as paper_figures
from herringbone_sim.views.figures import style
from herringbone_sim.views.figures.style import Scale
from herringbone_sim.views.pages.paper import ScenarioFigures, page
from herringbone_sim.views.tables.csv_file import write_csv

SHARES = ("share_before", "share_after")
DESCRIPTION = """\
Run the sweeps behind Figs. 5 to 20 of the paper, find the boundaries between the motions by
bisection, and compare each statement of the paper with the result. Writes index.html,
statements.csv, dependence.csv and figures/ into DIR. Finished runs are stored in DIR/data: repeat
the command to continue one that was stopped.
"""
EXAMPLES = """\
python -m herringbone_sim reproduce --only A --compared 0 --out fig05
python -m herringbone_sim reproduce --out reproduction
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add = parser.add_argument
    add_out(parser)
    add("--only", default="ABCDE", metavar="LETTERS", help="scenarios (default: ABCDE)")
    add_number(parser, "--values", 400, "values of a sweep")
    text = "values of a sweep from other starts and with other steps; 0 for none"
    add_number(parser, "--compared", 100, text)
    text = "values of the parameters that the paper leaves open (default: config/paper.yaml)"
    add_file(parser, "--parameters", text)
    add(
        "--xi",
        type=float,
        default=SECTION_4_XI,
        help=f"damping ratio of section 4, scenarios C to E; {SECTION_4_XI_PRINTED:g} is printed "
        f"(default: {SECTION_4_XI:g})",
    )
    add_effects_option(parser)
    add_workers(parser)


def run(args: argparse.Namespace) -> int:
    """Run the scenarios, write page, tables and figures, print the statements; exit code 0."""
    _check(args)
    scenarios = reproduction.scenarios_of(args.only)
    base, of_file = load_gear(args.parameters or config("paper.yaml"))
    reading = Reading(base, args.xi, effects_from(args, of_file))
    print_gear_notes(build_with(base, reading.effects))
    workers = workers_from(args)
    make_folder(args.out / "figures")
    with tqdm(total=_total(scenarios, args), unit="run", disable=None, smoothing=0.05) as bar:
        runner = BatchRunner(args.out / "data", workers, bar.update)
        sweeps = reproduction.sweeps(runner, scenarios, reading, args.values)
        points = reproduction.points(runner, scenarios, reading)
        evidence = {
            s.key: reproduction.evidence(runner, s, reading, sweeps[s.key], points)
            for s in scenarios
        }
        rows: Mapping[str, Mapping[str, Sweep]] = {}
        if args.compared:
            rows = reproduction.compared(runner, scenarios, reading, args.compared, sweeps)
    checked = reproduction.checked(evidence)
    compared = reproduction.compared_boundaries(rows)
    _write_tables(args.out, checked, compared)
    parts = _draw(args.out, scenarios, sweeps, points, rows)
    facts = _facts(args, reading, checked)
    html = page(facts, parts, checked, compared)
    (args.out / "index.html").write_text(html, encoding="utf-8")
    for line in (*_table(checked), *facts, f"written: {args.out / 'index.html'}"):
        print(line)
    return 0


def _total(scenarios: Sequence[Scenario], args: argparse.Namespace) -> int:
    """Number of runs if every boundary can be bisected."""
    each: int = args.values
    if args.compared:
        each += reproduction.compared_runs(args.compared)
    bisected = sum(map(reproduction.bisected_runs, scenarios))
    return len(scenarios) * each + bisected + reproduction.point_runs(scenarios)


def _facts(args: argparse.Namespace, reading: Reading, checked: Sequence[Checked]) -> list[str]:
    p, right = reading.parameters, sum(c.obtained.ok for c in checked)
    torque = scales(p).control_torque_n_m(0.3)
    return [
        f"{right} of {len(checked)} statements right",
        f"reading: {args.parameters or 'config/paper.yaml'}, b_c = {p.b_c:g} m, gamma = "
        f"{p.gamma:g} /K, alpha' = {p.alpha_w:g} deg",
        f"xi of section 4: {reading.xi:g} (printed: {SECTION_4_XI_PRINTED:g})",
        *([f"with effects: {effects_text(reading.effects)}"] if reading.effects else []),
        f"{args.values} values a sweep",
        f"K = 0.3 is a torque of {torque:.3g} N m on the carrier",
    ]


def _table(checked: Sequence[Checked]) -> list[str]:
    """Aligned lines: right or not, scenario, statement, published, obtained."""
    lines = []
    for c in checked:
        mark = "yes" if c.obtained.ok else " no"
        statement, published = c.statement, c.statement.published
        lines.append(
            f"{mark}  {statement.scenario}  {statement.text:66.66s}  {published:12.12s}  "
            f"{c.obtained.text}"
        )
    return lines


def _write_tables(out: Path, checked: Sequence[Checked], compared: Sequence[Compared]) -> None:
    head = ["scenario", "statement", "published", "obtained", "error", "ok"]
    pairs = ((c.statement, c.obtained) for c in checked)
    rows = ([s.scenario, s.text, s.published, o.text, o.error, o.ok] for s, o in pairs)
    write_csv(out / "statements.csv", head, rows)
    head = ["scenario", "boundary", "published", "way", "obtained", "half_width", *SHARES]
    write_csv(out / "dependence.csv", head, map(_compared_row, compared))


def _compared_row(row: Compared) -> list[object]:
    statement, b = row.statement, row.boundary
    head = [statement.scenario, statement.text, statement.published, row.way]
    return [*head, b.at, b.half_width, b.share_before, b.share_after]


def _draw(
    out: Path,
    scenarios: Sequence[Scenario],
    sweeps: Mapping[str, Sweep],
    points: Sequence[Point],
    rows: Mapping[str, Mapping[str, Sweep]],
) -> list[ScenarioFigures]:
    """Write all figures; returns their names by scenario."""
    folder = out / "figures"
    parts = []
    pair = [(s, sweeps[s.key]) for s in scenarios if not s.has_exponents]
    if pair:
        style.save(paper_figures.pair_figure(pair), folder, "fig20")
    for scenario in tqdm(scenarios, desc="figures", disable=None):
        key = scenario.key
        name = file_name(scenario.figure) if scenario.has_exponents else "fig20"
        if scenario.has_exponents:
            style.save(paper_figures.sweep_figure(scenario, sweeps[key]), folder, name)
        raster = ""
        if key in rows:
            raster = f"figures/starts_{key}.png"
            style.save(paper_figures.raster_figure(scenario, rows[key]), folder, f"starts_{key}")
        motions = tuple(_motion(folder, p) for p in points if p.statement.scenario == key)
        parts.append(ScenarioFigures(scenario, f"figures/{name}.png", motions, raster))
    return parts


def _motion(folder: Path, point: Point) -> tuple[str, str]:
    """Write a four-panel figure; its file name and caption."""
    statement, name = point.statement, file_name(point.statement.figure)
    result = recorded(point)
    s = scales(point.parameters)
    figure = figures.motion_figure(result, "sp_L", Scale(s.b_c, s.omega_n))
    obtained = f"{motion_name(point.motion)}, largest exponent {point.exponent:+.4f}"
    title = f"{statement.text}.  Obtained: {obtained}"
    figure.suptitle(title, x=0.01, ha="left", fontsize=9)
    paper_figures.widen_section(figure, result)
    path, _ = style.save(figure, folder, name)
    return f"figures/{path.name}", title


def file_name(figure: str) -> str:
    """File name of a figure of the paper: ``fig07`` of ``Fig. 7``."""
    return f"fig{int(figure.split()[-1]):02d}"


def _check(args: argparse.Namespace) -> None:
    """AnalysisError if a sweep has less than two values."""
    if args.values < 2:
        raise AnalysisError(f"--values must be 2 or more, got {args.values}")
    if args.compared < 2 and args.compared != 0:
        raise AnalysisError(f"--compared must be 2 or more, or 0 for none, got {args.compared}")
