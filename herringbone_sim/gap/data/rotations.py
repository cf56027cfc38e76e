"""Compute rotations u from raw encoder angles, and detect rotations that lack their mean.

An encoder measures angles from an arbitrary mark, not from the middle of the backlash. Where the
steady rotation is subtracted, the mean rotation by the wind-up under load is subtracted with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from herringbone_sim.core.model import Model
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import listed
from herringbone_sim.gap.data.noise import resolution
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.recording.importing.spec import recorded_name
from herringbone_sim.recording.importing.turns import unwrapped, with_turns

ROUNDING = 1e-9  # mean over largest value below which the mean is a rounding error


def with_rotations(model: Model, series: TimeSeries) -> tuple[TimeSeries, tuple[str, ...]]:
    """Replace raw angles ``angle_*`` [rad] by rotations ``u_*`` [m]; also return the new names.

    Where ``u_*`` of a body is recorded itself, it and the angle are not changed.
    """
    names = [f"angle_{body}" for body in model.layout.bodies]
    angles = {
        n: unwrapped(series[n]) for n in names if n in series and recorded_name(n) not in series
    }
    if not angles:
        return series, ()
    rotations = with_turns(model, "", 0.0, series.times, angles)
    other_columns = [i for i, name in enumerate(series.names) if name not in angles]
    data = np.column_stack([series.data[:, other_columns], *rotations.values()])
    return (
        TimeSeries(series.times, data, (*(series.names[i] for i in other_columns), *rotations)),
        tuple(rotations),
    )


def without_angles_not_in_rad(
    run: str, series: TimeSeries, units: Mapping[str, str]
) -> tuple[TimeSeries, list[Finding]]:
    """Remove channels ``angle_*`` that are declared in another unit than rad.

    Args:
        run: name of the run, for the text of the finding.
        units: declared units by channel; an empty or missing one counts as rad.

    Returns:
        The other channels, and one finding if any were removed.
    """
    odd = [
        n
        for n in series.names
        if n.startswith("angle_") and units.get(n, "rad") not in ("", "rad")
    ]
    if not odd:
        return series, []
    columns = [i for i, name in enumerate(series.names) if name not in odd]
    told = listed([f"{n} in {units[n]}" for n in odd])
    text = f"angles of {run} that are not in rad are not used: {told}"
    finding = Finding("unit", run, tuple(odd), float(series.times[0]), text)
    names = tuple(series.names[i] for i in columns)
    return TimeSeries(series.times, series.data[:, columns], names), [finding]


def detrended_rotations(series: TimeSeries, names: Sequence[str]) -> tuple[str, ...]:
    """Return which of the rotations ``names`` are recorded, if all lack their mean; else none.

    Rotations about the middle of the backlash have a mean, as the load winds the gear up. It
    counts as zero below the rounding error, or below half a step of the converter.
    """
    there = tuple(n for n in names if n in series and np.isfinite(series[n]).any())
    for name in there:
        values = series[name][np.isfinite(series[name])]
        step = float(resolution(values[:, None])[0])
        if abs(values.mean()) > max(0.5 * step, ROUNDING * float(np.abs(values).max())):
            return ()
    return there
