"""Checks of the published statements, by rules that are the same for every scenario.

The page of a reproduction prints ``RULES``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from herringbone_sim.arrays import Flags
from herringbone_sim.paper.boundaries import Boundary, locate
from herringbone_sim.paper.regimes import (
    REACH,
    Sweep,
    nearest_stretch,
    route,
    share,
    shares_text,
)
from herringbone_sim.paper.scenarios import CHAOS, motion_name, scenario
from herringbone_sim.paper.statements import (
    BoundaryAt,
    ChaosEnds,
    ExponentSign,
    MotionAt,
    Route,
    Statement,
    WindowIs,
)

LEAST_SHARE = 0.9
EDGE_SHARE = 0.8
RULES = (
    f"A window is right when at least {LEAST_SHARE:.0%} of the values swept in it have the "
    "published motion; its error is the share that has not.",
    f"A boundary is right when it lies within {REACH:.0%} of the sweep's range of the published "
    f"value and at least {EDGE_SHARE:.0%} of the values within {REACH:.0%} of the range (or "
    "within the published window, where that is narrower) on either side have the published "
    "motions; its error is obtained minus published. Where the edge is ragged the cleanest and "
    "nearest change counts (shares on both sides times closeness to the published value): the "
    "error is then the least that can be claimed.",
    f"The sign of the exponent is right when at least {LEAST_SHARE:.0%} of the values in the "
    "window have it; its error is the share that has not.",
    f"Chaos ends where the last chaotic value of the sweep lies; right within {REACH:.0%} of the "
    "range.",
    "The motion of a single figure is right when its period is the published one (chaos: no "
    "period up to 12, exponent above 0); it has no error but right or wrong.",
    "The route is right when the motions that cover at least 2 % of the sweep each, in order, "
    "are the published ones.",
)


@dataclass(frozen=True)
class CheckResult:
    """Result of the check of a statement.

    Attributes:
        text: the computed result, in words.
        error: of a boundary or an end of chaos computed minus published, in the unit of the swept
            parameter, 0 inside the published range of a boundary; of a window or the sign of an
            exponent the fraction of values that disagree. NaN for a motion or route, and where
            nothing was computed to compare.
        ok: whether the statement counts as right.
    """

    text: str
    error: float
    ok: bool


@dataclass(frozen=True)
class Evidence:
    """Results that the statements of one scenario are compared with.

    Attributes:
        sweep: motions (and exponents) over the swept parameter.
        boundaries: bisected boundaries by statement; missing ones are located in the sweep.
        points: motion and exponent (NaN if unknown) at single values.
    """

    sweep: Sweep
    boundaries: Mapping[BoundaryAt, Boundary]
    points: Mapping[float, tuple[int, float]]


@singledispatch
def check(statement: Statement, evidence: Evidence) -> CheckResult:
    """Check a statement against results by the rule for its kind, see ``RULES``."""
    raise TypeError(f"no rule for {type(statement).__name__}")


@check.register
def _(statement: WindowIs, evidence: Evidence) -> CheckResult:
    low, high = statement.low, statement.high
    obtained = share(evidence.sweep, low, high, statement.motion)
    text = shares_text(evidence.sweep, low, high) or "no values swept in it"
    if obtained < LEAST_SHARE:
        text += _nearest(evidence.sweep, statement)
    return CheckResult(text, 1.0 - obtained, bool(obtained >= LEAST_SHARE))


def _nearest(sweep: Sweep, statement: WindowIs) -> str:
    middle = (statement.low + statement.high) / 2.0
    nearest = nearest_stretch(sweep, statement.motion, middle)
    name = motion_name(statement.motion)
    if nearest is None:
        return f"; no {name} anywhere"
    return f"; nearest {name}: {nearest[0]:.4g} to {nearest[1]:.4g}"


@check.register
def _(statement: BoundaryAt, evidence: Evidence) -> CheckResult:
    edge = evidence.boundaries.get(statement) or locate(evidence.sweep, statement)
    if not math.isfinite(edge.at):
        return CheckResult(_no_edge(evidence.sweep, statement), float("nan"), False)
    nearest = min(max(edge.at, statement.low), statement.high)
    error = edge.at - nearest
    shares = _edge_shares(evidence.sweep, statement, edge.at)
    ok = abs(error) <= REACH * _span(evidence.sweep) and min(shares) >= EDGE_SHARE
    sides = f"{shares[0]:.0%} and {shares[1]:.0%} beside it" if min(shares) < 1 else "clean"
    return CheckResult(f"{edge.at:.4g} ({sides}; {edge.note})", error, bool(ok))


def _edge_shares(sweep: Sweep, statement: BoundaryAt, at: float) -> tuple[float, float]:
    """Fractions of values with both motions beside a boundary, over the ranges of ``RULES``."""
    reach = REACH * _span(sweep)
    widths = {w.motion: w.high - w.low for w in scenario(statement.scenario).windows}
    left, right = (min(reach, widths[motion]) for motion in (statement.before, statement.after))
    step = float(sweep.values[1] - sweep.values[0])
    return (
        share(sweep, at - max(left, step), at, statement.before),
        share(sweep, at, at + max(right, step), statement.after),
    )


def _no_edge(sweep: Sweep, statement: BoundaryAt) -> str:
    missing = [m for m in (statement.before, statement.after) if m not in sweep.motions]
    if missing:
        return f"no {' or '.join(map(motion_name, missing))}{_end(sweep)}"
    return "no such edge near"


def _end(sweep: Sweep) -> str:
    last = _last_chaos(sweep, float(sweep.values[-1]))
    return f"; chaos ends at {last:.4g}" if math.isfinite(last) else " anywhere"


def _last_chaos(sweep: Sweep, high: float) -> float:
    chaotic = sweep.values[(sweep.motions == CHAOS) & (sweep.values <= high)]
    return float(chaotic.max()) if len(chaotic) else float("nan")


def _span(sweep: Sweep) -> float:
    return float(sweep.values[-1] - sweep.values[0])


@check.register
def _(statement: ExponentSign, evidence: Evidence) -> CheckResult:
    sweep = evidence.sweep
    inside = (sweep.values >= statement.low) & (sweep.values <= statement.high)
    exponents = sweep.exponents[inside, 0]
    if not np.isfinite(exponents).any():
        return CheckResult("no exponents known", float("nan"), False)
    right = float(np.mean(exponents * statement.sign > 0))
    text = f"{right:.0%} of the values{_alike(sweep, inside, statement.sign)}"
    return CheckResult(text, 1.0 - right, bool(right >= LEAST_SHARE))


def _alike(sweep: Sweep, inside: Flags, sign: int) -> str:
    """Text with the median exponent and the fraction of values whose ``within`` has the sign."""
    exponents, within = sweep.exponents[inside, 0], sweep.exponents[inside, 2]
    text = f", median {np.nanmedian(exponents):+.3f}"
    if not np.isfinite(within).any():
        return text
    return f"{text}; left and right kept alike: {float(np.mean(within * sign > 0)):.0%}"


@check.register
def _(statement: ChaosEnds, evidence: Evidence) -> CheckResult:
    last = _last_chaos(evidence.sweep, statement.high)
    error = last - statement.low
    ok = bool(abs(error) <= REACH * _span(evidence.sweep))
    text = f"last chaos at {last:.4g}" if math.isfinite(last) else "no chaos anywhere"
    return CheckResult(text, error, ok)


@check.register
def _(statement: MotionAt, evidence: Evidence) -> CheckResult:
    motion, exponent = evidence.points[statement.value]
    right = motion == statement.motion and not (motion == CHAOS and exponent <= 0)
    known = f", exponent {exponent:+.4f}" if math.isfinite(exponent) else ""
    return CheckResult(f"{motion_name(motion)}{known}", float("nan"), right)


@check.register
def _(statement: Route, evidence: Evidence) -> CheckResult:
    motions = route(evidence.sweep)
    text = " - ".join(map(motion_name, motions))
    return CheckResult(text, float("nan"), motions == statement.motions)
