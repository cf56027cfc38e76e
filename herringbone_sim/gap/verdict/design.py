"""The operating point that would tell the leading rivals of a verdict apart.

Two explanations that fit the same runs alike differ at another point, or they don't. For each
point in reach the calibrated gear says how it would move; there one rival's forces, after the best
fit of the other to the runs so far and that one together, leave a rest. The point with the largest
rest, in units of the noise floor, is the next experiment. One point alone would not do: two
effects that only temperature tells apart are one effect at any single temperature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from herringbone_sim.errors import ParameterError
from herringbone_sim.gap.attribution.bodies import balance_measured
from herringbone_sim.gap.attribution.hypothesis import Case
from herringbone_sim.gap.calibrated import Calibrated
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.verdict.augmented import Augmented, parameters_of
from herringbone_sim.gap.verdict.decide import Option, Verdict
from herringbone_sim.gap.verdict.rivals import BALANCE, FORCES, MOTION, Rest, Rival, rest, shown
from herringbone_sim.gap.verdict.trial import Trial, candidates, trial

HARSHEST = 2.0  # of the largest mesh force so far: no point is asked for beyond it


@dataclass(frozen=True)
class Design:
    """The point at which the rivals differ most.

    Attributes:
        names: of the rivals.
        point: delta_T [K], K, T_1 [N m], Omega.
        there, so_far: RMS over the noise floor by which those two rivals that are least apart
            differ, at the point and in the fit runs.
        known, enough: whether the fit runs alone tell them apart, and those with the point.
        harder: largest mesh force there over that of the fit runs.
    """

    names: tuple[str, ...]
    point: dict[str, float]
    there: float
    so_far: float
    known: bool = False
    enough: bool = False
    harder: float = 1.0


def leading(verdict: Verdict) -> tuple[Option, ...]:
    """The members of an ambiguous class; else the verdict's option and the best of other effects.

    Empty where nothing was found, or nothing else was tried.
    """
    if verdict.verdict in ("none", "unknown") or verdict.chosen is None:
        return ()
    if verdict.ambiguous_with:
        return tuple(verdict.best[n][0] for n in verdict.ambiguous_with if n in verdict.best)
    return () if verdict.runner_up is None else (verdict.chosen, verdict.runner_up)


def design(
    campaign: PreparedCampaign, found: Calibrated, verdict: Verdict, model: Augmented
) -> Design | None:
    """The best point for the leading rivals; None without rivals or a way to predict them."""
    options = leading(verdict)
    where = _where(found, verdict, options)
    if len(options) < 2 or where is None:
        return None
    model = replace(model, actives=())
    try:
        gear = parameters_of(campaign.nominal, model)
    except ParameterError:
        return None
    rivals = [Rival(o.actives, model.factors, model.inverse) for o in options]
    cases = [c for c in found.cases if where != BALANCE or balance_measured((c,))]
    points = candidates([run.point for run in campaign.of_role("fit")])
    tried = (trial(cases, campaign.nominal, gear, model.factors, point) for point in points)
    most = max(_largest(c) for c in cases)
    safe = [one for one in tried if one is not None and one.peak_n < HARSHEST * most]
    if not safe:
        return None
    known = _sum([_rests(c, rivals, where) for c in cases])
    tested = [(one, _rests(one.case, rivals, where)) for one in safe]
    designed = [
        _designed(rivals, known, one, rests, len(cases), most)
        for one, rests in tested
        if all(rest.finite and rest.count > 0 for rest in (*known, *rests))
    ]
    return max(designed, key=lambda one: one.there, default=None)


def _where(found: Calibrated, verdict: Verdict, options: Sequence[Option]) -> str | None:
    """The residual in which rivals can be predicted, if there is one."""
    actives = [a for o in options for a in o.actives]
    machine = all(a.effect.level != "sensor" for a in actives)
    forces = all(bool(np.isfinite(c.run.F.values).all()) for c in found.cases)
    if not forces:
        return MOTION if machine and verdict.metric == "torque_balance" else None
    if verdict.metric == "force_law":
        told = [n for a in actives for n in dict(a.options).get("channels", ())]
        return FORCES if all(n.startswith("F") for n in told) else None
    whole = any(balance_measured((c,)) for c in found.cases)
    return BALANCE if machine and whole and verdict.metric == "torque_balance" else None


def _rests(one: Case, rivals: Sequence[Rival], where: str) -> list[Rest]:
    """Of every rival after every other one."""
    return [rest(of, after) for of, after in permutations(shown(one, rivals, where), 2)]


def _sum(runs: Sequence[list[Rest]]) -> list[Rest]:
    total = runs[0]
    for one in runs[1:]:
        total = [a + b for a, b in zip(total, one, strict=True)]
    return total


def _designed(
    rivals: Sequence[Rival],
    known: Sequence[Rest],
    one: Trial,
    rests: Sequence[Rest],
    runs: int,
    most: float,
) -> Design:
    """What a point would add: as long a run as the others."""
    found = []
    for before, new in zip(known, rests, strict=True):
        new = new.times(before.count / runs / new.count)
        both = before + new
        old, least = before.least, both.least
        there = np.sqrt(max(least - old, 0.0) / new.count)
        so_far = np.sqrt(old / before.count)
        found.append((float(there), float(so_far), least / both.count > _chance(both.count)))
    there, so_far, _ = min(found)
    return Design(
        names=tuple(rival.name for rival in rivals),
        point=one.point,
        there=there,
        so_far=so_far,
        known=all(s**2 > _chance(known[0].count) for _, s, _ in found),
        enough=all(enough for _, _, enough in found),
        harder=one.peak_n / most,
    )


def _chance(count: float) -> float:
    """Excess of a mean square of so many values that noise alone passes once in a thousand."""
    return float(3.1 * np.sqrt(2.0 / count))


def _largest(one: Case) -> float:
    """Largest mesh force [N] of a run, by its law where it is not measured."""
    force = one.run.F.values
    if not np.isfinite(force).any():
        force = force_law(one.run, one.fused, np.ones(6)).modelled_n
    return float(np.nanmax(np.abs(force)))
