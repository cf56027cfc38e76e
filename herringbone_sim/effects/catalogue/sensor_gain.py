"""Sensor gain: a channel shows gain times y.

Source: definition of a calibration error; the motion does not change.
"""

from __future__ import annotations

from herringbone_sim.arrays import Array
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import CHANNELS, replaced
from herringbone_sim.effects.effect import Effect, Parameter
from herringbone_sim.effects.site import ANYWHERE


def distort(theta: Array, series: TimeSeries, channels: tuple[str, ...]) -> TimeSeries:
    """Return the series with the channels multiplied by the gain."""
    return replaced(series, {name: theta[0] * series[name] for name in channels})


EFFECT = Effect(
    id="sensor_gain",
    text="a channel shows its value times a gain",
    level="sensor",
    parameters=(Parameter("gain", "-", "shown over true", 0.2, 5.0, 1.1, neutral=1.0),),
    options=(CHANNELS,),
    loci=ANYWHERE,
    distort=distort,
)
