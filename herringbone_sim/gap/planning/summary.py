"""Summarise a plan: a row for each effect, runs in the order of their information, plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.gap.planning.plan import NAMED, Detectability, Plan

SCHEMA = "herringbone_sim/gap-plan/1"


@dataclass(frozen=True)
class EffectSummary:
    """Detectability of an effect over all its places; sizes in its unit, inf: never named.

    Attributes:
        effect, unit: as in the catalogue.
        moderate: size of a moderate effect.
        best, median, worst: smallest, median and largest ``named_from`` over the places.
        best_place: detectability at the place with the smallest ``named_from``.
        places: number of places, each option counted separately.
        placed_share: fraction of the places where the effect is named at which the place is too.
        rival: id of the other effect that fits it best, at most of the places.
        rival_leaves: median fraction of its chi2 that remains after a fit of the best rival.
        best_run: index of the run with most information on it.
    """

    effect: str
    unit: str
    moderate: float
    best: float
    median: float
    worst: float
    best_place: Detectability
    places: int
    placed_share: float
    rival: str
    rival_leaves: float
    best_run: int


def effect_summaries(plan: Plan) -> list[EffectSummary]:
    """Summaries of all effects, sorted by the median size relative to the moderate one."""
    rows = [_row(plan.of_effect(effect)) for effect in plan.effects]
    return sorted(rows, key=lambda row: (row.median / row.moderate, row.best / row.moderate))


def _row(detectabilities: Sequence[Detectability]) -> EffectSummary:
    """Summary of the detectabilities of one effect."""
    sizes = np.array([d.named_from for d in detectabilities])
    best = detectabilities[int(np.argmin(sizes))]
    named = [d for d in detectabilities if math.isfinite(d.named_from)]
    rivals = [d.rival for d in detectabilities]
    runs = np.mean([d.run_shares for d in detectabilities], axis=0)
    return EffectSummary(
        best.effect,
        best.unit,
        best.moderate,
        float(sizes.min()),
        float(np.sort(sizes)[(len(sizes) - 1) // 2]),
        float(sizes.max()),
        best,
        len(detectabilities),
        float(np.mean([d.place_probability >= NAMED for d in named])) if named else 0.0,
        max(sorted(set(rivals)), key=rivals.count),
        float(np.median([d.rival_leaves for d in detectabilities])),
        int(np.argmax(runs)),
    )


def named_effects(plan: Plan) -> int:
    """Number of effects that are named at a moderate size at half of their places or more."""
    return sum(row.median <= row.moderate for row in effect_summaries(plan))


def ranked_runs(plan: Plan) -> list[tuple[int, float]]:
    """Order the runs greedily by their information on all effects.

    Returns:
        For each run its index, and the fraction of the chi2 of all runs that it and the runs
        before it contain, for the effect with the smallest fraction.
    """
    shares = np.array(
        [np.mean([d.run_shares for d in plan.of_effect(e)], axis=0) for e in plan.effects]
    )
    remaining, ranked = list(range(shares.shape[1])), []
    total = np.zeros(len(shares))
    while remaining:
        best = max(remaining, key=lambda r: float(np.sum(np.log(total + shares[:, r] + 1e-3))))
        remaining.remove(best)
        total = total + shares[:, best]
        ranked.append((best, float(total.min())))
    return ranked


def size_reduction(plan: Plan, more: Plan) -> float:
    """Factor by which the plan ``more`` lowers the median sizes of ``plan``.

    Geometric mean over the effects that both name; NaN without any.
    """
    before, after = ({row.effect: row.median for row in effect_summaries(p)} for p in (plan, more))
    ratios = [
        before[e] / after[e]
        for e in before
        if e in after and math.isfinite(before[e]) and math.isfinite(after[e])
    ]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else math.nan


def sensors_text(plan: Plan) -> str:
    """Names of the sensors as text; of more than six, their number with the first and last."""
    if len(plan.sensors) <= 6:
        return ", ".join(plan.sensors)
    return f"{len(plan.sensors)} channels ({plan.sensors[0]} ... {plan.sensors[-1]})"


def place_text(detectability: Detectability) -> str:
    """Mesh, planet, side and options of an effect as text, such as ``sp/2/L, order 2``.

    All meshes are ``all``. For sensor effects the text names up to two channels, else the quantity
    and the locus. Options that are neither text nor integer, and ``sense``, are left out.
    """
    options = dict(detectability.options)
    channels = options.pop("channels", None)
    text = "/".join(
        (detectability.locus.mesh, detectability.locus.planet, detectability.locus.side)
    )
    text = text.replace("all/all/all", "all")
    if isinstance(channels, tuple):
        quantity, _, place = channels[0].partition("_")
        text = " and ".join(channels) if place and len(channels) <= 2 else f"{quantity} {text}"
    named = [f"{k} {v}" for k, v in options.items() if k != "sense" and isinstance(v, str | int)]
    return ", ".join([text, *named])


def plan_to_dict(
    plan: Plan,
    points: Sequence[Mapping[str, float]],
    cycles: int,
    also: Mapping[str, Plan],
) -> dict[str, Any]:
    """Convert a plan to plain data, the content of ``plan.json``; null: never named.

    Its ``points`` are in the order in which runs add most information, with the number ``run`` of
    each in the argument ``points``.

    Args:
        plan: the plan.
        points: operating point of each run.
        cycles: mesh cycles of a run.
        also: plans with one more sensor, by name of the sensor.
    """
    worth = ranked_runs(plan)
    return {
        "schema": SCHEMA,
        "named_from": NAMED,
        "cycles": cycles,
        **_plan(plan),
        "points": [{**points[r], "run": r, "least_share_with_those_before": s} for r, s in worth],
        "also": {
            name: {**_plan(more), "gain": _finite(size_reduction(plan, more))}
            for name, more in also.items()
        },
    }


def _plan(plan: Plan) -> dict[str, Any]:
    """Convert sensors, observations and detectabilities of a plan to plain data."""
    return {
        "sensors": list(plan.sensors),
        "observations": list(plan.observations),
        "values": plan.count,
        "not_sought": list(plan.not_sought),
        "not_planned": list(plan.not_planned),
        "effects": [
            {
                "effect": detectability.effect,
                "locus": vars(detectability.locus).copy(),
                "options": {
                    k: list(v) if isinstance(v, tuple) else v for k, v in detectability.options
                },
                "unit": detectability.unit,
                "moderate": detectability.moderate,
                "named_from": _finite(detectability.named_from),
                "seen_from": _finite(detectability.detected_from),
                "rival": detectability.rival,
                "rival_leaves": detectability.rival_leaves,
                "place": detectability.place_probability,
                "runs": list(detectability.run_shares),
            }
            for detectability in plan.detectabilities
        ],
    }


def _finite(size: float) -> float | None:
    """The number, or None where it is not finite."""
    return size if math.isfinite(size) else None
