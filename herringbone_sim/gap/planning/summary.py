"""A plan in a few numbers: rows for a table, points in the order of their worth, plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.gap.planning.plan import NAMED, Outlook, Plan

SCHEMA = "herringbone_sim/gap-plan/1"


@dataclass(frozen=True)
class Row:
    """An effect over all its places, sizes in its own unit; inf: not named at any size tried.

    Attributes:
        effect, unit: as in the catalogue.
        moderate: size that counts as one.
        best, median, worst: size from which on it is named, by place.
        where: the best place.
        places: how many places and options there are.
        placed: share of those named whose place is named too.
        rival: other effect that most often would follow it best.
        apart: share of its squares that its best rival would leave, at half of its places.
        settles: run that tells most of it, from 0.
    """

    effect: str
    unit: str
    moderate: float
    best: float
    median: float
    worst: float
    where: Outlook
    places: int
    placed: float
    rival: str
    apart: float
    settles: int


def rows(plan: Plan) -> list[Row]:
    """A row an effect, those named at the least share of a moderate size first."""
    found = [_row(plan.of_effect(effect)) for effect in plan.effects]
    return sorted(found, key=lambda row: (row.median / row.moderate, row.best / row.moderate))


def _row(of: Sequence[Outlook]) -> Row:
    sizes = np.array([one.size for one in of])
    best = of[int(np.argmin(sizes))]
    named = [one for one in of if math.isfinite(one.size)]
    rivals = [one.rival for one in of]
    runs = np.mean([one.runs for one in of], axis=0)
    return Row(
        best.effect,
        best.unit,
        best.moderate,
        float(sizes.min()),
        float(np.sort(sizes)[(len(sizes) - 1) // 2]),
        float(sizes.max()),
        best,
        len(of),
        float(np.mean([one.place >= NAMED for one in named])) if named else 0.0,
        max(sorted(set(rivals)), key=rivals.count),
        float(np.median([one.apart for one in of])),
        int(np.argmax(runs)),
    )


def named_effects(plan: Plan) -> int:
    """Effects that are named at a moderate size at half of their places or more."""
    return sum(row.median <= row.moderate for row in rows(plan))


def by_worth(plan: Plan) -> list[tuple[int, float]]:
    """Runs, the most telling first, with the share of the squares that they and those before
    tell of the effect that they tell least of."""
    shares = np.array([np.mean([o.runs for o in plan.of_effect(e)], axis=0) for e in plan.effects])
    left, found = list(range(shares.shape[1])), []
    told = np.zeros(len(shares))
    while left:
        best = max(left, key=lambda r: float(np.sum(np.log(told + shares[:, r] + 1e-3))))
        left.remove(best)
        told = told + shares[:, best]
        found.append((best, float(told.min())))
    return found


def gain(plan: Plan, more: Plan) -> float:
    """By what factor the sizes named fall, over effects that both tell (geometric mean)."""
    before, after = ({row.effect: row.median for row in rows(p)} for p in (plan, more))
    ratios = [
        before[e] / after[e]
        for e in before
        if e in after and math.isfinite(before[e]) and math.isfinite(after[e])
    ]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else math.nan


def sensors_text(plan: Plan) -> str:
    """Names of a few sensors, the number of many."""
    if len(plan.sensors) <= 6:
        return ", ".join(plan.sensors)
    return f"{len(plan.sensors)} channels ({plan.sensors[0]} ... {plan.sensors[-1]})"


def place_text(one: Outlook) -> str:
    """Mesh, planet, side and options in a few letters."""
    text = "/".join((one.locus.mesh, one.locus.planet, one.locus.side))
    text = text.replace("all/all/all", "all")
    told = [f"{k} {v}" for k, v in one.options if k != "sense" and isinstance(v, str | int)]
    return ", ".join([text, *told])


def written(
    plan: Plan,
    points: Sequence[Mapping[str, float]],
    cycles: int,
    also: Mapping[str, Plan],
) -> dict[str, Any]:
    """As plain data; a size of null: not named at any size tried."""
    worth = by_worth(plan)
    return {
        "schema": SCHEMA,
        "named_from": NAMED,
        "cycles": cycles,
        **_plan(plan),
        "points": [{**points[r], "run": r, "least_share_with_those_before": s} for r, s in worth],
        "also": {name: {**_plan(more), "gain": gain(plan, more)} for name, more in also.items()},
    }


def _plan(plan: Plan) -> dict[str, Any]:
    return {
        "sensors": list(plan.sensors),
        "observations": list(plan.observations),
        "values": plan.count,
        "not_sought": list(plan.left_out),
        "not_planned": list(plan.not_planned),
        "effects": [
            {
                "effect": one.effect,
                "locus": vars(one.locus).copy(),
                "options": {k: v for k, v in one.options if isinstance(v, str | int)},
                "unit": one.unit,
                "moderate": one.moderate,
                "named_from": one.size if math.isfinite(one.size) else None,
                "seen_from": one.seen if math.isfinite(one.seen) else None,
                "rival": one.rival,
                "rival_leaves": one.apart,
                "place": one.place,
                "runs": list(one.runs),
            }
            for one in plan.outlooks
        ],
    }
