"""Channels that a sensor effect changes, and tools to change channels of a series."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from herringbone_sim.arrays import Array
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.effect import Active, Option
from herringbone_sim.errors import ParameterError, listed

CHANNELS = Option("channels", "channels concerned: names, or x, v, F of the locus", ("F",))
PREFIXES = ("x", "v", "F")


def distort(series: TimeSeries, actives: tuple[Active, ...]) -> TimeSeries:
    """Return a series with the sensor effects applied in turn; other effects are ignored.

    Raises:
        ParameterError: a channel that the series does not have.
    """
    for active in actives:
        if active.effect.distort is not None:
            named = channels_of(series, active)
            series = active.effect.distort(np.array(active.theta), series, named)
    return series


def channels_of(series: TimeSeries, sensor_effect: Active) -> tuple[str, ...]:
    """Return ``names_of`` a sensor effect; ParameterError if the series lacks one of them."""
    named = names_of(series.names, sensor_effect)
    missing = [name for name in named if name not in series]
    if missing:
        raise ParameterError(
            f"{sensor_effect.effect.id} concerns {listed(missing)}, the recording has "
            f"{listed(series.names)}: name channels that it has"
        )
    return named


def names_of(known: Sequence[str], sensor_effect: Active) -> tuple[str, ...]:
    """Return the channels that the option ``channels`` of a sensor effect names.

    ``x``, ``v`` and ``F`` stand for all known channels of that quantity at the locus.
    """
    wanted = sensor_effect.chosen.get("channels", ())
    named: list[str] = []
    for name in (wanted,) if isinstance(wanted, str) else wanted:
        named += _of_locus(known, sensor_effect, name) if name in PREFIXES else [name]
    return tuple(named)


def on_channels(names: Sequence[str], actives: Sequence[Active]) -> tuple[Active, ...]:
    """Return the sensor effects that change only channels among ``names``.

    Effects that name no channel change the whole recording and are included.
    """
    selected = []
    for active in actives:
        concerned = names_of(names, active)
        inside = set(concerned) <= set(names) if concerned else not active.chosen.get("channels")
        if active.effect.level == "sensor" and inside:
            selected.append(active)
    return tuple(selected)


def _of_locus(known: Sequence[str], sensor_effect: Active, prefix: str) -> list[str]:
    """Return the known channels of a quantity (x, v or F) at the locus of an effect."""
    place = sensor_effect.locus
    channels = []
    for name in known:
        kind, _, side = name.removeprefix(f"{prefix}_").partition("_")
        if (
            name.startswith(f"{prefix}_")
            and not name.startswith("F_pin")
            and (
                place.mesh in ("all", kind[:2])
                and place.planet in ("all", kind[2:])
                and place.side in ("all", side)
            )
        ):
            channels.append(name)
    return channels


def replaced(series: TimeSeries, columns: Mapping[str, Array]) -> TimeSeries:
    """Return a copy of a series with new samples (n,) of some channels; others are ignored."""
    data = series.data.copy()
    for name, values in columns.items():
        if name in series:
            data[:, series.names.index(name)] = values
    return TimeSeries(series.times, data, series.names)


def between(times: Array, values: Array, at: Array) -> Array:
    """Return values (m,) at times ``at`` (m,) by Akima interpolation, constant beyond the ends.

    ``times`` and ``values`` (n,) may be a single sample, which then has no slope.
    """
    if len(times) < 2:
        return np.broadcast_to(values, at.shape)
    inside = np.clip(at, times[0], times[-1])
    interpolated: Array = Akima1DInterpolator(times, values)(inside)
    return interpolated
