"""The clock of a recording against the mesh phase, which turns at Omega omega_n.

A rig holds its speed better or worse, a clock errs by the same share in every run: only what is
common to all runs, beside their scatter, is taken for the clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.waves import waves

FINEST_PPM = 1.0
SIGNIFICANT = 6.0
FEWEST = 2


@dataclass(frozen=True)
class Clock:
    """A clock that is fast by so many ppm, with its sigma."""

    ppm: float
    sigma: float


def rate_ppm(run: PreparedRun) -> float:
    """How fast the clock of a run is by its phase [ppm]; slow is negative."""
    omega = run.model.parameters.Omega * run.model.scales.omega_n
    return float(1e6 * (omega / run.omega_rad_per_s - 1.0))


def find_clock(runs: Sequence[PreparedRun]) -> Clock | None:
    """The drift that all runs share; None when it is not beyond their scatter."""
    if len(runs) < FEWEST:
        return None
    rates: NDArray[np.float64] = np.array([rate_ppm(run) for run in runs])
    sigma = max(FINEST_PPM, float(rates.std(ddof=1))) / np.sqrt(len(rates))
    drift = float(rates.mean())
    return Clock(drift, sigma) if abs(drift) > SIGNIFICANT * sigma else None


def lateness(runs: Sequence[PreparedRun], ppm: float = 0.0) -> float:
    """Mean square of the drift that is left after a correction, over the finest that is told."""
    left = [(rate_ppm(run) - ppm) / FINEST_PPM for run in runs]
    return float(np.mean(np.square(left)))


def set_right(run: PreparedRun, ppm: float) -> PreparedRun:
    """A run with the times that a true clock had shown."""
    times = run.times / (1.0 + 1e-6 * ppm)
    omega = float((run.phase[-1] - run.phase[0]) / (times[-1] - times[0]))
    return replace(run, times=times, waves=waves(run.model, run.phase, omega))
