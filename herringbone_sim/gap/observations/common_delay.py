"""The common delay of all channels where rotations don't tell it: by what the gear's laws say.

The delay of e(t) and k(t) that lets the calibrated gear leave least of short stretches of the runs
is taken, unless a shift in time of some meshes or sensors alone leaves less.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from herringbone_sim.diagnosis.search import Search
from herringbone_sim.gap.data.folds import slice_run
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.machine import GearMachine
from herringbone_sim.gap.sensors.filter_delay import (
    compensate_filter,
    longest_delay,
    with_delayed_waves,
)

CYCLES = 20  # of a stretch: a hundred times what the balance averages over
STRETCHES = 2  # of the fastest runs, where a delay shows most
TENTH_S = 1e-7  # precision of a delay: a fiftieth of the longest of the data sheet
ENOUGH = 2.0  # squares a value: where the gear leaves no more than its noise again, no delay shows
SHIFTS = ("stagger", "planet_phase", "sensor_delay", "clock_drift")  # in time, of some alone


def undelayed(
    runs: Sequence[PreparedRun], gain_tolerance: Sequence[float]
) -> tuple[PreparedRun, ...]:
    """The runs with k(t) and e(t) late as all channels are; as they were where none is found."""
    if all(run.u.complete and run.x.there.any() for run in runs):
        return compensate_filter(runs)
    fastest = sorted(runs, key=lambda run: -run.omega_rad_per_s)[:STRETCHES]
    some = [_stretch(run) for run in fastest]

    gear = Gear(some)
    if gear.by_windows or not GearMachine(gear).formed:
        return tuple(runs)

    def null(delay: float) -> Search:
        gear = Gear(
            [with_delayed_waves(run, delay) for run in some], gain_tolerance=gain_tolerance
        )
        return Search(GearMachine(gear))

    def left(delay: float) -> float:
        """Whitened squares a value."""
        score = null(delay).null
        return score.in_sample / score.count

    search = null(0.0)
    if search.null.in_sample < ENOUGH * search.null.count:
        return tuple(runs)
    found = minimize_scalar(left, bounds=(0.0, longest_delay(runs[0])), options={"xatol": TENTH_S})
    search = search.onwards(search.machine)
    shifts = [h for h in search.machine.hypotheses() if h.effect in SHIFTS]
    most = min((search.quick(h.coefficients) for h in shifts), default=0.0)
    if found.fun * search.null.count < search.null.in_sample + min(most, 0.0):
        return tuple(with_delayed_waves(run, float(found.x)) for run in runs)
    return tuple(runs)


def _stretch(run: PreparedRun) -> PreparedRun:
    samples = CYCLES * 2.0 * np.pi / (run.omega_rad_per_s * run.step_s)
    return slice_run(run, slice(0, int(samples)), run.name)
