"""Verdict of a diagnosis from the probabilities of all explanations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from herringbone_sim.diagnosis.judge import Chance
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.learned_law import LearnedLaw
from herringbone_sim.gap.named import NamedEffect

MOST_NAMED = 4  # effects of an ambiguous class, contract of the report
HALF = 0.5  # probability above which an effect is rather there than not
CLASS_PROBABILITY = 0.9  # least probability of an ambiguous class, among all effects


@dataclass(frozen=True)
class NamedExplanation:
    """One or two effects that explain a gap.

    Attributes:
        actives: effects with parameters.
        intervals: 90 % interval of each parameter of each effect.
        laws: learned curves, of effects that have one.
        departures: of learned curves from the catalogue's, which the augmented model includes.
    """

    actives: tuple[Active, ...]
    intervals: tuple[tuple[tuple[float, float], ...], ...] = ()
    laws: tuple[LearnedLaw, ...] = ()
    departures: tuple[Active, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """Result of a diagnosis.

    Attributes:
        verdict: ``none``, ``unknown``, ``ambiguous`` or the id of an effect.
        effects: ids of the effects found, at most two.
        probabilities: of every effect, ``none`` and ``unknown``; sums to 1.
        best: most probable explanation of each effect, and the index of the effect in it.
        ambiguous_with: ids of the ambiguous class; empty unless ambiguous.
        metric: observation in which the gap is measured.
        chosen: explanation in the augmented model; None without effects.
        runner_up: most probable explanation by other effects.
        chances: probabilities of all explanations, best first.
    """

    verdict: str
    effects: tuple[str, ...]
    probabilities: Mapping[str, float]
    best: Mapping[str, tuple[NamedExplanation, int]]
    ambiguous_with: tuple[str, ...]
    metric: str
    chosen: NamedExplanation | None
    runner_up: NamedExplanation | None
    chances: tuple[Chance, ...]


def explanation_of(effects: Sequence[NamedEffect]) -> NamedExplanation:
    """Join named effects to an explanation."""
    return NamedExplanation(
        tuple(n.active for n in effects),
        tuple(n.intervals for n in effects),
        tuple(n.law for n in effects if n.law is not None),
        tuple(one for n in effects for one in n.departures),
    )


def decide(
    chances: Sequence[Chance], explanations: Mapping[int, NamedExplanation], metric: str
) -> Verdict:
    """Decide the verdict from the probabilities of all explanations.

    An effect with something unknown beside it gives half to each, as a pair does. Of two with the
    same probability, the verdict is the one that the likeliest explanation names first.

    Args:
        chances: probabilities of all explanations, best first.
        explanations: complete ones with effects, by their index in ``chances``.
        metric: observation in which the gap is measured.
    """
    named_first = dict.fromkeys(name for c in chances for name in c.effects or ("none",))
    every = dict.fromkeys((*named_first, *known_effects(), "none", "unknown"))
    probabilities = {name: 0.0 for name in every}
    present = dict(probabilities)  # alone or beside another
    best: dict[str, tuple[NamedExplanation, int]] = {}
    for i, one in enumerate(chances):
        for j, name in enumerate(one.effects or ("none",)):
            probabilities[name] += one.probability / max(len(one.effects), 1)
            present[name] += one.probability
            if i in explanations:
                best.setdefault(name, (explanations[i], j))
    top = max(probabilities, key=lambda name: probabilities[name])
    first = _first_whole(chances, top)
    chosen = explanations.get(first)
    if top == "unknown":
        chosen = next((explanations[i] for i in sorted(explanations)), None)
    named = () if chosen is None else tuple(a.effect.id for a in chosen.actives)
    effects = () if top in ("none", "unknown") else tuple(dict.fromkeys((top, *named)))[:2]
    certain = top in ("none", "unknown") or present[top] > HALF
    alike = () if certain else _ambiguous_class(probabilities)
    runner = next(
        (
            explanations[i]
            for i in sorted(explanations)
            if not set(named) & {a.effect.id for a in explanations[i].actives}
        ),
        None,
    )
    return Verdict(
        "ambiguous" if alike else top,
        effects,
        probabilities,
        best,
        alike,
        metric,
        chosen if top != "none" else None,
        runner if top not in ("none", "unknown") else None,
        tuple(chances),
    )


def _first_whole(chances: Sequence[Chance], top: str) -> int:
    """Index of the likeliest explanation with ``top``, without anything unknown beside it."""
    having = [i for i, c in enumerate(chances) if top in (c.effects or ("none",))]
    whole = [i for i in having if chances[i].whole]
    likeliest = chances[having[0]] if having else None
    known = () if likeliest is None else tuple(e for e in likeliest.effects if e != "unknown")
    same = [
        i
        for i in whole
        if likeliest is not None
        and chances[i].effects == known
        and chances[i].candidate is likeliest.candidate
    ]
    return next(iter((*same, *whole)), 0)


def _ambiguous_class(probabilities: Mapping[str, float]) -> tuple[str, ...]:
    """Most probable effects that together have ``CLASS_PROBABILITY`` of that of all effects."""
    ranked = sorted(
        (n for n in probabilities if n not in ("none", "unknown")),
        key=lambda n: -probabilities[n],
    )
    total, found = 0.0, []
    whole = sum(probabilities[n] for n in ranked)
    for name in ranked[:MOST_NAMED]:
        found.append(name)
        total += probabilities[name]
        if total >= CLASS_PROBABILITY * whole:
            break
    return tuple(found) if len(found) > 1 else ()
