"""``report.html`` of a diagnosis: verdict, places, causes, size of the gap, next experiment."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from html import escape
from pathlib import Path

from herringbone_sim.gap.data.screen import finding_texts
from herringbone_sim.gap.report import Cause, Report
from herringbone_sim.gap.verdict.next_experiment import NextExperiment
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.gap import GapArrays, write_gap_figures
from herringbone_sim.views.figures.gap_laws import write_law_figures
from herringbone_sim.views.pages.gap import words
from herringbone_sim.views.pages.gap.senses import distances_table, senses_table
from herringbone_sim.views.pages.gap.style import STYLE
from herringbone_sim.views.pages.gap.tables import noise_table, runs_table
from herringbone_sim.views.pages.gap.verdict import OUTSIDE, answers, headline, kind, named_effects
from herringbone_sim.views.pages.gap.where import where_section
from herringbone_sim.views.pages.gap.words import percent
from herringbone_sim.views.pages.html import Picture, bullets, html_page, picture_html, section

POINT = (
    ("delta_T", "temperature rise", "K"),
    ("T_1", "input torque", "N m"),
    ("Omega", "speed Ω", ""),
    ("K", "control K", ""),
)
NOTHING_OPEN = "<p>Nothing that these data leave open was found.</p>"
TOP_CAUSES, LEAST_PROBABILITY = 6, 0.005  # causes listed with a bar
FURTHER = ("a_c", "F_pin1", "F_rp1_L", "u_p1_L")  # one sensor of each kind that may be added


def write_gap_page(
    report: Report, folder: Path, arrays: GapArrays | None = None, nominal: Path | None = None
) -> Path:
    """Write ``report.html``, pictures included, and ``figures/``; returns the page.

    Args:
        report: of a diagnosis.
        folder: made if new; an earlier page is overwritten.
        arrays: content of the figures; None for no figures of the residual.
        nominal: parameter file of the rig, for the commands that the page suggests.

    Raises:
        AnalysisError: the folder can't be written.
    """
    make_folder(folder)
    pictures = write_law_figures(folder, report.laws)
    pictures += write_gap_figures(folder, arrays) if arrays else []
    page = folder / "report.html"
    commands = (
        (compare_command(nominal, folder), plan_command(report, nominal, folder))
        if nominal
        else ("", "")
    )
    page.write_text(gap_page(report, pictures, *commands), encoding="utf-8")
    return page


def plan_command(report: Report, nominal: Path, folder: Path) -> str:
    """Shell command that plans further sensors; empty unless the report rests on few sensors."""
    recorded = sorted(report.noise)
    more = [name for name in FURTHER if name not in recorded]
    if "trajectory" not in report.observations or not more:
        return ""
    options = ["--sensors", ",".join(recorded), "--also", ",".join(more)]
    words = ["python", "-m", "herringbone_sim", "gap", "plan", "--nominal", str(nominal), *options]
    return shlex.join([*words, "--out", str(folder / "plan")])


def compare_command(nominal: Path, folder: Path) -> str:
    """Shell command that compares the bifurcations of the nominal and the augmented gear."""
    files = [nominal, folder / "augmented.yaml"]
    words = ["python", "-m", "herringbone_sim", "compare", *map(str, files)]
    return shlex.join([*words, "--over", "delta_T=0:100:400", "--out", str(folder / "compared")])


def gap_page(
    report: Report, pictures: Sequence[Picture] = (), command: str = "", planned: str = ""
) -> str:
    """The complete page; ``command`` of ``compare_command``, ``planned`` of ``plan_command``."""
    name = report.campaign
    # A limit that is a fault too is said above.
    said = {finding.text for finding in report.findings}
    undecidable = bullets(text for text in report.undecidable if text not in said)
    following = _next(report.next_experiment)
    senses = senses_table(report.senses, report.runner_up_effects)
    body = [
        f'<p class="kicker">Gap diagnosis &nbsp;·&nbsp; {escape(name)}</p>',
        f"<h1>{escape(headline(report.verdict))}</h1>",
        answers(report),
        section("What is wrong with the recording", bullets(finding_texts(report.findings))),
        f"<h2>Where</h2>{where_section(report)}",
        f"<h2>Which</h2>{_which(report)}",
        f"<h2>How much</h2>{runs_table(report.gap, kind(report.verdict))}",
        section("In three senses, on held-out runs", senses),
        f'<div class="two"><div><h2>What is not decidable</h2>{undecidable or NOTHING_OPEN}</div>',
        f"<div><h2>What to measure next</h2>{following}{_planned(planned)}</div></div>",
        section("What the real gear will do", _compared(command)),
        section("Noise, as the recording shows it", noise_table(report.noise)),
        section("Attractor", distances_table(report.senses)),
        section("Figures", "".join(picture_html(picture) for picture in pictures)),
        "<footer>The same in numbers: report.json, beside this page.</footer>",
    ]
    return html_page(f"Gap: {name}", body, STYLE)


def _which(report: Report) -> str:
    verdict = named_effects(report.verdict)
    listed = [
        cause
        for i, cause in enumerate(report.causes)
        if cause.effect in verdict or (i < TOP_CAUSES and cause.probability >= LEAST_PROBABILITY)
    ]
    rows = "".join(_cause(cause, cause.effect in verdict) for cause in listed)
    small = "".join(
        f"<li><span>{escape(cause.effect)}</span>"
        f"<span>{escape(percent(cause.probability))}</span></li>"
        for cause in report.causes
        if cause.effect not in {one.effect for one in listed}
    )
    return rows + (f'<ul class="rest">{small}</ul>' if small else "")


def _cause(cause: Cause, named: bool) -> str:
    texts = [] if cause.effect in OUTSIDE else [words.place_words(cause)]
    texts += [
        words.parameter_words(name, value)
        for name, value in cause.parameters.items()
        if name != "member"
    ]
    more = escape("; ".join(texts)) + (" &nbsp;·&nbsp; " if texts else "")
    return (
        f'<div class="cause{" said" if named else ""}">'
        f"<b>{escape(words.capital(words.effect_words(cause.effect)))}</b>"
        f'<div class="bar"><span style="width:{100 * cause.probability:.1f}%"></span></div>'
        f'<i class="p">{escape(percent(cause.probability))}</i>'
        f"<small>{more}<code>{escape(cause.effect)}</code></small></div>"
    )


def _next(experiment: NextExperiment) -> str:
    cells = "".join(
        f"<div><b>{escape(words.figure(experiment.point[key], 4))} {unit}</b>"
        f"<span>{title}</span></div>"
        for key, title, unit in POINT
    )
    why = escape(words.capital(experiment.why))
    return f'<div class="point">{cells}</div><p>{why}</p>'


def _planned(command: str) -> str:
    if not command:
        return ""
    return (
        "<p>What one further sensor would tell, before it is bought:</p>"
        f"<pre><code>{escape(command)}</code></pre>"
    )


def _compared(command: str) -> str:
    if not command:
        return ""
    return (
        "<p>Both gears over one another, bifurcations, exponents, contact and coexisting motions, "
        f"are drawn by</p><pre><code>{escape(command)}</code></pre>"
    )
