"""Sensor delay: a channel shows y(t - delay).

Interpolated between samples by Akima's cubic; constant before the first and after the last sample.
Source: by definition; the motion does not change.
"""

from __future__ import annotations

from herringbone_sim.arrays import Array
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import CHANNELS, between, replaced
from herringbone_sim.effects.effect import Effect, Parameter
from herringbone_sim.effects.site import ANYWHERE


def distort(theta: Array, series: TimeSeries, channels: tuple[str, ...]) -> TimeSeries:
    """Return the series with the channels delayed by theta[0] seconds."""
    at = series.times - theta[0]
    return replaced(series, {name: between(series.times, series[name], at) for name in channels})


EFFECT = Effect(
    id="sensor_delay",
    text="a channel comes late",
    level="sensor",
    parameters=(Parameter("delay", "s", "how late", -1e-3, 1e-3, 2e-6),),
    options=(CHANNELS,),
    loci=ANYWHERE,
    distort=distort,
    reach=lambda theta: abs(theta[0]),
)
