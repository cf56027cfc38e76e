"""``report.html`` of a gap diagnosis: where, which, how much, what is open, what to do next."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from herringbone_sim.sweeps.kept import make_folder
from herringbone_sim.views import gap_words as words
from herringbone_sim.views.gap_figures import GapArrays, write_gap_figures
from herringbone_sim.views.gap_style import STYLE
from herringbone_sim.views.gap_tables import attractor_table, runs_table
from herringbone_sim.views.gap_words import NOT_KNOWN, Part, known, mapping, percent, sequence
from herringbone_sim.views.gear_drawing import covered, gear_svg, mesh_shares
from herringbone_sim.views.report import CSS, Picture, picture_html

POINT = (
    ("delta_T", "temperature rise", "K"),
    ("T_1", "input torque", "N m"),
    ("Omega", "speed Ω", ""),
    ("K", "control K", ""),
)
SHOWN_CAUSES, LEAST_SHOWN = 6, 0.005
OUTSIDE = ("none", "unknown")


def write_gap_page(report: Part, folder: Path, arrays: GapArrays | None = None) -> Path:
    """Write ``report.html`` (nothing outside it) and ``figures/``; returns the page.

    Args:
        report: after the schema ``herringbone_sim/gap-report/1``; what is absent or null in it
            is told as not known.
        folder: made when it is new; a page of earlier is overwritten.
        arrays: what the figures beneath show; without them there are none.

    Raises:
        AnalysisError: the folder can't be written.
    """
    make_folder(folder)
    pictures = write_gap_figures(folder, arrays) if arrays else []
    page = folder / "report.html"
    page.write_text(gap_page(report, pictures), encoding="utf-8")
    return page


def gap_page(report: Part, pictures: Sequence[Picture] = ()) -> str:
    """The whole page as text."""
    name = words.word(report.get("campaign"), "campaign of unknown name")
    body = [
        f'<p class="kicker">Gap diagnosis &nbsp;·&nbsp; {escape(name)}</p>',
        f"<h1>{escape(headline(report))}</h1>",
        _answers(report),
        f"<h2>Where</h2>{_where(report)}",
        f"<h2>Which</h2>{_which(report)}",
        f"<h2>How much</h2>{runs_table(mapping(report.get('gap')))}",
        f'<div class="two"><div><h2>What is not decidable</h2>{_undecidable(report)}</div>',
        f"<div><h2>What to measure next</h2>{_next(report)}</div></div>",
        _optional("Attractor", attractor_table(mapping(report.get("attractor")))),
        _optional("Figures", "".join(picture_html(picture) for picture in pictures)),
        "<footer>The same in numbers: report.json, beside this page.</footer>",
    ]
    head = f'<meta charset="utf-8"><title>Gap: {escape(name)}</title><style>{CSS}{STYLE}</style>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{"".join(body)}</body></html>'


def headline(report: Part) -> str:
    """The verdict as a sentence."""
    verdict = words.word(report.get("verdict"), "")
    effects = [words.effect_words(e) for e in sequence(report.get("effects"))]
    if not verdict:
        return "The report gives no verdict"
    if verdict == "none":
        return "No gap: the nominal model, within its tolerance, explains these runs"
    if verdict == "unknown":
        return "There is a gap, and nothing in the catalogue explains it"
    if verdict == "ambiguous":
        names = _alternatives(report)
        told = ": " + "; or ".join(names) if names else ""
        return f"There is a gap, but these data cannot tell which cause it has{told}"
    if len(effects) > 1:
        return f"Two causes together: {'; and '.join(effects)}"
    return words.capital(words.effect_words(verdict))


def _alternatives(report: Part) -> list[str]:
    ids = [*sequence(report.get("effects")), *sequence(report.get("ambiguous_with"))]
    return [words.effect_words(effect) for effect in dict.fromkeys(map(words.word, ids))]


def named(report: Part) -> list[str]:
    """Ids that the verdict names: the effects, or all between which it can't decide."""
    verdict = words.word(report.get("verdict"))
    ids = [words.word(one) for one in sequence(report.get("effects"))]
    if verdict == "ambiguous":
        ids += [words.word(one) for one in sequence(report.get("ambiguous_with"))]
    return list(dict.fromkeys(ids or [verdict]))


def _said(report: Part) -> list[Part]:
    """The most probable cause of each id that the verdict names."""
    causes = [mapping(cause) for cause in sequence(report.get("causes"))]
    first = [next((c for c in causes if c.get("effect") == one), None) for one in named(report)]
    return [cause for cause in first if cause is not None]


def _answers(report: Part) -> str:
    gap = mapping(report.get("gap"))
    said = _said(report)
    chances = [known(cause.get("probability")) for cause in said]
    total = (
        sum(c for c in chances if c is not None) if any(c is not None for c in chances) else None
    )
    change = f"{words.figure(gap.get('nominal'))} → {words.figure(gap.get('augmented'))}"
    floor = f"noise floor {words.figure(gap.get('noise_floor'))}"
    tiles = [
        ("Where", *_largest(report)),
        ("Which", _ids(report), f"probability {percent(total)}"),
        ("How much, held out", change, f"{floor}; {words.closure_words(gap.get('closure'))}"),
    ]
    if report.get("verdict") == "none":
        tiles[2] = ("How much, held out", words.figure(gap.get("nominal")), floor)
    told = (
        f"<div><span>{escape(title)}</span><b>{escape(main)}</b><span>{escape(more)}</span></div>"
        for title, main, more in tiles
    )
    return f'<div class="answers">{"".join(told)}</div>'


def _ids(report: Part) -> str:
    joint = " or " if report.get("verdict") == "ambiguous" else " and "
    return joint.join(named(report))


