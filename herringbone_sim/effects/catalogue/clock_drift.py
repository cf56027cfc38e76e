"""Clock drift: the recorded time runs at another rate, t (1 + ppm 1e-6); a slow clock is negative.

Channels that are named come from a second recorder: they show y(t (1 + ppm 1e-6)) at unchanged
times t, later values for a positive ppm, which here means that the clock of that recorder is slow.
Source: by definition; the motion does not change.
"""

from __future__ import annotations

from herringbone_sim.arrays import Array
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import between, replaced
from herringbone_sim.effects.effect import Effect, Option, Parameter


def distort(theta: Array, series: TimeSeries, channels: tuple[str, ...]) -> TimeSeries:
    """Return the series with drifting times, or with drifting values of the named channels."""
    if channels:
        at = series.times * (1.0 + 1e-6 * theta[0])
        return replaced(series, {n: between(series.times, series[n], at) for n in channels})
    times = series.times * (1.0 + 1e-6 * theta[0])
    return replaced(TimeSeries(times, series.data, series.names), {"t": times})


EFFECT = Effect(
    id="clock_drift",
    text="the clock of the recording runs at another rate",
    level="sensor",
    parameters=(
        Parameter("ppm", "1e-6", "fast if positive; of named channels: slow", -2e5, 2e5, 100.0),
    ),
    options=(Option("channels", "those of a recorder of their own; none: all", ()),),
    distort=distort,
    needs_recording=bool,
)
