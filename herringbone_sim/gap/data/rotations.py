"""Rotations of raw encoder angles, and rotations that lack their mean.

An encoder tells how far its shaft has turned since a mark that has nothing to do with the middle
of the backlash. Once the steady rotation is taken off, the wind-up under the load is gone with it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from herringbone_sim.core.model import Model
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.gap.data.noise import resolution
from herringbone_sim.recording.importing.spec import recorded_name
from herringbone_sim.recording.importing.turns import unwrapped, with_turns

ROUNDING = 1e-9  # mean over largest value below which it is rounding alone


def with_rotations(model: Model, series: TimeSeries) -> tuple[TimeSeries, tuple[str, ...]]:
    """Series with raw encoder angles ``angle_*`` replaced by rotations, and the names of those.

    A rotation that is recorded itself stays, and the angle of its body is left alone.
    """
    names = [f"angle_{body}" for body in model.layout.bodies]
    angles = {
        n: unwrapped(series[n]) for n in names if n in series and recorded_name(n) not in series
    }
    if not angles:
        return series, ()
    made = with_turns(model, "", 0.0, series.times, angles)
    kept = [i for i, name in enumerate(series.names) if name not in angles]
    data = np.column_stack([series.data[:, kept], *made.values()])
    return (
        TimeSeries(series.times, data, (*(series.names[i] for i in kept), *made)),
        tuple(made),
    )


def without_mean(series: TimeSeries, names: Sequence[str]) -> tuple[str, ...]:
    """The rotations ``names`` of a recording, if none of them has a mean; else none.

    Rotations about the middle of the backlash have one, as the load winds the gear up. It is zero
    where it is less than rounding, or than half a step of the converter.
    """
    there = tuple(name for name in names if name in series)
    lost = []
    for name in there:
        values = series[name][np.isfinite(series[name])]
        size = np.abs(values).max(initial=0.0)
        least = max(0.5 * float(resolution(values[:, None])[0]), ROUNDING * float(size))
        lost.append(len(values) > 0 and abs(values.mean()) <= least)
    return there if any(lost) and all(lost) else ()
