"""Nonlinear trials: fit windows under the best ranked effects at several finite sizes.

Needed where the contact pattern differs from the nominal one, so that the linear response gives
neither size nor kind of an effect. Trials take a few steps of the fit, on the two least deviating
of the runs that deviate much.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import amplitudes
from herringbone_sim.diagnosis.fits import SURE_SHARE
from herringbone_sim.diagnosis.machine import Amplitudes, Hypothesis
from herringbone_sim.diagnosis.parallel import forked_map, parallel_map
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.diagnosis.search import CHANCE_CHI2
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.hypotheses.moving_parts import MovingPart
from herringbone_sim.gap.observations.windows.shooting import MAX_FIT_CHI2

# Sizes over the moderate one, in the direction of the linear fit; chosen.
SIZE_FACTORS = (-3.0, -1.0, 1.0, 3.0)
# Offsets of the logarithm of a part's stiffness or clearance; chosen.
PART_LOG_FACTORS = (-np.log(3.0), 0.0, np.log(3.0))
ROUNDS_BY_RUN = (3, 8)  # Levenberg-Marquardt steps on the first and second run, for run time
# Trials with new states: multiples of the fitted size, and angles of waves; chosen.
ANEW_FACTORS, N_ANGLES = (1.0, 1.6, 2.5), 8
MAX_SIZED = 24  # best ranked hypotheses tried at sizes about that of their linear fit
MAX_ON_SECOND_RUN, MAX_SWAPS = 24, 3  # trials continued on the second run, and swaps
MAX_KEPT, MAX_KEPT_PER_EFFECT = 4, 2  # largest number of trials returned, in all and by effect


def nonlinear_trials(
    gear: GearObservations,
    rows: Mapping[str, int],
    tolerances: int,
    ranked: Sequence[tuple[Hypothesis, Array]],
    known: Score,
) -> list[tuple[float, Hypothesis, Array]]:
    """Try hypotheses at finite sizes on windows of the motion.

    Args:
        rows: number of rows of each observation.
        tolerances: number of tolerances among the known coefficients; trials keep them at zero,
            as their fit is biased by the unexplained gap.
        ranked: hypotheses with the mean (p,) of their linear fit, known coefficients first.
        known: fit without any of these hypotheses.

    Returns:
        Best trials, best first, a sufficient swap alone: chi2 left of all runs (extrapolated from
        one or two), hypothesis, start values (p,) of its fit. Empty where the known coefficients
        without tolerances leave little of every run.
    """
    count, n = len(gear.runs), len(known.coefficients)
    about = known.mean.copy()
    about[:tolerances] = 0.0
    known_amplitudes = amplitudes(known.coefficients, about, count, rows)
    near = parallel_map(lambda r: gear.states(r, known_amplitudes), range(count))
    chi2_by_run = [
        solution.cost / np.count_nonzero(t.recorded.weight)
        for solution, t in zip(near, gear.trajectories, strict=True)
    ]
    far = [r for r in np.argsort(chi2_by_run).tolist() if chi2_by_run[r] > MAX_FIT_CHI2]
    trials: list[tuple[Hypothesis, Array]] = []
    sized = 0
    for hypothesis, linear in ranked:
        sizes = linear[n : n + hypothesis.n_own]
        if _is_swap(hypothesis):
            trials.append((hypothesis, np.append(about, 1.0)))
        elif isinstance(hypothesis.source, MovingPart):
            center = np.array([c.center for c in hypothesis.coefficients])
            leading = np.arange(len(center)) == 1  # logarithm of stiffness or clearance
            trials += [
                (hypothesis, np.concatenate([about, center + leading * k]))
                for k in PART_LOG_FACTORS
            ]
        elif (
            sized < MAX_SIZED
            and np.any(sizes)
            and all(c.scales_with_effect and not c.center for c in hypothesis.coefficients)
        ):
            sized += 1
            unit = np.array([c.sd for c in hypothesis.coefficients[: hypothesis.n_own]])
            moderate = sizes / np.linalg.norm(sizes / unit)
            zeros = np.zeros(len(hypothesis.coefficients) - hypothesis.n_own)
            trials += [
                (hypothesis, np.concatenate([about, moderate * k, zeros])) for k in SIZE_FACTORS
            ]

    def share_left(r: int, i: int, rounds: int) -> float:
        """Chi2 of run r with trial i over that without it; at most 1, also where it diverges."""
        hypothesis, start = trials[i]
        of_trial = amplitudes((*known.coefficients, *hypothesis.coefficients), start, count, rows)
        if _is_swap(hypothesis):
            return float(np.fmin(gear.states(r, of_trial).cost / near[r].cost, 1.0))
        return float(np.fmin(gear.chi2_from(r, near[r], of_trial, rounds) / near[r].cost, 1.0))

    used = list(zip(far, ROUNDS_BY_RUN, strict=False))
    share = np.ones(len(trials))

    def continued(chosen: Sequence[int], most: int) -> list[int]:
        """Try some on the first run, and at most ``most`` of them on the second; return these."""
        for r, rounds in used:
            left_of_run = parallel_map(partial(share_left, r, rounds=rounds), chosen)
            share[chosen] *= np.array(left_of_run) ** (1.0 / len(used))
            chosen = sorted(chosen, key=lambda i: float(share[i]))[:most]
        return list(chosen)

    swaps = [i for i, (hypothesis, _) in enumerate(trials) if _is_swap(hypothesis)]
    others = [i for i in range(len(trials)) if i not in swaps]
    swaps = continued(swaps, MAX_SWAPS)
    if used and swaps:
        i = swaps[0]
        if share[i] < SURE_SHARE and share[i] * chi2_by_run[far[0]] < MAX_FIT_CHI2:
            return [(float(known.in_sample * share[i]), *trials[i])]
    chosen = continued(others, MAX_ON_SECOND_RUN)
    best: list[tuple[float, Hypothesis, Array]] = []
    for i in sorted((*swaps, *chosen), key=lambda i: float(share[i])) if used else ():
        same = [other for _, other, _ in best if other.effect == trials[i][0].effect]
        known_already = any(trials[i][0] is other for other in same)
        if len(best) < MAX_KEPT and len(same) < MAX_KEPT_PER_EFFECT and not known_already:
            best.append((float(known.in_sample * share[i]), *trials[i]))
    return best


def restart_from_other_sizes(
    gear: GearObservations, rows: Mapping[str, int], hypothesis: Hypothesis, fit: Score
) -> Array | None:
    """Look for a better start of the fit of an effect: other sizes, with states fitted from anew.

    Sizes are multiples of the fitted one of both signs, inside the bounds; an effect of two
    coefficients, as a wave, is tried at ``N_ANGLES`` angles. Departures from the catalogue's curve
    are zero. Trials use the run with the largest chi2 per value. The states of all runs at the
    best trial are remembered for the next fit of the effect.

    Args:
        rows: number of rows of each observation.
        hypothesis, fit: the effect, and its fit.

    Returns:
        Start values (p,) of another fit, those of the base first; None where no trial is better
        than the fit by more than chance.
    """
    first = len(fit.coefficients) - len(hypothesis.coefficients)
    own = slice(first, first + hypothesis.n_own)
    runs = range(len(gear.runs))

    def amplitudes_at(mean: Array) -> Amplitudes:
        return amplitudes(fit.coefficients, mean, len(gear.runs), rows)

    def chi2_per_value(r: int) -> float:
        count = np.count_nonzero(gear.trajectory_of(r).recorded.weight)
        return gear.states(r, amplitudes_at(fit.mean)).cost / count

    r = max(runs, key=chi2_per_value)
    sizes = fit.mean[own]
    bound = np.array([c.bound for c in hypothesis.coefficients[: hypothesis.n_own]])
    turned = [sizes, -sizes]
    if hypothesis.n_own == 2:
        angles = 2.0 * np.pi / N_ANGLES * np.arange(N_ANGLES)
        turn = np.array([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]])
        turned = list(turn.transpose(2, 0, 1) @ sizes)
    trials = []
    for factor in ANEW_FACTORS:
        for size in turned:
            trial = fit.mean.copy()
            trial[own], trial[own.stop :] = np.clip(factor * size, -bound, bound), 0.0
            trials.append(trial)

    def cost(trial: Array) -> float:
        """Chi2 of the run with states anew; inf where they diverge."""
        states = gear.states_anew(r, amplitudes_at(trial))
        return np.inf if states is None or not np.isfinite(states.cost) else states.cost

    costs = forked_map(cost, trials)
    best = int(np.argmin(costs))
    if not costs[best] < gear.states(r, amplitudes_at(fit.mean)).cost - CHANCE_CHI2:
        return None
    at_best = amplitudes_at(trials[best])
    # The first step of the next fit adds departures from the catalogue's curve.
    keys = at_best, amplitudes_at(fit.mean)
    parallel_map(lambda r: gear.states_anew(r, at_best, keys), runs)
    return np.asarray(trials[best])


def _is_swap(hypothesis: Hypothesis) -> bool:
    """Whether a hypothesis is a swap of channels, which is present or absent."""
    return hypothesis.effect == "channel_swap"
