"""The verdict of a gap report in a sentence, and in three answers: where, which, how much."""

from __future__ import annotations

import math
from html import escape

from herringbone_sim.views.pages.gap import words
from herringbone_sim.views.pages.gap.words import (
    Part,
    known,
    mapping,
    percent,
    residual_words,
    sequence,
)

OUTSIDE = ("none", "unknown")


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


def said(report: Part) -> list[Part]:
    """The most probable cause of each id that the verdict names."""
    causes = [mapping(cause) for cause in sequence(report.get("causes"))]
    first = (next((c for c in causes if c.get("effect") == one), None) for one in named(report))
    return [cause for cause in first if cause is not None]


def sited(report: Part) -> list[Part]:
    """Of the causes that the verdict names, those that have a place."""
    return [cause for cause in said(report) if cause.get("effect") not in OUTSIDE]


def kind(report: Part) -> str:
    """``none``, ``unknown``, ``ambiguous``, ``pair`` or ``one``."""
    verdict = words.word(report.get("verdict"))
    if verdict in (*OUTSIDE, "ambiguous"):
        return verdict
    return "pair" if len(named(report)) > 1 else "one"


def answers(report: Part) -> str:
    """Three boxes: where, which, how much."""
    boxes = (("Where", *_place(report)), ("Which", *_name(report)), ("How much", *_size(report)))
    told = (
        f"<div><span>{escape(title)}</span><b>{escape(main)}</b><span>{escape(more)}</span></div>"
        for title, main, more in boxes
    )
    return f'<div class="answers">{"".join(told)}</div>'


def _place(report: Part) -> tuple[str, str]:
    """Where the named effects sit; which mesh holds most of the residual."""
    entries = [mapping(entry) for entry in sequence(report.get("where"))]
    top = max(entries, key=lambda entry: known(entry.get("share")) or 0.0, default=None)
    share = "share of the residual not known"
    if top is not None:
        place = words.locus_words(top.get("locus"))
        what = "largest share of the residual"
        if mapping(report.get("gap")).get("metric") == "trajectory":
            what = "largest chance to hold the cause"
        share = f"{what}: {place} ({percent(top.get('share'))})"
        if known(top.get("share")) == 0.0:
            share = "no residual in the meshes above the noise"
    if kind(report) == "none":
        return "Nowhere beyond the noise", share
    told = dict.fromkeys(words.place_words(cause) for cause in sited(report))
    if told and _any_planet(report, entries):
        return words.capital(" / ".join(told)), "or at another planet: nothing tells them apart"
    return words.capital(" / ".join(told)) if told else "No place named", share


def _any_planet(report: Part, entries: list[Part]) -> bool:
    """Whether a cause sits at one planet, and all planets have the same share."""
    planets: dict[str, float] = {}
    for entry in entries:
        planet = words.word(mapping(entry.get("locus")).get("planet"))
        planets[planet] = planets.get(planet, 0.0) + (known(entry.get("share")) or 0.0)
    shares = list(planets.values())
    one = any(mapping(c.get("locus")).get("planet") not in ("all", None) for c in sited(report))
    return one and len(shares) > 1 and math.isclose(min(shares), max(shares))


def _name(report: Part) -> tuple[str, str]:
    joint = {"ambiguous": " or ", "pair": " and "}.get(kind(report), "")
    chances = [known(cause.get("probability")) for cause in said(report)]
    found = [chance for chance in chances if chance is not None]
    total = percent(min(sum(found), 1.0)) if found else words.NOT_KNOWN
    together = "together " if len(found) > 1 else ""
    return joint.join(named(report)), f"probability {together}{total}"


def _size(report: Part) -> tuple[str, str]:
    gap = mapping(report.get("gap"))
    change = f"{words.figure(gap.get('nominal'))} → {residual_words(gap.get('augmented'), gap)}"
    floor = residual_words(gap.get("noise_floor"), gap)
    closes = words.closure_words(gap.get("closure"), kind(report))
    return change, f"on held-out runs; noise floor {floor}; {closes}"
