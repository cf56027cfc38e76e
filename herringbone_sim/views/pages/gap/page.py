"""``report.html`` of a diagnosis: verdict, places, causes, size of the gap, next experiment."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from herringbone_sim.gap.data.screen import finding_texts
from herringbone_sim.gap.report import Cause, Report
from herringbone_sim.views.figures.gap import GapArrays, write_gap_figures
from herringbone_sim.views.figures.gap_laws import write_law_figures
from herringbone_sim.views.numbers import figure, percent
from herringbone_sim.views.pages.gap import words
from herringbone_sim.views.pages.gap.senses import distances_values, senses_values
from herringbone_sim.views.pages.gap.tables import noise_table, runs_values
from herringbone_sim.views.pages.gap.verdict import OUTSIDE, answers, headline, kind, named_effects
from herringbone_sim.views.pages.gap.where import where_values
from herringbone_sim.views.pages.html import render, write_page
from herringbone_sim.views.picture import Picture

POINT = (
    ("delta_T", "temperature rise", "K"),
    ("T_1", "input torque", "N m"),
    ("Omega", "speed Ω", ""),
    ("K", "control K", ""),
)
TOP_CAUSES, LEAST_PROBABILITY = 6, 0.005  # causes with a bar: number, least probability
FURTHER = ("a_c", "F_pin1", "F_rp1_L", "u_p1_L")  # one sensor of each kind that may be added


def write_gap_page(
    report: Report, folder: Path, arrays: GapArrays | None = None, nominal: Path | None = None
) -> Path:
    """Write ``report.html``, with embedded pictures, and ``figures/``; return the page's path.

    Args:
        report: of a diagnosis.
        folder: created if missing; an earlier page is overwritten.
        arrays: data of the figures; None: figures of learned laws alone.
        nominal: parameter file of the rig; None: the page suggests no commands.

    Raises:
        AnalysisError: the folder can't be written.
    """
    pictures = write_law_figures(folder, report.laws)
    pictures += write_gap_figures(folder, arrays) if arrays else []
    commands = (
        (compare_command(nominal, folder), plan_command(report, nominal, folder))
        if nominal
        else ("", "")
    )
    return write_page(folder / "report.html", gap_page(report, pictures, *commands))


def plan_command(report: Report, nominal: Path, folder: Path) -> str:
    """Return the shell command that plans additional sensors.

    Empty if the diagnosis did not use trajectories, or if all sensors of ``FURTHER`` are recorded.
    """
    recorded = sorted(report.noise)
    more = [name for name in FURTHER if name not in recorded]
    if "trajectory" not in report.observations or not more:
        return ""
    options = ["--sensors", ",".join(recorded), "--also", ",".join(more)]
    command = ["python", "-m", "herringbone_sim", "gap", "plan", "--nominal", str(nominal)]
    return shlex.join([*command, *options, "--out", str(folder / "plan")])


def compare_command(nominal: Path, folder: Path) -> str:
    """Return the shell command that compares the bifurcations of nominal and augmented gear."""
    files = [nominal, folder / "augmented.yaml"]
    command = ["python", "-m", "herringbone_sim", "compare", *map(str, files)]
    return shlex.join([*command, "--over", "delta_T=0:100:400", "--out", str(folder / "compared")])


def gap_page(
    report: Report, pictures: Sequence[Picture] = (), command: str = "", planned: str = ""
) -> str:
    """Return the HTML of the page.

    Args:
        report: of a diagnosis.
        pictures: to embed.
        command: of ``compare_command``; empty: not shown.
        planned: of ``plan_command``; empty: not shown.
    """
    # A limit that is a finding too is already listed among the faults.
    said = {finding.text for finding in report.findings}
    drawing, remarks = where_values(report)
    experiment = report.next_experiment
    causes, rest = _which(report)
    return render(
        "gap.html",
        title=f"Gap: {report.campaign}",
        campaign=report.campaign,
        headline=headline(report.verdict),
        answers=answers(report),
        faults=finding_texts(report.findings),
        drawing=drawing,
        remarks=remarks,
        causes=causes,
        rest=rest,
        runs=runs_values(report.gap, kind(report.verdict)),
        senses=senses_values(report.senses, report.runner_up_effects),
        undecidable=[text for text in report.undecidable if text not in said],
        next_point=[
            (f"{figure(experiment.point[key], 4)} {unit}".strip(), title)
            for key, title, unit in POINT
        ],
        next_why=words.capital(experiment.why),
        plan_command=planned,
        compare_command=command,
        noise=noise_table(report.noise),
        attractor=distances_values(report.senses),
        pictures=pictures,
    )


def _which(report: Report) -> tuple[list[dict[str, object]], list[tuple[str, str]]]:
    """Return the template values of the section "Which": causes with a bar, and the others.

    A cause has a bar if its effect is named in the verdict, or if it is among the ``TOP_CAUSES``
    most probable ones with a probability of ``LEAST_PROBABILITY`` or more.

    Returns:
        Values of each cause with a bar, see ``_cause``; effect id and probability as text of each
        of the others. Both in the order of ``report.causes``, the most probable first.
    """
    verdict = named_effects(report.verdict)
    listed = [
        cause
        for i, cause in enumerate(report.causes)
        if cause.effect in verdict or (i < TOP_CAUSES and cause.probability >= LEAST_PROBABILITY)
    ]
    shown = {cause.effect for cause in listed}
    return [_cause(cause, cause.effect in verdict) for cause in listed], [
        (cause.effect, percent(cause.probability))
        for cause in report.causes
        if cause.effect not in shown
    ]


def _cause(cause: Cause, named: bool) -> dict[str, object]:
    details = [] if cause.effect in OUTSIDE else [words.place_words(cause)]
    details += [
        words.parameter_words(name, value)
        for name, value in cause.parameters.items()
        if name != "member"
    ]
    return {
        "named": named,
        "effect": cause.effect,
        "title": words.capital(words.effect_words(cause.effect)),
        "width": f"{100 * cause.probability:.1f}%",
        "probability": percent(cause.probability),
        "details": details,
    }
