"""Restart windows whose states fit much worse than those of the other windows of the run.

In a chaotic run some windows may settle in a local minimum, with another sequence of contacts than
the true one. These windows, and a few beside them, are filtered again from other states; then the
whole run is fitted again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.search import CHANCE_CHI2
from herringbone_sim.gap.observations.windows.integrator import STATES
from herringbone_sim.gap.observations.windows.shooting import (
    WindowSolution,
    fitted_windows,
    symmetric_starts,
)
from herringbone_sim.gap.observations.windows.starts import N_FITTED, filtered_starts
from herringbone_sim.gap.observations.windows.windows import Windows

RARE = 1e-3  # probability that noise alone makes any window of a run a misfit
# Windows filtered before the first misfit, as the wrong states may begin in an earlier one: at the
# first attempt, and where that gains nothing; chosen.
LEADS = (2, 4)
# Differences of the tried states from the fitted ones over the RMS of the motion, two random
# directions of each: from other times of contact to other motions; chosen.
APART = (0.01, 0.03, 0.1, 0.3)
ROUNDS = 8  # Levenberg-Marquardt steps of the whole run after a restart; chosen for run time


class WindowRange(NamedTuple):
    """Misfitted windows that lie at most two apart: the first and the last of them."""

    first: int
    last: int


def misfits(s: Windows, solution: WindowSolution) -> list[WindowRange]:
    """Groups of misfitted windows, that of the largest excess of chi2 first.

    The noise level of the run is taken from its median window. At this level the chi2 of a misfit
    is too large for chance (``RARE``) and exceeds its expectation by more than ``CHANCE_CHI2``.
    All ``STATES`` of a window count as fitted to its readings, although the ties between windows
    determine a part of them.
    """
    count = np.count_nonzero(s.weight, axis=(1, 2))
    known = np.flatnonzero(count)
    if not len(known) or not np.isfinite(solution.cost):
        return []
    free = np.maximum(count - STATES, 1)
    cost = np.sum(solution.residuals**2, axis=(1, 2))
    usual = float(np.median(cost[known] / chi2.median(free[known])))
    if usual == 0.0:
        return []
    excess = cost - usual * free
    rare = chi2.sf(cost / usual, free) < RARE / len(known)
    groups: list[WindowRange] = []
    for w in np.flatnonzero(rare & (count > 0) & (excess > CHANCE_CHI2)).tolist():
        if groups and w <= groups[-1].last + 2:
            groups[-1] = WindowRange(groups[-1].first, w)
        else:
            groups.append(WindowRange(w, w))
    return sorted(groups, key=lambda g: -float(excess[g.first : g.last + 1].sum()))


def restarted(
    s: Windows, solution: WindowSolution, group: WindowRange, seed: int
) -> WindowSolution | None:
    """Fit a run again after a restart of a group of its windows.

    Args:
        solution: fitted states, under the forcing that counts.
        seed: of the random directions of ``APART``.

    Returns:
        A fit that leaves less of the run, and less of the restarted windows by more than
        ``CHANCE_CHI2``; None where no start leads to one.
    """
    forcing, rng = solution.integrator.forcing, np.random.default_rng(seed)
    apart = np.repeat(APART, 2)[:, None] * rng.standard_normal((2 * len(APART), STATES)) * s.scale
    clean = s.without_trends(solution.trends)
    for begin in sorted({max(group.first - lead, 0) for lead in LEADS}, reverse=True):
        part = slice(begin, group.last + 2)
        windows = replace(
            clean,
            measured=clean.measured[part],
            weight=clean.weight[part],
            first_half_step=clean.first_half_step[part],
        )
        start, in_step = solution.starts[begin], symmetric_starts(clean)[begin]
        tried = np.vstack([start, in_step, start + apart])
        try:
            starts, cost = filtered_starts(windows, forcing, tried)
        except np.linalg.LinAlgError:
            continue
        if begin:
            jump = (solution.states[begin - 1, -1] - starts[:, 0]) / s.scale
            cost = cost + np.sum(jump**2, axis=1) / s.jump_sd**2
        for i in np.argsort(np.nan_to_num(cost, nan=np.inf))[:N_FITTED].tolist():
            new = solution.starts.copy()
            new[part] = starts[i]
            fit = fitted_windows(s, new, forcing, ROUNDS, solution.trends)
            gained = _left(solution, part) - _left(fit, part)
            if fit.cost < solution.cost and gained > CHANCE_CHI2:
                return fit
    return None


def _left(solution: WindowSolution, part: slice) -> float:
    """Chi2 of some windows and of the jumps at their ends."""
    ties: Array = solution.jumps[max(part.start - 1, 0) : part.stop]
    residuals = solution.residuals[part]
    return float(np.sum(residuals**2) + np.sum(ties**2) / solution.jump_sd**2)