def _largest(report: Part) -> tuple[str, str]:
    """Where the named effects sit, else where most of the residual is; and the share."""
    entries = [mapping(entry) for entry in sequence(report.get("where"))]
    top = max(entries, key=lambda entry: known(entry.get("share")) or 0.0, default=None)
    share = "share of the residual not known"
    if top is not None:
        place = words.locus_words(top.get("locus"))
        share = f"most of the residual: {place} ({percent(top.get('share'))})"
    sites = [c.get("locus") for c in _said(report) if c.get("effect") not in OUTSIDE]
    told = list(dict.fromkeys(words.locus_words(site) for site in sites))
    if report.get("verdict") == "none":
        return "nowhere beyond the noise", share
    return words.capital(" / ".join(told)) if told else "No place named", share


def _where(report: Part) -> str:
    shares = mesh_shares(report.get("where"))
    sites = [c for c in _said(report) if c.get("effect") not in OUTSIDE]
    marked = {mesh for cause in sites for mesh in covered(cause.get("locus"))}
    # A rim around all twelve tells nothing.
    drawing = gear_svg(shares, marked if len(marked) < len(shares) else (), _bodies(sites))
    notes = []
    if all(share is None for share, _ in shares.values()):
        notes.append("How the residual is shared among the meshes is not known.")
    if any(share is not None and not own for share, own in shares.values()):
        notes.append("Where the report gives one share for several meshes it is spread evenly.")
    metric = mapping(report.get("gap")).get("metric")
    if metric in ("torque_balance", "consistency"):
        what = words.METRICS[metric]
        notes.append(f"What counts here is not the meshes but the {what}.")
    return f'{drawing}<p class="lead">{escape(" ".join(notes))}</p>'


def _bodies(sites: Iterable[Part]) -> set[str]:
    """Bodies that the named effects concern, for a heavy outline."""
    found = set()
    for cause in sites:
        member = mapping(cause.get("parameters")).get("member", cause.get("member"))
        place = mapping(cause.get("locus"))
        member = mapping(member).get("value", member) or place.get("member")
        if cause.get("effect") == "ring_flexibility":
            member = "ring"
        if member == "planet" or cause.get("effect") in ("bearing_clearance", "pin_position"):
            planet = words.word(place.get("planet"), "all")
            found |= {f"planet{p}" for p in ("123" if planet == "all" else planet)}
        elif isinstance(member, str):
            found.add(member)
    return found


def _which(report: Part) -> str:
    causes = [mapping(cause) for cause in sequence(report.get("causes"))]
    if not causes:
        return f"<p>The probabilities of the causes are {NOT_KNOWN}.</p>"
    said = named(report)
    shown = [c for i, c in enumerate(causes) if c.get("effect") in said or _shown(i, c)]
    rest = [cause for cause in causes if not any(cause is one for one in shown)]
    rows = "".join(_cause(cause, cause.get("effect") in said) for cause in shown)
    small = "".join(
        f"<li><span>{escape(words.word(c.get('effect')))}</span>"
        f"<span>{escape(percent(c.get('probability')))}</span></li>"
        for c in rest
    )
    others = f'<ul class="rest">{small}</ul>' if rest else ""
    return rows + others


def _shown(rank: int, cause: Part) -> bool:
    chance = known(cause.get("probability"))
    return rank < SHOWN_CAUSES and (chance is None or chance >= LEAST_SHOWN)


def _cause(cause: Part, said: bool) -> str:
    effect, chance = words.word(cause.get("effect")), known(cause.get("probability"))
    width = 100 * min(max(chance or 0.0, 0.0), 1.0)
    parameters = mapping(cause.get("parameters"))
    told = [] if effect in OUTSIDE else [words.locus_words(cause.get("locus"))]
    told += [words.parameter_words(str(name), value) for name, value in parameters.items()]
    more = escape("; ".join(told)) + (" &nbsp;·&nbsp; " if told else "")
    return (
        f'<div class="cause{" said" if said else ""}">'
        f"<b>{escape(words.capital(words.effect_words(effect)))}</b>"
        f'<div class="bar"><span style="width:{width:.1f}%"></span></div>'
        f'<i class="p">{escape(percent(chance))}</i>'
        f"<small>{more}<code>{escape(effect)}</code></small></div>"
    )


def _undecidable(report: Part) -> str:
    if report.get("undecidable") is None:
        return f"<p>Whether these data leave anything open is {NOT_KNOWN}.</p>"
    items = [words.plain(one) for one in sequence(report.get("undecidable"))]
    others = sequence(report.get("ambiguous_with"))
    if others and report.get("verdict") != "ambiguous":
        told = "; ".join(words.effect_words(one) for one in others)
        items.insert(0, f"These data do not tell it from: {told}.")
    listed = "".join(f"<li>{escape(item)}</li>" for item in items)
    return (
        f"<ul>{listed}</ul>" if items else "<p>Nothing that these data leave open was found.</p>"
    )


def _next(report: Part) -> str:
    point = mapping(report.get("next_experiment"))
    if not point:
        return f"<p>Which operating point would tell more is {NOT_KNOWN}.</p>"
    cells = "".join(
        f"<div><b>{escape(words.figure(point.get(key), 4))} {unit}</b><span>{title}</span></div>"
        for key, title, unit in POINT
    )
    why = words.plain(point.get("why") or f"Why this point is {NOT_KNOWN}.")
    return f'<div class="point">{cells}</div><p>{escape(why)}</p>'


def _optional(title: str, content: str) -> str:
    return f"<h2>{title}</h2>{content}" if content else ""
