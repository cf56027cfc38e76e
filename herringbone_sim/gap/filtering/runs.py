"""Runs of few channels, calibrated: filters, innovations and what tolerances do to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from herringbone_sim.effects.effect import Active
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.filtering.filter import SIZE, Filtered, filtered, innovations
from herringbone_sim.gap.residuals.recalibrate import BOUNDS, HEAVIEST

Array = NDArray[np.float64]

SETTLED = 10.0  # mesh cycles until the filter has found the motion
# What a rate gains unforeseen between samples: at least [b_c omega_n], and of its own change.
LEAST, OF_CHANGE = 0.002, 0.01
RIGID = 1e-5  # the same of the rigid rotation
LOOSER = (4.0, 30.0)  # by how much the two are loosened where a run can't be followed
LOST = 4.0  # mean square of innovations above which it can't: nothing is linear any more
MOST = 4  # times
ALL_BOUNDS = np.concatenate([BOUNDS, np.full(3, HEAVIEST - 1.0)])
PRIOR = 3.0 / ALL_BOUNDS**2


@dataclass(frozen=True)
class Watched:
    """A run with its filter and the tolerances around a calibration p (9,).

    Attributes:
        run, by: channels and filter.
        left: (n k,) innovations of the calibrated gear over their spread.
        tolerance: (9, n k) their change by each factor.
        looser: how many times as wide the spread is as that of a gear that is as steady as one
            without effects, at least 1.
    """

    run: PreparedRun
    by: Filtered
    left: Array
    tolerance: Array
    looser: float


def watch(runs: Sequence[PreparedRun], rounds: int = 2) -> tuple[list[Watched], Array]:
    """Filter runs and calibrate the gear inside its tolerance by their innovations.

    The first filter finds the motion. The second one is loosened, run by run, until it follows
    the run: the motion of a gear that is not the nominal one leaves it otherwise.

    Returns:
        The runs at the calibration, and p (9,): factors of the law, then on 1/M_s, 1/M_p, 1/M_c.
    """
    p = np.ones(9)
    spread = np.array([0.0] * 4 + [1.5 * LEAST] * 4 + [0.0, RIGID])
    filters = [filtered(run, p[:6], p[6:], spread) for run in runs]
    p, _ = _calibrated(runs, filters, p, 1)
    found = [following(run, by, p) for run, by in zip(runs, filters, strict=True)]
    filters = [by for by, _ in found]
    p, slopes = _calibrated(runs, filters, p, rounds)
    made = [
        Watched(run, by, left(run, by, p), slope, looser)
        for run, (by, looser), slope in zip(runs, found, slopes, strict=True)
    ]
    return made, p


def following(run: PreparedRun, first: Filtered, p: Array) -> tuple[Filtered, float]:
    """The steadiest filter that follows a run, and how much wider its spread is for that."""
    change = np.sqrt(np.mean(np.diff(first.state[len(first.state) // 4 :], axis=0) ** 2, axis=0))
    usual = np.concatenate([np.zeros(4), np.hypot(LEAST, OF_CHANGE * change[4:8]), [0.0, RIGID]])
    ways = [np.ones(SIZE), np.ones(SIZE)]
    ways[0][4:8] = LOOSER[0]
    ways[1][9] = LOOSER[1]
    steady = best = filtered(run, p[:6], p[6:], usual)
    start = settled(run)
    for _ in range(MOST):
        if float(np.mean(best.white[start:] ** 2)) < LOST:
            break
        others = [filtered(run, p[:6], p[6:], usual * way) for way in ways]
        at = int(np.argmin([_surprise(run, other) for other in others]))
        if _surprise(run, others[at]) > _surprise(run, best):
            break
        best, usual = others[at], usual * ways[at]
    wider = np.sqrt(np.mean((best.spread / steady.spread)[start:] ** 2))
    return best, max(float(wider), 1.0)


def _surprise(run: PreparedRun, by: Filtered) -> float:
    """Minus twice the log likelihood of the innovations."""
    start = settled(run)
    surprise = np.sum(2.0 * np.log(by.spread[start:]) + by.white[start:] ** 2)
    return float(surprise) if np.isfinite(surprise) else np.inf


def gap_of(
    run: PreparedRun, factors: Array, inverse: Array, actives: Sequence[Active]
) -> tuple[float, float, float]:
    """RMS of a run's innovations over their spread: nominal, with effects, and that of noise.

    Both gears are drawn by the same gains, those of a filter of the calibrated gear.
    """
    p = np.concatenate([factors, inverse])
    spread = np.array([0.0] * 4 + [1.5 * LEAST] * 4 + [0.0, RIGID])
    by, _ = following(run, filtered(run, factors, inverse, spread), p)
    machine = tuple(a for a in actives if a.effect.level != "sensor")
    before, after = left(run, by, np.ones(9)), left(run, by, p, machine)
    return float(np.sqrt(np.mean(before**2))), float(np.sqrt(np.mean(after**2))), 1.0


def settled(run: PreparedRun) -> int:
    """First sample at which the filter has found the motion."""
    return int(SETTLED * run.cycle_s / run.step_s)


def left(run: PreparedRun, by: Filtered, p: Array, actives: Sequence[Active] = ()) -> Array:
    """Innovations (n k,) over their spread of a gear with calibration p (9,) and effects."""
    white = innovations(run, by, p[:6], p[6:], actives, bool(actives))[settled(run) :]
    return white.ravel()


def tolerances(run: PreparedRun, by: Filtered, p: Array, here: Array) -> Array:
    """Change (9, n k) of the innovations ``here`` by each factor."""
    step = 1e-3
    return np.stack([(left(run, by, p + step * e) - here) / step for e in np.eye(9)])


def _calibrated(
    runs: Sequence[PreparedRun], filters: Sequence[Filtered], p: Array, rounds: int
) -> tuple[Array, list[Array]]:
    slopes: list[Array] = []
    for _ in range(rounds):
        normal, right = np.diag(PRIOR), PRIOR * (1.0 - p)
        slopes = []
        for run, by in zip(runs, filters, strict=True):
            here = left(run, by, p)
            J = tolerances(run, by, p, here)
            weight = 1.0 / max(float(np.mean(here**2)), 1.0)
            normal = normal + weight * J @ J.T
            right = right - weight * J @ here
            slopes.append(J)
        root = np.linalg.cholesky(normal).T
        low, high = 1.0 - ALL_BOUNDS - p, 1.0 + ALL_BOUNDS - p + 1e-12
        p = p + lsq_linear(root, np.linalg.solve(root.T, right), (low, high)).x
    return p, slopes
