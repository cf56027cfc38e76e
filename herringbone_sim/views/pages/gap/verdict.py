"""Headline of a gap report, and its boxes: where, which, how much."""

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
        causes = ": " + "; or ".join(names) if names else ""
        return f"There is a gap, but these data cannot tell which cause it has{causes}"
    if len(effects) > 1:
        return f"Two causes together: {'; and '.join(effects)}"
    return words.capital(words.effect_words(verdict))


def _alternatives(report: Part) -> list[str]:
    ids = [*sequence(report.get("effects")), *sequence(report.get("ambiguous_with"))]
    return [words.effect_words(effect) for effect in dict.fromkeys(map(words.word, ids))]


def named_effects(report: Part) -> list[str]:
    """Ids of the effects that the verdict names, or between which it can't decide."""
    verdict = words.word(report.get("verdict"))
    ids = [words.word(effect) for effect in sequence(report.get("effects"))]
    if verdict == "ambiguous":
        ids += [words.word(effect) for effect in sequence(report.get("ambiguous_with"))]
    return list(dict.fromkeys(ids or [verdict]))


def named_causes(report: Part) -> list[Part]:
    """The most probable cause of each effect of ``named_effects``."""
    causes = [mapping(cause) for cause in sequence(report.get("causes"))]
    first = (
        next((c for c in causes if c.get("effect") == effect), None)
        for effect in named_effects(report)
    )
    return [cause for cause in first if cause is not None]


def located_causes(report: Part) -> list[Part]:
    """Those of ``named_causes`` that have a place: neither ``none`` nor ``unknown``."""
    return [cause for cause in named_causes(report) if cause.get("effect") not in OUTSIDE]


def kind(report: Part) -> str:
    """Kind of the verdict: ``none``, ``unknown``, ``ambiguous``, ``pair`` or ``one``."""
    verdict = words.word(report.get("verdict"))
    if verdict in (*OUTSIDE, "ambiguous"):
        return verdict
    return "pair" if len(named_effects(report)) > 1 else "one"


def answers(report: Part) -> str:
    """HTML of three boxes: where, which, how much."""
    boxes = (("Where", *_place(report)), ("Which", *_name(report)), ("How much", *_size(report)))
    parts = (
        f"<div><span>{escape(title)}</span><b>{escape(main)}</b><span>{escape(more)}</span></div>"
        for title, main, more in boxes
    )
    return f'<div class="answers">{"".join(parts)}</div>'


def _place(report: Part) -> tuple[str, str]:
    """Places of the named effects, and the mesh with the largest share of the residual."""
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
    places = dict.fromkeys(words.place_words(cause) for cause in located_causes(report))
    if places and _any_planet(report, entries):
        return words.capital(" / ".join(places)), "or at another planet: nothing tells them apart"
    return words.capital(" / ".join(places)) if places else "No place named", share


def _any_planet(report: Part, entries: list[Part]) -> bool:
    """Whether a cause sits at one planet, and all planets have the same share."""
    planets: dict[str, float] = {}
    for entry in entries:
        planet = words.word(mapping(entry.get("locus")).get("planet"))
        planets[planet] = planets.get(planet, 0.0) + (known(entry.get("share")) or 0.0)
    shares = list(planets.values())
    planets_named = [mapping(c.get("locus")).get("planet") for c in located_causes(report)]
    single = any(planet not in ("all", None) for planet in planets_named)
    return single and len(shares) > 1 and math.isclose(min(shares), max(shares))


def _name(report: Part) -> tuple[str, str]:
    joint = {"ambiguous": " or ", "pair": " and "}.get(kind(report), "")
    every = (known(cause.get("probability")) for cause in named_causes(report))
    chances = [chance for chance in every if chance is not None]
    total = percent(min(sum(chances), 1.0)) if chances else words.NOT_KNOWN
    together = "together " if len(chances) > 1 else ""
    return joint.join(named_effects(report)), f"probability {together}{total}"


def _size(report: Part) -> tuple[str, str]:
    gap = mapping(report.get("gap"))
    change = f"{words.figure(gap.get('nominal'))} → {residual_words(gap.get('augmented'), gap)}"
    floor = residual_words(gap.get("noise_floor"), gap)
    closes = words.closure_words(gap.get("closure"), kind(report))
    return change, f"on held-out runs; noise floor {floor}; {closes}"
