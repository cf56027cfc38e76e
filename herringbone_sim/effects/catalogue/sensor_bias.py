"""Sensor bias: a channel shows y + bias, in the channel's unit.

Source: definition of a zero error; the motion does not change.
"""

from __future__ import annotations

from herringbone_sim.arrays import Array
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import CHANNELS, replaced
from herringbone_sim.effects.effect import Effect, Parameter
from herringbone_sim.effects.site import ANYWHERE


def distort(theta: Array, series: TimeSeries, channels: tuple[str, ...]) -> TimeSeries:
    """Return the series with the bias added to the channels."""
    return replaced(series, {name: series[name] + theta[0] for name in channels})


EFFECT = Effect(
    id="sensor_bias",
    text="a channel shows its value plus a constant",
    level="sensor",
    parameters=(Parameter("bias", "unit of the channel", "shown less true", -1e6, 1e6, 2e3),),
    options=(CHANNELS,),
    loci=ANYWHERE,
    distort=distort,
)
