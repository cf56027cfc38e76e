"""Run the sweeps behind Figs. 5 to 20 of the paper, find the boundaries between the motions by
bisection, and compare each statement of the paper with the result. Writes index.html,
statements.csv, dependence.csv and figures/ into DIR. Finished runs are stored in DIR/data: repeat
the command to continue one that was stopped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tqdm import tqdm

from herringbone_sim.cli.demo import config
from herringbone_sim.cli.options import Count, File, Out, Workers, flattened, limits
from herringbone_sim.cli.parameter_options import Effects, print_gear_notes
from herringbone_sim.core.scaling import scales
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import AnalysisError
from herringbone_sim.paper import reproduction
from herringbone_sim.paper.motions import recorded
from herringbone_sim.paper.observe import BatchRunner
from herringbone_sim.paper.regimes import Sweep
from herringbone_sim.paper.reproduction import CheckedStatement, Compared, Point
from herringbone_sim.paper.scenarios import (
    SECTION_4_XI,
    SECTION_4_XI_PRINTED,
    Scenario,
    motion_name,
)
from herringbone_sim.paper.staircase import Reading
from herringbone_sim.recording.parameter_file import gear_parts
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures import motion as figures
from herringbone_sim.views.figures import paper as paper_figures
from herringbone_sim.views.figures import style
from herringbone_sim.views.figures.style import Scale
from herringbone_sim.views.pages.html import write_page
from herringbone_sim.views.pages.paper import ScenarioFigures, page
from herringbone_sim.views.tables.csv_file import write_csv

SHARES = ("share_before", "share_after")
OPEN = "values of the parameters that the paper leaves open (default: config/paper.yaml)"
PRINTED_XI = f"damping ratio of section 4, scenarios C to E; {SECTION_4_XI_PRINTED:g} is printed"
EXAMPLES = """\
python -m herringbone_sim reproduce --only A --compared 0 --out fig05
python -m herringbone_sim reproduce --out reproduction
"""


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class SweepSizes:
    """Options: number of values of the sweeps."""

    values: Annotated[Count, limits(gte=2), "values of a sweep"] = 400
    compared: Annotated[
        Count, "values of a sweep from other starts and with other steps; 0 for none"
    ] = 100


def run(
    *,
    out: Out,
    only: Annotated[str, "LETTERS", "scenarios"] = "ABCDE",
    sizes: SweepSizes = SweepSizes(),
    parameters: Annotated[File | None, OPEN] = None,
    xi: Annotated[float, "XI", PRINTED_XI] = SECTION_4_XI,
    effects: Effects = None,
    workers: Workers = 2,
) -> int:
    """Reproduce the scenarios: write page, tables and figures, print statements; exit code 0."""
    if sizes.compared == 1:
        raise AnalysisError("--compared must be 2 or more, or 0 for none, got 1")
    scenarios = reproduction.scenarios_of(only)
    base, actives = gear_parts(parameters or config("paper.yaml"), effects)
    reading = Reading(base, xi, actives)
    print_gear_notes(build_with(base, reading.effects))
    make_folder(out / "figures")
    with tqdm(total=0, unit="run", disable=None, smoothing=0.05) as bar:
        runner = BatchRunner(out / "data", workers, bar)
        sweeps = reproduction.sweeps(runner, scenarios, reading, sizes.values)
        points = reproduction.points(runner, scenarios, reading)
        evidence = {
            s.key: reproduction.evidence(runner, s, reading, sweeps[s.key], points)
            for s in scenarios
        }
        rows: Mapping[str, Mapping[str, Sweep]] = {}
        if sizes.compared:
            rows = reproduction.compared(runner, scenarios, reading, sizes.compared, sweeps)
    checked = reproduction.checked(evidence)
    compared = reproduction.compared_boundaries(rows)
    _write_tables(out, checked, compared)
    parts = _draw(out, scenarios, sweeps, points, rows)
    facts = _facts(f"{parameters or 'config/paper.yaml'}", sizes.values, reading, checked)
    written = write_page(out / "index.html", page(facts, parts, checked, compared))
    for line in (*_table(checked), *facts, f"written: {written}"):
        print(line)
    return 0


def _facts(
    file: str, values: int, reading: Reading, checked: Sequence[CheckedStatement]
) -> list[str]:
    p, right = reading.parameters, sum(c.obtained.ok for c in checked)
    torque = scales(p).control_torque_n_m(0.3)
    return [
        f"{right} of {len(checked)} statements right",
        f"reading: {file}, b_c = {p.b_c:g} m, gamma = {p.gamma:g} /K, alpha' = {p.alpha_w:g} deg",
        f"xi of section 4: {reading.xi:g} (printed: {SECTION_4_XI_PRINTED:g})",
        *([f"with effects: {effects_text(reading.effects)}"] if reading.effects else []),
        f"{values} values a sweep",
        f"K = 0.3 is a torque of {torque:.3g} N m on the carrier",
    ]


def _table(checked: Sequence[CheckedStatement]) -> list[str]:
    """Aligned line per statement: whether it holds, scenario, text, published and obtained."""
    lines = []
    for c in checked:
        mark = "yes" if c.obtained.ok else " no"
        statement, published = c.statement, c.statement.published
        lines.append(
            f"{mark}  {statement.scenario}  {statement.text:66.66s}  {published:20s}  "
            f"{c.obtained.text}"
        )
    return lines


def _write_tables(
    out: Path, checked: Sequence[CheckedStatement], compared: Sequence[Compared]
) -> None:
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
    """Write all figures and return their file names and captions for each scenario."""
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
    """Integrate the motion of a figure further, and write its four panels for the first mesh.

    Args:
        folder: the folder ``figures`` of the page.
        point: the motion, with the state from which it goes on.

    Returns:
        Path of the PNG relative to the page, and caption.

    Raises:
        DivergenceError: the motion diverges.
    """
    statement, name = point.statement, file_name(point.statement.figure)
    result = recorded(point)
    s = scales(point.parameters)
    figure = figures.motion_figure(
        result, point.parameters.layout.meshes[0], Scale.of(s.b_c, s.omega_n)
    )
    obtained = f"{motion_name(point.motion)}, largest exponent {point.exponent:+.4f}"
    title = f"{statement.text}.  Obtained: {obtained}"
    figure.suptitle(title, x=0.01, ha="left", fontsize=9)
    paper_figures.widen_section(figure, result)
    path, _ = style.save(figure, folder, name)
    return f"figures/{path.name}", title


def file_name(figure: str) -> str:
    """File name of a figure of the paper: ``fig07`` of ``Fig. 7``."""
    return f"fig{int(figure.split()[-1]):02d}"
