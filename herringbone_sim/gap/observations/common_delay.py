"""Estimate the delay common to all channels where rotations don't determine it.

The delay of e(t) and k(t) that minimises the residual of the nominal gear with fitted tolerances,
on short stretches of the fit runs, is applied to k(t) and e(t) of all runs, unless a time shift of
single meshes or sensors explains more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from herringbone_sim.diagnosis.search import Search
from herringbone_sim.gap.data.folds import slice_run
from herringbone_sim.gap.data.prepared import PreparedRun, deciding
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.machine import GearMachine
from herringbone_sim.gap.sensors.filter_delay import (
    compensate_filter,
    longest_delay,
    with_delayed_waves,
)

STRETCH_CYCLES = 20  # mesh cycles of a stretch, chosen: over 100 windows of the balance
N_STRETCHES = 2  # runs used: the fastest, where a delay is largest as a phase
DELAY_TOLERANCE_S = 1e-7  # a fiftieth of the longest delay of the data sheet
# Chi2 per value up to which the calibrated gear without effects fits: what it lacks is no larger
# than the noise (d = 1).
NULL_FITS_CHI2 = 2.0
# Effects that shift single meshes or sensors in time.
TIME_SHIFT_EFFECTS = ("stagger", "planet_phase", "sensor_delay", "clock_drift")


def remove_common_delay(
    runs: Sequence[PreparedRun], gain_tolerance: Sequence[float]
) -> tuple[PreparedRun, ...]:
    """Return the runs with k(t) and e(t) delayed like the channels; unchanged without a delay.

    ``compensate_filter`` estimates the delay if a fit run has displacements and all rotations.

    Args:
        runs: of one rig; those of the role ``fit`` decide.
        gain_tolerance: (n_mesh,) of force sensors; empty: none.
    """
    fit = deciding(runs)
    if any(run.u.complete and run.x.recorded.any() for run in fit):
        return compensate_filter(runs)
    fastest = sorted(fit, key=lambda run: -run.omega_rad_per_s)[:N_STRETCHES]
    stretches = [_stretch(run) for run in fastest]

    gear = Gear(stretches)
    if gear.uses_windows or not GearMachine(gear).observation_names:
        return tuple(runs)

    def null(delay: float) -> Search:
        gear = Gear(
            [with_delayed_waves(run, delay) for run in stretches], gain_tolerance=gain_tolerance
        )
        return Search(GearMachine(gear))

    def chi2_per_value(delay: float) -> float:
        """Chi2 per value of the gear with fitted tolerances at a delay [s]."""
        score = null(delay).null
        return score.in_sample / score.count

    search = null(0.0)
    if search.null.in_sample < NULL_FITS_CHI2 * search.null.count:
        return tuple(runs)
    optimum = minimize_scalar(
        chi2_per_value, bounds=(0.0, longest_delay(runs[0])), options={"xatol": DELAY_TOLERANCE_S}
    )
    search = search.onwards(search.machine)
    shifts = [h for h in search.machine.hypotheses() if h.effect in TIME_SHIFT_EFFECTS]
    shift_chi2 = min((search.quick(h.coefficients) for h in shifts), default=0.0)
    if optimum.fun * search.null.count < search.null.in_sample + min(shift_chi2, 0.0):
        return tuple(with_delayed_waves(run, float(optimum.x)) for run in runs)
    return tuple(runs)


def _stretch(run: PreparedRun) -> PreparedRun:
    """First ``STRETCH_CYCLES`` mesh cycles of a run."""
    samples = STRETCH_CYCLES * 2.0 * np.pi / (run.omega_rad_per_s * run.step_s)
    return slice_run(run, slice(0, int(samples)), run.name)
