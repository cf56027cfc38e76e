"""Clock drift: the recorded time runs at another rate, t (1 + ppm 1e-6); a slow clock is negative.

Source: by definition; neither the motion nor any other channel changes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import replaced
from herringbone_sim.effects.effect import Effect, Parameter


def distort(
    theta: NDArray[np.float64], series: TimeSeries, channels: tuple[str, ...]
) -> TimeSeries:
    """Replace the times by those of the drifting clock."""
    times = series.times * (1.0 + 1e-6 * theta[0])
    return replaced(TimeSeries(times, series.data, series.names), {"t": times})


EFFECT = Effect(
    id="clock_drift",
    text="the clock of the recording runs at another rate",
    level="sensor",
    parameters=(Parameter("ppm", "1e-6", "fast if positive", -2e5, 2e5, 100.0),),
    distort=distort,
)
