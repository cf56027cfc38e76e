"""Restart windows whose states fit much worse than those of the other windows of the run.

In a chaotic run some windows may settle in a local minimum, with another sequence of contacts than
the true one. They are filtered again from other states, before the whole run is fitted again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from herringbone_sim.diagnosis.search import CHANCE_CHI2
from herringbone_sim.gap.observations.rollout import STATES
from herringbone_sim.gap.observations.shooting import WindowSolution, fitted_windows
from herringbone_sim.gap.observations.window_starts import filtered_starts
from herringbone_sim.gap.observations.windows import Windows

RARE = 1e-3  # probability that a run without misfits has a window that counts as one
# Windows that are restarted before the first misfit: its states may come from an earlier one. The
# second number where the first gains nothing; chosen.
LEADS = (2, 4)
# Differences of the tried states from the fitted ones over the RMS of the motion; two random
# directions (fixed seed) of each; chosen.
APART = (0.01, 0.03, 0.1, 0.3)
ROUNDS = 8  # Levenberg-Marquardt steps of the whole run after a restart; chosen


def misfits(s: Windows, solution: WindowSolution) -> list[tuple[int, int]]:
    """Groups of adjacent misfitted windows, by first and last, that of the largest chi2 first.

    A misfit has a chi2 that chance gives to no window of the run but with probability ``RARE``, if
    the median of chi2 per reading over the windows is that of noise and law.
    """
    count = np.count_nonzero(s.weight, axis=(1, 2))
    known = np.flatnonzero(count)
    if not len(known) or not np.isfinite(solution.cost):
        return []
    cost = np.sum(solution.residuals**2, axis=(1, 2))
    usual = float(np.median(cost[known] / count[known]))
    # A run that is fitted exactly has none.
    chance = chi2.sf(cost[known] / usual, count[known]) if usual > 0.0 else np.ones(len(known))
    groups: list[tuple[int, int]] = []
    for w in known[chance < RARE / len(known)].tolist():
        if groups and w <= groups[-1][1] + 2:
            groups[-1] = groups[-1][0], w
        else:
            groups.append((w, w))
    return sorted(groups, key=lambda g: -float(cost[g[0] : g[1] + 1].sum()))


def restarted(s: Windows, solution: WindowSolution) -> WindowSolution | None:
    """Fit a run again after a restart of its worst group of misfitted windows.

    Returns:
        A fit of less chi2, or the given one if no start gains; None without misfits.
    """
    groups = misfits(s, solution)
    if not groups:
        return None
    (first, last), forcing = groups[0], solution.integrator.forcing
    rng = np.random.default_rng(0)
    apart = np.repeat(APART, 2)[:, None] * rng.standard_normal((2 * len(APART), STATES)) * s.scale
    clean = s.without_trends(solution.trends)
    for lead in LEADS:
        begin = max(first - lead, 0)
        part = slice(begin, last + 2)
        group = replace(
            clean,
            measured=clean.measured[part],
            weight=clean.weight[part],
            first_half_step=clean.first_half_step[part],
        )
        start = solution.starts[begin]
        try:
            starts, cost = filtered_starts(group, forcing, np.vstack([start, start + apart]))
        except np.linalg.LinAlgError:
            continue
        new = solution.starts.copy()
        new[part] = starts[int(np.argmin(np.nan_to_num(cost, nan=np.inf)))]
        fit = fitted_windows(s, new, forcing, ROUNDS, solution.trends)
        if fit.cost < solution.cost - CHANCE_CHI2:
            return fit
    return solution
