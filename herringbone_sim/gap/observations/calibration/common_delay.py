"""Estimate the delay common to all channels where rotations don't determine it.

The delay of e(t), k(t) and control that minimises the residual of the nominal gear with fitted
tolerances, on short stretches of the fit runs, is applied to those of all runs, unless a time
shift of single meshes or sensors explains more. Where states are estimated, it is that of the
nominal gear on a few windows, if most of the residual goes with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from herringbone_sim.diagnosis.parallel import forked_map
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.gap.data.folds import slice_run
from herringbone_sim.gap.data.prepared import PreparedRun, deciding
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.windows.trajectory import Trajectory
from herringbone_sim.gap.sensors.filter_delay import (
    MOST_UNEXPLAINED,
    compensate_filter,
    e_ratio,
    longest_delay,
    with_delayed_waves,
)

STRETCH_CYCLES = 20  # mesh cycles of a stretch, chosen: over 100 windows of the balance
# Runs used: the fastest, where a delay is largest as a phase, and that with the largest control.
N_STRETCHES = 2
N_WINDOWS = 6  # windows of each run where states are estimated, chosen for run time
DELAY_TOLERANCE_S = 1e-7  # a fiftieth of the longest delay of the data sheet
MAX_TRIALS = 6  # of delays beside none, chosen for run time; 3 suffice for a parabola
# Effects that shift single meshes or sensors in time.
TIME_SHIFT_EFFECTS = ("stagger", "planet_phase", "sensor_delay", "clock_drift")


def remove_common_delay(
    runs: Sequence[PreparedRun], gain_tolerance: Sequence[float]
) -> tuple[PreparedRun, ...]:
    """Return the runs with k(t) and e(t) delayed like the channels; unchanged without a delay.

    ``compensate_filter`` estimates the delay if a fit run has displacements whose e(t) has a first
    harmonic, and all rotations.

    Args:
        runs: of one rig; those of the role ``fit`` decide.
        gain_tolerance: (n_mesh,) of force sensors; empty: none.
    """
    fit = deciding(runs)
    if any(run.u.complete and e_ratio(run).size for run in fit):
        return compensate_filter(runs)
    stretches = [_stretch(run) for run in _showing_delay(fit, N_STRETCHES)]
    gear = GearObservations(stretches)
    if not gear.observation_names:
        return tuple(runs)
    if gear.uses_windows:
        return _by_windows(runs, _showing_delay(fit, 1))

    def null(delay: float) -> Search:
        gear = GearObservations(
            [with_delayed_waves(run, delay) for run in stretches], gain_tolerance=gain_tolerance
        )
        return Search(GearMachine(gear))

    search = null(0.0)
    delay, chi2 = _least(
        lambda delay: null(delay).null.in_sample, search.null.in_sample, longest_delay(runs[0])
    )
    search = search.onwards(search.machine)
    shifts = [h for h in search.machine.hypotheses() if h.effect in TIME_SHIFT_EFFECTS]
    shift_chi2 = min((search.quick(h.coefficients) for h in shifts), default=0.0)
    if chi2 < search.null.in_sample + min(shift_chi2, 0.0):
        return tuple(with_delayed_waves(run, delay) for run in runs)
    return tuple(runs)


def _least(chi2: Callable[[float], float], at_zero: float, longest: float) -> tuple[float, float]:
    """Delay [s] from 0 to ``longest`` of least chi2, by parabolas, and that chi2.

    Args:
        chi2: at a delay; close to a parabola, as delays are short against the mesh period.
        at_zero: chi2 without delay.
    """
    tried = {0.0: at_zero, longest: chi2(longest), 0.5 * longest: chi2(0.5 * longest)}
    while len(tried) < 1 + MAX_TRIALS:
        best = min(tried, key=lambda delay: tried[delay])
        near = sorted(tried, key=lambda delay: abs(delay - best))[:3]
        vertex = _vertex(near, [tried[delay] for delay in near], longest)
        if vertex is None or min(abs(vertex - delay) for delay in tried) < DELAY_TOLERANCE_S:
            break
        tried[vertex] = chi2(vertex)
    best = min(tried, key=lambda delay: tried[delay])
    return best, tried[best]


def _vertex(delays: Sequence[float], values: Sequence[float], longest: float) -> float | None:
    """Delay [s] from 0 to ``longest`` where the parabola through three values is least.

    None where it has no minimum, or a value is not finite.
    """
    if not np.isfinite(values).all():
        return None
    bend, slope, _ = np.polyfit(np.divide(delays, longest), values, 2)
    return float(np.clip(-0.5 * slope / bend, 0.0, 1.0)) * longest if bend > 0.0 else None


def _showing_delay(runs: Sequence[PreparedRun], n_fastest: int) -> list[PreparedRun]:
    """Fastest runs, and that with the largest control if there is any."""
    by_speed = sorted(runs, key=lambda run: -run.omega_rad_per_s)
    controlled = [run for run in by_speed if run.point["K"]]
    by_control = sorted(controlled, key=lambda run: -abs(run.point["K"]) * run.omega_rad_per_s)
    return list({run.name: run for run in (*by_speed[:n_fastest], *by_control[:1])}.values())


def _by_windows(
    runs: Sequence[PreparedRun], used: Sequence[PreparedRun]
) -> tuple[PreparedRun, ...]:
    """Delay the waves of ``runs`` by what windows of the runs ``used`` leave least with.

    Unchanged unless that removes most of the residual: what is left is fitted with the tolerances.
    """

    def left(run: PreparedRun, delay: float = 0.0) -> float:
        """Mean square of the residual over the noise, under the nominal law."""
        trajectory = Trajectory(with_delayed_waves(run, delay), N_WINDOWS)
        channels, residual_rms = trajectory.recorded.channels, trajectory.noise_left()
        squares = [
            (residual_rms[name] / sigma) ** 2
            for name, sigma in zip(channels.names, channels.sigma, strict=True)
            if name in residual_rms
        ]
        return float(np.mean(squares)) if squares else np.inf

    without = {run.name: x for run, x in zip(used, forked_map(left, used), strict=True)}
    used = [run for run in used if 0.0 < without[run.name] < np.inf]
    if not used:
        return tuple(runs)
    before = [without[run.name] for run in used]

    def share(delay: float) -> float:
        """What is left at a delay [s] over what is left without one, mean over the runs."""
        return float(np.mean(np.divide(forked_map(partial(left, delay=delay), used), before)))

    longest = longest_delay(runs[0])
    step = longest / 4.0
    first = share(step)
    if not first < 1.0:
        return tuple(runs)
    second = share(2.0 * step)
    vertex = _vertex((0.0, step, 2.0 * step), (1.0, first, second), longest)
    delay = longest if vertex is None else vertex
    delay = delay if second < np.inf else step
    if not share(delay) < MOST_UNEXPLAINED:
        return tuple(runs)
    return tuple(with_delayed_waves(run, delay) for run in runs)


def _stretch(run: PreparedRun) -> PreparedRun:
    """First ``STRETCH_CYCLES`` mesh cycles of a run."""
    samples = STRETCH_CYCLES * 2.0 * np.pi / (run.omega_rad_per_s * run.step_s)
    return slice_run(run, slice(0, int(samples)), run.name)
