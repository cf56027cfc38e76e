"""From the chances of all explanations to a verdict: none, unknown, ambiguous, or an effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from herringbone_sim.diagnosis.judge import Chance
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.named import LearnedLaw, Named

MOST_NAMED = 4  # effects of an ambiguous class, contract of the report
HALF = 0.5  # an explanation that is likelier than all others together
SQUARES = 4.0  # two standard deviations
SURE = 0.9  # what a class of effects must hold together, as an interval of 90 % does


@dataclass(frozen=True)
class Option:
    """One way to explain a gap.

    Attributes:
        actives: one or two effects with parameters.
        intervals: 90 % interval of each parameter of each effect.
        laws: learned curves of those that have a shape.
        harmonics: other orders of learned waves, which go into the augmented model too.
    """

    actives: tuple[Active, ...]
    intervals: tuple[tuple[tuple[float, float], ...], ...] = ()
    laws: tuple[LearnedLaw, ...] = ()
    harmonics: tuple[Active, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """What is there, and how sure that is.

    Attributes:
        verdict: ``none``, ``unknown``, ``ambiguous`` or an effect.
        effects: ids of what is there.
        probabilities: of every effect, ``none`` and ``unknown``; sums to 1.
        best: option of each effect that its probability comes from most, and its place there.
        ambiguous_with: ids of the class when ambiguous.
        metric: residual that counts.
        chosen: what makes up the augmented model; None where nothing does.
        runner_up: best option of other effects.
        chances: of all explanations, best first.
    """

    verdict: str
    effects: tuple[str, ...]
    probabilities: Mapping[str, float]
    best: Mapping[str, tuple[Option, int]]
    ambiguous_with: tuple[str, ...]
    metric: str
    chosen: Option | None
    runner_up: Option | None
    chances: tuple[Chance, ...]


def option_of(found: Sequence[Named]) -> Option:
    return Option(
        tuple(n.active for n in found),
        tuple(n.intervals for n in found),
        tuple(n.law for n in found if n.law is not None),
        tuple(one for n in found for one in n.harmonics),
    )


def decide(chances: Sequence[Chance], options: Mapping[int, Option], metric: str) -> Verdict:
    """The verdict of some chances.

    An effect with something unknown beside it gives half to each, as a pair does.

    Args:
        chances: best first.
        options: by the place in ``chances``, of explanations with effects alone.
        metric: residual that counts.
    """
    probabilities = {name: 0.0 for name in (*known_effects(), "none", "unknown")}
    best: dict[str, tuple[Option, int]] = {}
    for i, one in enumerate(chances):
        for j, name in enumerate(one.effects or ("none",)):
            probabilities[name] += one.probability / max(len(one.effects), 1)
            if i in options:
                best.setdefault(name, (options[i], j))
    top = max(probabilities, key=lambda name: probabilities[name])
    whole = (i for i, c in enumerate(chances) if c.whole and top in (c.effects or ("none",)))
    first = next(whole, 0)
    chosen = options.get(first)
    if top == "unknown":
        chosen = next((options[i] for i in sorted(options)), None)
    named = () if chosen is None else tuple(a.effect.id for a in chosen.actives)
    effects = () if top in ("none", "unknown") else tuple(dict.fromkeys((top, *named)))[:2]
    alike = _class(probabilities, top) or _same(chances, first)
    runner = next(
        (
            options[i]
            for i in sorted(options)
            if not set(named) & {a.effect.id for a in options[i].actives}
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


def _same(chances: Sequence[Chance], first: int) -> tuple[str, ...]:
    """Single effects that leave what the first one leaves, to two standard deviations.

    One with more coefficients may hold the first one as a part, which tells nothing.
    """
    best = chances[first].candidate
    if best is None or len(best.effects) != 1:
        return ()
    alike = [
        c.effects[0]
        for c in chances
        if c.candidate is not None
        and len(c.effects) == 1
        and c.candidate.size <= best.size
        and abs(c.candidate.energy - best.energy) < SQUARES
    ]
    found = tuple(dict.fromkeys((*best.effects, *alike)))[:MOST_NAMED]
    return found if len(found) > 1 else ()


def _class(probabilities: Mapping[str, float], top: str) -> tuple[str, ...]:
    """Effects that hold nine tenths together where none is likelier than all others."""
    if top in ("none", "unknown") or probabilities[top] > HALF:
        return ()
    ranked = sorted(
        (n for n in probabilities if n not in ("none", "unknown")),
        key=lambda n: -probabilities[n],
    )
    held, found = 0.0, []
    whole = sum(probabilities[n] for n in ranked)
    for name in ranked[:MOST_NAMED]:
        found.append(name)
        held += probabilities[name]
        if held >= SURE * whole:
            break
    return tuple(found) if len(found) > 1 else ()
