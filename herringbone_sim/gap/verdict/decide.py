"""Decide the verdict of a diagnosis from the probabilities of all explanations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from herringbone_sim.diagnosis.judge import Chance
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.learned_law import LearnedLaw
from herringbone_sim.gap.named_effects import NamedEffect

MOST_NAMED = 4  # most effects of an ambiguous class, by the schema of the report
HALF = 0.5  # probability above which an effect is more likely present than absent
CLASS_PROBABILITY = 0.9  # least fraction of the probability of all effects in an ambiguous class


@dataclass(frozen=True)
class NamedExplanation:
    """One or two effects that explain a gap.

    Attributes:
        actives: effects with parameters.
        intervals: 90 % interval (low, high) of each parameter, for each effect.
        laws: learned curves of the effects that have one.
        departures: differences of learned curves from the catalogue's, as effects; the augmented
            model includes them.
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
        effects: ids of the effects found, at most two; the most probable ones if ambiguous.
        probabilities: of every effect, ``none`` and ``unknown``, by id; they sum to 1.
        best: by id, the most probable explanation with the effect, and its index therein.
        ambiguous_with: ids of the ambiguous class; empty unless ambiguous.
        metric: observation in which the gap is measured.
        chosen: explanation in the augmented model; None without effects.
        runner_up: most probable explanation by other effects than the chosen ones; None without.
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

    @property
    def unobserved(self) -> bool:
        """Whether the channels allowed no observation: ``unknown``, as likely as ``none``."""
        return self.verdict == "unknown" and self.probabilities.get("none", 0.0) >= HALF


def explanation_of(effects: Sequence[NamedEffect]) -> NamedExplanation:
    """Combine fitted effects to an explanation."""
    return NamedExplanation(
        tuple(n.active for n in effects),
        tuple(n.intervals for n in effects),
        tuple(n.law for n in effects if n.law is not None),
        tuple(departure for n in effects for departure in n.departures),
    )


def decide(
    chances: Sequence[Chance], explanations: Mapping[int, NamedExplanation], metric: str
) -> Verdict:
    """Decide the verdict from the probabilities of all explanations.

    An explanation by two effects, or by one with something unknown beside it, adds half of its
    probability to each. The verdict is the most probable effect, none or unknown, among equals the
    first in ``chances``. If this is an effect, and the explanations that contain it have together
    (counted in full, not by halves) at most ``HALF``, the verdict is ``ambiguous``, unless the
    effect has ``CLASS_PROBABILITY`` of what all effects have.

    Args:
        chances: probabilities of all explanations, best first.
        explanations: by index in ``chances``, those with effects and nothing unknown beside them.
        metric: observation in which the gap is measured, only passed on to the verdict.
    """
    named_first = dict.fromkeys(name for c in chances for name in c.effects or ("none",))
    names = dict.fromkeys((*named_first, *known_effects(), "none", "unknown"))
    probabilities = {name: 0.0 for name in names}
    present = dict(probabilities)  # probability that an effect is there, alone or in a pair
    best: dict[str, tuple[NamedExplanation, int]] = {}
    for i, chance in enumerate(chances):
        for j, name in enumerate(chance.effects or ("none",)):
            probabilities[name] += chance.probability / max(len(chance.effects), 1)
            present[name] += chance.probability
            if i in explanations:
                best.setdefault(name, (explanations[i], j))
    top = max(probabilities, key=lambda name: probabilities[name])
    first = _first_whole(chances, top)
    chosen = None if first is None else explanations.get(first)
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


def _first_whole(chances: Sequence[Chance], top: str) -> int | None:
    """Index of the likeliest explanation with ``top``: an effect, ``none`` or ``unknown``.

    If it has something unknown beside the effect, the explanation by the same fit alone instead;
    None if all with ``top`` have something unknown beside it.
    """
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
    return next(iter((*same, *whole)), None)


def _ambiguous_class(probabilities: Mapping[str, float]) -> tuple[str, ...]:
    """Most probable effects with ``CLASS_PROBABILITY`` of the sum over all effects.

    At most ``MOST_NAMED``; empty if a single one suffices.
    """
    ranked = sorted(
        (n for n in probabilities if n not in ("none", "unknown")),
        key=lambda n: -probabilities[n],
    )
    total, named = 0.0, []
    sum_of_all = sum(probabilities[n] for n in ranked)
    for name in ranked[:MOST_NAMED]:
        named.append(name)
        total += probabilities[name]
        if total >= CLASS_PROBABILITY * sum_of_all:
            break
    return tuple(named) if len(named) > 1 else ()
