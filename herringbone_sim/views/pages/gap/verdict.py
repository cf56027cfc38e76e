"""Headline of a gap report, and its boxes: where, which, how much."""

from __future__ import annotations

import math

from herringbone_sim.gap.report import Cause, Report
from herringbone_sim.gap.verdict.decide import Verdict
from herringbone_sim.views.numbers import figure, percent
from herringbone_sim.views.pages.gap import words
from herringbone_sim.views.pages.gap.words import residual_words

OUTSIDE = ("none", "unknown")


def headline(verdict: Verdict) -> str:
    """The verdict as a sentence."""
    if verdict.verdict == "none":
        return "No gap: the nominal model, within its tolerance, explains these runs"
    if verdict.unobserved:
        return "Whether there is a gap is not known: these channels allow no diagnosis"
    if verdict.verdict == "unknown":
        return "There is a gap, and nothing in the catalogue explains it"
    effects = [words.effect_words(effect) for effect in named_effects(verdict)]
    if verdict.verdict == "ambiguous":
        causes = "; or ".join(effects)
        return f"There is a gap, but these data cannot tell which cause it has: {causes}"
    if len(effects) > 1:
        return f"Two causes together: {'; and '.join(effects)}"
    return words.capital(effects[0])


def named_effects(verdict: Verdict) -> list[str]:
    """Return the ids of the effects that a verdict names, or between which it can't decide.

    For a verdict without effects: ``none`` or ``unknown``.
    """
    ids = (*verdict.effects, *verdict.ambiguous_with) or (verdict.verdict,)
    return list(dict.fromkeys(ids))


def named_causes(report: Report) -> list[Cause]:
    """Return the causes in a report with the ids of ``named_effects``."""
    causes = {cause.effect: cause for cause in report.causes}
    return [causes[effect] for effect in named_effects(report.verdict) if effect in causes]


def located_causes(report: Report) -> list[Cause]:
    """Return the ``named_causes`` without ``none`` and ``unknown``, which have no place."""
    return [cause for cause in named_causes(report) if cause.effect not in OUTSIDE]


def kind(verdict: Verdict) -> str:
    """Kind of the verdict: ``none``, ``unknown``, ``ambiguous``, ``pair`` or ``one``."""
    if verdict.verdict in (*OUTSIDE, "ambiguous"):
        return verdict.verdict
    return "pair" if len(named_effects(verdict)) > 1 else "one"


def answers(report: Report) -> list[tuple[str, str, str]]:
    """Return title, answer and remark of the three boxes of the page: where, which, how much."""
    return [("Where", *_place(report)), ("Which", *_name(report)), ("How much", *_size(report))]


def _place(report: Report) -> tuple[str, str]:
    """Return the places of the named effects as text, and a remark on the residual by mesh."""
    share = "share of the residual not known"
    if report.where:
        locus, largest = report.where[0]
        what = "largest share of the residual"
        if report.gap.metric == "trajectory":
            what = "largest chance to hold the cause"
        share = f"{what}: {words.locus_words(locus)} ({percent(largest)})"
        if largest == 0.0:
            share = "no residual in the meshes above the noise"
    if kind(report.verdict) == "none":
        return "Nowhere beyond the noise", share
    places = dict.fromkeys(words.place_words(cause) for cause in located_causes(report))
    if places and _any_planet(report):
        share = "or at another planet: nothing tells them apart"
    return words.capital(" / ".join(places)) if places else "No place named", share


def _any_planet(report: Report) -> bool:
    """Return whether a cause is at one planet but all planets have equal parts of the residual."""
    planets: dict[str, float] = {}
    for locus, share in report.where:
        planets[locus.planet] = planets.get(locus.planet, 0.0) + share
    shares = list(planets.values())
    single = any(cause.locus.planet != "all" for cause in located_causes(report))
    return single and len(shares) > 1 and math.isclose(min(shares), max(shares))


def _name(report: Report) -> tuple[str, str]:
    joint = {"ambiguous": " or ", "pair": " and "}.get(kind(report.verdict), "")
    chances = [cause.probability for cause in named_causes(report)]
    together = "together " if len(chances) > 1 else ""
    total = percent(min(sum(chances), 1.0))
    return joint.join(named_effects(report.verdict)), f"probability {together}{total}"


def _size(report: Report) -> tuple[str, str]:
    gap = report.gap.numbers()
    change = f"{figure(gap.nominal)} → {residual_words(gap.augmented, gap.unit)}"
    floor = residual_words(gap.noise_floor, gap.unit)
    closes = words.closure_words(gap.closure, kind(report.verdict))
    return change, f"on held-out runs; noise floor {floor}; {closes}"
