"""From evidence to a verdict with probabilities: none, unknown, ambiguous, or an effect.

With thousands of samples a likelihood names something on every healthy rig. What counts instead
is the share of chi2 that an effect explains on runs left out, and what it leaves unexplained.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Active, Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.attribute import Evidence
from herringbone_sim.gap.fit import Fit
from herringbone_sim.gap.hypothesis import name_of

Array = NDArray[np.float64]

# Share of chi2 explained above which there is an effect: at most 0.7 % was seen on healthy rigs.
SHARE = 0.01
# Excess of chi2 above which something is there, named or not: floors hold within some percent.
EXCESS = {"force_law": 0.1, "torque_balance": 0.4}
FLOOR = 0.02  # excess below which two hypotheses can't be told apart
LEFT = 0.5  # part of the excess left at which known and unknown are equally likely
# Of the excess left that a second effect must take away, and no less than SHARE of all chi2:
# less may be the shape of the first one.
SECOND = 0.35
SAME = 0.98  # |cos| of the changes of two hypotheses that are one class
ALIKE = 1.5  # ratio of excess within which the members of a class are not told apart
ORDER = ("consistency", "force_law", "torque_balance")


@dataclass(frozen=True)
class Option:
    """One way to explain what a stage shows.

    Attributes:
        stage: ``consistency``, ``force_law`` or ``torque_balance``.
        actives: one or two effects with parameters.
        excess: chi2 above 1 that it leaves on runs left out.
        fit: of the force law, if it is one.
        intervals: 90 % interval of each parameter of each effect.
    """

    stage: str
    actives: tuple[Active, ...]
    excess: float
    fit: Fit | None = None
    intervals: tuple[tuple[tuple[float, float], ...], ...] = ()


@dataclass(frozen=True)
class Stage:
    """What one residual shows: its excess without effects, and the options, best first."""

    name: str
    nominal: float
    options: tuple[Option, ...]

    @property
    def share(self) -> float:
        """Share of chi2 that the best option explains."""
        best = self.options[0].excess if self.options else self.nominal
        return max(self.nominal - best, 0.0) / (1.0 + self.nominal)

    @property
    def gap(self) -> float:
        """Probability that there is anything at all."""
        least = EXCESS.get(self.name, 0.1)
        size = max(self.share / SHARE, self.nominal / least)
        return size**4 / (1.0 + size**4)

    @property
    def unknown(self) -> float:
        """Probability that it is none of the catalogue, if there is anything."""
        best = self.options[0].excess if self.options else self.nominal
        left = (max(best, 0.0) + FLOOR) / (self.nominal + FLOOR)
        return left**3 / (left**3 + LEFT**3)

    @property
    def weights(self) -> Array:
        """Relative odds (options,) by what each leaves."""
        odds = np.array([(FLOOR + max(o.excess, 0.0)) ** -2.0 for o in self.options])
        weights: Array = odds / odds.sum() if len(odds) else odds
        return weights


@dataclass(frozen=True)
class Verdict:
    """What is there, and how sure that is.

    Attributes:
        verdict: ``none``, ``unknown``, ``ambiguous`` or an effect.
        effects: ids of what is there.
        probabilities: of every effect, ``none`` and ``unknown``; sums to 1.
        best: most likely option of each effect.
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


def decide(evidence: Evidence) -> Verdict:
    """The verdict that the evidence supports."""
    stages = tuple(s for s in (_sensors(evidence), _law(evidence), _bodies(evidence)) if s)
    chances = {name: 0.0 for name in (*known_effects(), "none", "unknown")}
    best: dict[str, tuple[Option, int]] = {}
    chances["none"] = float(np.prod([1.0 - s.gap for s in stages])) if stages else 0.0
    odds = np.array([s.gap * 0.8**i for i, s in enumerate(stages)])
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
                chances[name] += mass * (1.0 - unknown) * float(weight) * part
                held = best.get(name)
                if held is None or option.excess < held[0].excess:
                    best[name] = (option, i)
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
    known = [s for s in stages if s.name != "consistency"] or list(stages)
    loudest = max(known, key=lambda s: s.gap).name if known else "force_law"
    return "force_law" if top == "none" and any(s.name == "force_law" for s in known) else loudest


