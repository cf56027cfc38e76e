"""``report.html`` of a diagnosis: verdict, places, causes, size of the gap, next experiment."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from html import escape
from pathlib import Path

from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.gap import GapArrays, write_gap_figures
from herringbone_sim.views.figures.gap_laws import write_law_figures
from herringbone_sim.views.pages.gap import words
from herringbone_sim.views.pages.gap.senses import distances_table, senses_table
from herringbone_sim.views.pages.gap.style import STYLE
from herringbone_sim.views.pages.gap.tables import attractor_table, noise_table, runs_table
from herringbone_sim.views.pages.gap.verdict import OUTSIDE, answers, headline, kind, named_effects
from herringbone_sim.views.pages.gap.where import where_section
from herringbone_sim.views.pages.gap.words import (
    NOT_KNOWN,
    Part,
    known,
    mapping,
    percent,
    sequence,
)
from herringbone_sim.views.pages.html import Picture, bullets, html_page, picture_html, section

POINT = (
    ("delta_T", "temperature rise", "K"),
    ("T_1", "input torque", "N m"),
    ("Omega", "speed Ω", ""),
    ("K", "control K", ""),
)
TOP_CAUSES, LEAST_PROBABILITY = 6, 0.005  # causes listed with a bar
FURTHER = ("a_c", "F_pin1", "F_rp1_L", "u_p1_L")  # one sensor of each kind that may be added


def write_gap_page(
    report: Part, folder: Path, arrays: GapArrays | None = None, nominal: Path | None = None
) -> Path:
    """Write ``report.html``, pictures included, and ``figures/``; returns the page.

    Args:
        report: of the schema ``herringbone_sim/gap-report/1``; what is absent or null in it is
            shown as not known.
        folder: made if new; an earlier page is overwritten.
        arrays: content of the figures; None for no figures of the residual.
        nominal: parameter file of the rig, for the commands that the page suggests.

    Raises:
        AnalysisError: the folder can't be written.
    """
    make_folder(folder)
    pictures = write_law_figures(folder, sequence(report.get("law")))
    pictures += write_gap_figures(folder, arrays) if arrays else []
    page = folder / "report.html"
    commands = (
        (compare_command(nominal, folder), plan_command(report, nominal, folder))
        if nominal
        else ("", "")
    )
    page.write_text(gap_page(report, pictures, *commands), encoding="utf-8")
    return page


def plan_command(report: Part, nominal: Path, folder: Path) -> str:
    """Shell command that plans further sensors; empty unless the report rests on few sensors."""
    recorded = [str(name) for name in sequence(report.get("recorded"))]
    more = [name for name in FURTHER if name not in recorded]
    if "trajectory" not in sequence(report.get("observations")) or not more:
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
    report: Part, pictures: Sequence[Picture] = (), command: str = "", planned: str = ""
) -> str:
    """The complete page; ``command`` of ``compare_command``, ``planned`` of ``plan_command``."""
    name = words.word(report.get("campaign"), "campaign of unknown name")
    body = [
        f'<p class="kicker">Gap diagnosis &nbsp;·&nbsp; {escape(name)}</p>',
        f"<h1>{escape(headline(report))}</h1>",
        answers(report),
        section("What is wrong with the recording", bullets(_faults(report))),
        f"<h2>Where</h2>{where_section(report)}",
        f"<h2>Which</h2>{_which(report)}",
        f"<h2>How much</h2>{runs_table(mapping(report.get('gap')), kind(report))}",
        section("In three senses, on held-out runs", senses_table(mapping(report.get("gap")))),
        f'<div class="two"><div><h2>What is not decidable</h2>{_undecidable(report)}</div>',
        f"<div><h2>What to measure next</h2>{_next(report)}{_planned(planned)}</div></div>",
        section("What the real gear will do", _compared(command)),
        section("Noise, as the recording shows it", noise_table(mapping(report.get("noise")))),
        section("Attractor", _attractor(mapping(report.get("attractor")))),
        section("Figures", "".join(picture_html(picture) for picture in pictures)),
        "<footer>The same in numbers: report.json, beside this page.</footer>",
    ]
    return html_page(f"Gap: {name}", body, STYLE)


def _which(report: Part) -> str:
    causes = [mapping(cause) for cause in sequence(report.get("causes"))]
    if not causes:
        return f"<p>The probabilities of the causes are {NOT_KNOWN}.</p>"
    verdict = named_effects(report)
    listed = [c for i, c in enumerate(causes) if c.get("effect") in verdict or _is_likely(i, c)]
    rest = [cause for cause in causes if not any(cause is c for c in listed)]
    rows = "".join(_cause(cause, cause.get("effect") in verdict) for cause in listed)
    small = "".join(
        f"<li><span>{escape(words.word(c.get('effect')))}</span>"
        f"<span>{escape(percent(c.get('probability')))}</span></li>"
        for c in rest
    )
    others = f'<ul class="rest">{small}</ul>' if rest else ""
    return rows + others


def _is_likely(rank: int, cause: Part) -> bool:
    chance = known(cause.get("probability"))
    return rank < TOP_CAUSES and (chance is None or chance >= LEAST_PROBABILITY)


def _cause(cause: Part, named: bool) -> str:
    effect, chance = words.word(cause.get("effect")), known(cause.get("probability"))
    width = 100 * min(max(chance or 0.0, 0.0), 1.0)
    parameters = {k: v for k, v in mapping(cause.get("parameters")).items() if k != "member"}
    texts = [] if effect in OUTSIDE else [words.place_words(cause)]
    texts += [words.parameter_words(str(name), p) for name, p in parameters.items()]
    more = escape("; ".join(texts)) + (" &nbsp;·&nbsp; " if texts else "")
    return (
        f'<div class="cause{" said" if named else ""}">'
        f"<b>{escape(words.capital(words.effect_words(effect)))}</b>"
        f'<div class="bar"><span style="width:{width:.1f}%"></span></div>'
        f'<i class="p">{escape(percent(chance))}</i>'
        f"<small>{more}<code>{escape(effect)}</code></small></div>"
    )


def _faults(report: Part) -> list[str]:
    return [words.plain(mapping(f).get("text")) for f in sequence(report.get("findings"))]


def _undecidable(report: Part) -> str:
    if report.get("undecidable") is None:
        return f"<p>Whether these data leave anything open is {NOT_KNOWN}.</p>"
    items = [words.plain(text) for text in sequence(report.get("undecidable"))]
    items = [item for item in items if item not in _faults(report)]
    others = sequence(report.get("ambiguous_with"))
    if others and report.get("verdict") != "ambiguous":
        names = "; ".join(words.effect_words(effect) for effect in others)
        items.insert(0, f"These data do not tell it from: {names}.")
    return bullets(items) or "<p>Nothing that these data leave open was found.</p>"


def _next(report: Part) -> str:
    point = mapping(report.get("next_experiment"))
    if not point:
        return f"<p>Which operating point would tell more is {NOT_KNOWN}.</p>"
    cells = "".join(
        f"<div><b>{escape(words.figure(point.get(key), 4))} {unit}</b><span>{title}</span></div>"
        for key, title, unit in POINT
    )
    why = words.plain(point.get("why") or f"Why this point is {NOT_KNOWN}.")
    return f'<div class="point">{cells}</div><p>{escape(words.capital(why))}</p>'


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


def _attractor(attractor: Part) -> str:
    return distances_table(attractor) or attractor_table(attractor)
