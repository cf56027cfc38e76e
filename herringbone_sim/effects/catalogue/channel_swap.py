"""Channel swap: two channels carry each other's values.

Source: by definition; the motion does not change.
"""

from __future__ import annotations

from herringbone_sim.arrays import Array
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import CHANNELS, replaced
from herringbone_sim.effects.effect import Effect
from herringbone_sim.errors import ParameterError, listed


def distort(theta: Array, series: TimeSeries, channels: tuple[str, ...]) -> TimeSeries:
    """Return the series with two channels swapped; ParameterError unless there are two."""
    if len(channels) != 2:
        raise ParameterError(f"channel_swap takes two channels, got {listed(channels)}: name both")
    first, second = channels
    return replaced(series, {first: series[second], second: series[first]})


EFFECT = Effect(
    id="channel_swap",
    text="two channels carry each other's values",
    level="sensor",
    parameters=(),
    options=(CHANNELS,),
    distort=distort,
)