def _class(stage: Stage) -> tuple[str, ...]:
    """Effects that explain the same as the best one with the same change of the forces."""
    first = stage.options[0]
    named = [first.actives[0].effect.id]
    if len(first.actives) > 1 or first.fit is None:
        return ()
    for other in stage.options[1:]:
        if other.fit is None or len(other.actives) > 1:
            continue
        near = other.excess + FLOOR < ALIKE * (first.excess + FLOOR)
        a, b = first.fit.gain, other.fit.gain
        cos = abs(float(a @ b)) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300)
        if near and cos > SAME and other.actives[0].effect.id not in named:
            named.append(other.actives[0].effect.id)
    return tuple(named) if len(named) > 1 else ()


def _parts(option: Option) -> list[float]:
    """How the probability of a pair is shared: the larger effect gets more."""
    return [1.0] if len(option.actives) == 1 else [0.6, 0.4]


def _sensors(evidence: Evidence) -> Stage | None:
    """Sensors by consistency: each finding is one option, all together explain."""
    check = evidence.check
    if not np.isfinite(check.before) or not check.findings:
        return None
    known = known_effects()
    options = []
    for finding in check.findings[:1]:
        effect = known[finding.effect]
        group = finding.group
        shift = 1.0 if finding.effect == "sensor_gain" else 0.0
        theta = (finding.value + shift,) if effect.parameters else ()
        half = 1.645 * finding.sigma
        span = tuple((v - half, v + half) for v in theta)
        mesh = group.mesh if group.mesh in ("sp", "rp") else "all"
        locus = Locus(mesh, group.planet, group.side)
        chosen = (("channels", group.names),) if effect.options else ()
        one = Active(effect, theta, locus, chosen)
        options.append(Option("consistency", (one,), max(check.after - 1.0, 0.0), None, (span,)))
    return Stage("consistency", max(check.before - 1.0, 0.0), tuple(options))


def _law(evidence: Evidence) -> Stage | None:
    nominal = evidence.nominal
    if nominal is None:
        return None
    excess = max(nominal.left_out - 1.0, 0.0) + _balance(evidence, nominal)
    singles = [_option(evidence, one) for one in evidence.fits]
    least = min((o.excess for o in singles), default=excess)
    pairs = [
        o
        for o in (_option(evidence, one) for one in evidence.pairs)
        if o.excess < (1.0 - SECOND) * least and least - o.excess > SHARE * (1.0 + excess)
    ]
    options = tuple(sorted((*singles, *pairs), key=lambda o: o.excess))
    return Stage("force_law", excess, options)


def _option(evidence: Evidence, one: Fit) -> Option:
    """A fit; with a force sensor in it, the balance speaks as well."""
    excess = max(one.left_out - 1.0, 0.0) + _balance(evidence, one)
    spans = tuple(
        tuple(one.interval(i, k) for k in range(len(a.theta))) for i, a in enumerate(one.actives)
    )
    return Option("force_law", one.actives, excess, one, spans)


def _balance(evidence: Evidence, one: Fit) -> float:
    """What a hypothesis on the forces leaves in the balance, above the one that leaves least."""
    least = min((evidence.balance_excess, *evidence.by_force.values()))
    return evidence.by_force.get(name_of(one.actives), evidence.balance_excess) - least


def _bodies(evidence: Evidence) -> Stage | None:
    if not evidence.bodies:
        return None
    nominal, *rest = evidence.bodies
    options = tuple(
        Option(
            "torque_balance",
            b.actives,
            max(b.left_out - 1.0, 0.0),
            None,
            (
                tuple(
                    (v - 1.645 * s, v + 1.645 * s)
                    for v, s in zip(b.actives[0].theta, b.sigma, strict=True)
                ),
            ),
        )
        for b in rest
    )
    return Stage("torque_balance", max(nominal.left_out - 1.0, 0.0), options)
