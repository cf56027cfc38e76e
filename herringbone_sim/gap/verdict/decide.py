"""From evidence to a verdict with probabilities: none, unknown, ambiguous, or an effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.verdict.evidence import Evidence
from herringbone_sim.gap.verdict.stages import Option, Stage, stages_of
from herringbone_sim.gap.verdict.thresholds import Thresholds, frozen_thresholds


@dataclass(frozen=True)
class Verdict:
    """What is there, and how sure that is.

    Attributes:
        verdict: ``none``, ``unknown``, ``ambiguous`` or an effect.
        effects: ids of what is there.
        probabilities: of every effect, ``none`` and ``unknown``; sums to 1.
        best: option of each effect that its probability comes from most.
        ambiguous_with: ids of the class when ambiguous.
        metric: residual that counts.
        chosen: options that make up the augmented model.
        runner_up: best option of another effect.
    """

    verdict: str
    effects: tuple[str, ...]
    probabilities: Mapping[str, float]
    best: Mapping[str, tuple[Option, int]]
    ambiguous_with: tuple[str, ...]
    metric: str
    chosen: tuple[Option, ...]
    runner_up: Option | None = None
    stages: tuple[Stage, ...] = field(default=())


def decide(evidence: Evidence, thresholds: Thresholds | None = None) -> Verdict:
    """The verdict that the evidence supports, by the frozen thresholds or by others."""
    t = thresholds or frozen_thresholds()
    stages = stages_of(evidence, t)
    chances = {name: 0.0 for name in (*known_effects(), "none", "unknown")}
    best: dict[str, tuple[Option, int]] = {}
    most: dict[str, float] = {}
    chances["none"] = float(np.prod([1.0 - s.gap for s in stages])) if stages else 0.0
    odds = np.array([s.gap * t.stage**i for i, s in enumerate(stages)])
    odds = odds / max(odds.sum(), 1e-300) * (1.0 - chances["none"])
    if not stages:
        chances["unknown"] = 1.0
    for stage, mass in zip(stages, odds, strict=True):
        unknown = stage.unknown
        chances["unknown"] += mass * unknown
        for option, weight in zip(stage.options, stage.weights, strict=True):
            parts = _parts(option)
            for i, (one, part) in enumerate(zip(option.actives, parts, strict=True)):
                name = one.effect.id
                own = mass * (1.0 - unknown) * float(weight) * part
                chances[name] += own
                if own > most.get(name, -1.0):  # not that of a residual that shows nothing
                    best[name], most[name] = (option, i), own
    total = sum(chances.values())
    chances = {name: float(p / total) for name, p in chances.items()}
    return _verdict(stages, chances, best)


def _verdict(
    stages: tuple[Stage, ...],
    chances: dict[str, float],
    best: dict[str, tuple[Option, int]],
) -> Verdict:
    top = max(chances, key=lambda name: chances[name])
    there = [s for s in stages if s.gap > 0.5 and s.options and s.unknown < 0.5]
    metric = there[0].name if there else _loudest(stages, top)
    chosen = tuple(s.options[0] for s in there) if top != "none" else ()
    alike: tuple[str, ...] = ()
    runner = None
    for stage in there[:1]:
        alike = _class(stage)
        ids = {a.effect.id for a in stage.options[0].actives}
        others = [o for o in stage.options if not ids & {a.effect.id for a in o.actives}]
        runner = others[0] if others else None
    if top in ("none", "unknown"):
        held = () if top == "none" else chosen
        return Verdict(top, (), chances, best, (), metric, held, runner, stages)
    found = [a.effect.id for option in chosen for a in option.actives]
    found = sorted(dict.fromkeys(found), key=lambda name: -chances[name])[:2] or [top]
    verdict = "ambiguous" if len(alike) > 1 and top in alike else top
    effects = tuple(found) if top in found else (top, *found[:1])
    named = alike[:4] if verdict == "ambiguous" else ()
    return Verdict(verdict, effects, chances, best, named, metric, chosen, runner, stages)


def _loudest(stages: tuple[Stage, ...], top: str) -> str:
    if top == "unknown" and stages:
        return max(stages, key=lambda s: s.gap * s.unknown).name
    known = [s for s in stages if s.name != "consistency"] or list(stages)
    loudest = max(known, key=lambda s: s.gap).name if known else "force_law"
    return "force_law" if top == "none" and any(s.name == "force_law" for s in known) else loudest


def _class(stage: Stage) -> tuple[str, ...]:
    """Effects that explain the same as the best one with the same change of the forces."""
    first, t = stage.options[0], stage.thresholds
    named = [first.actives[0].effect.id]
    if len(first.actives) > 1 or first.fit is None:
        return ()
    for other in stage.options[1:]:
        if other.fit is None or len(other.actives) > 1:
            continue
        near = other.excess + stage.floor < t.alike * (first.excess + stage.floor)
        a, b = first.fit.gain, other.fit.gain
        cos = abs(float(a @ b)) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300)
        if near and cos > t.same and other.actives[0].effect.id not in named:
            named.append(other.actives[0].effect.id)
    return tuple(named) if len(named) > 1 else ()


def _parts(option: Option) -> list[float]:
    """How the probability of a pair is shared: the larger effect gets more."""
    return [1.0] if len(option.actives) == 1 else [0.6, 0.4]
