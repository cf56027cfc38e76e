"""Channels that can't be used, told before anything is computed from them.

A channel with NaN, one that stands still or one that is cut at a limit is named with the time and
left out of its run; nothing is filled in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.core.layout import PREFIX_UNITS
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import shown

HEAD = ("t", "phase", "K", "delta_T", "T_1")
AT_LIMIT = 8  # samples at the largest or smallest value from which it may be a limit
CROWDED = 4.0  # times more samples there than at any of the values next to it
NEAR = 20  # values that are next to it


@dataclass(frozen=True)
class Finding:
    """Something odd about a campaign.

    Attributes:
        what: id of the rule, such as ``nan``, ``saturated``, ``unit``, ``clock``.
        run: name of the run; empty for the campaign.
        channels: concerned; empty for all.
        time_s: where it begins [s]; None when it holds throughout.
        text: what is wrong, the value got, and what can still be said.
        fatal: whether nothing can be said of the run.
        limit: whether nothing is wrong, but something can't be told for want of data.
    """

    what: str
    run: str
    channels: tuple[str, ...]
    time_s: float | None
    text: str
    fatal: bool = False
    limit: bool = False


def screen(
    name: str, series: TimeSeries, units: Mapping[str, str] | None = None
) -> tuple[TimeSeries, tuple[Finding, ...]]:
    """A run without the channels that can't be used, and why each was left out.

    Args:
        name: of the run.
        series: as recorded.
        units: of channels, as the recorder declares them.
    """
    found = []
    gated = may_be_gated(series.names)
    for channel in series.names:
        if channel in HEAD:
            continue
        finding = _nan(name, series, channel, gated) or _still(name, series, channel)
        finding = finding or _declared(name, series, channel, (units or {}).get(channel))
        finding = finding or _saturated(name, series, channel)
        if finding is not None:
            found.append(finding)
    bad = {channel for finding in found for channel in finding.channels}
    keep = tuple(n for n in series.names if n not in bad)
    clean = TimeSeries(series.times, series.columns(keep), keep) if bad else series
    return clean, tuple(_together(found))


def may_be_gated(names: Sequence[str]) -> bool:
    """Whether forces may have gaps: beside displacements the force law needs them whole."""
    return not any(name.startswith("x_") for name in names)


def _together(found: list[Finding]) -> list[Finding]:
    """One finding for all channels of a run that have the same fault, told of the first."""
    kinds: dict[str, list[Finding]] = {}
    for finding in found:
        kinds.setdefault(finding.what, []).append(finding)
    merged = []
    for same in kinds.values():
        first = min(same, key=lambda one: one.time_s or 0.0)
        rest = [channel for one in same if one is not first for channel in one.channels]
        text = f"{first.text}; so it is with {', '.join(rest)}" if rest else first.text
        merged.append(replace(first, channels=(*first.channels, *rest), text=text))
    return merged


def _declared(name: str, series: TimeSeries, channel: str, unit: str | None) -> Finding | None:
    expected = PREFIX_UNITS.get(channel.split("_")[0])
    if unit is None or expected is None or unit == expected:
        return None
    text = (
        f"{channel} of {name} is declared in {shown(unit)}, a recording holds {expected}: another "
        "unit than SI; the channel is left out of this run, not rescaled"
    )
    return Finding("unit", name, (channel,), float(series.times[0]), text)


def _nan(name: str, series: TimeSeries, channel: str, gated: bool) -> Finding | None:
    """Channels with gaps; a gauge beside which no displacement is recorded may see at times."""
    missing = ~np.isfinite(series[channel])
    if not missing.any() or (gated and channel[0] == "F" and not missing.all()):
        return None
    first, share = float(series.times[int(missing.argmax())]), float(missing.mean())
    rest = "" if channel[0] == "F" else "; its place follows from others where geometry allows"
    text = (
        f"{channel} of {name} is no number in {share:.1%} of the samples, first at {first:.6g} s: "
        f"the channel is left out of this run{rest}"
    )
    return Finding("nan", name, (channel,), first, text)


def _still(name: str, series: TimeSeries, channel: str) -> Finding | None:
    values = series[channel]
    values = values[np.isfinite(values)]
    if len(values) < 3 or np.ptp(values) > 0.0:
        return None
    text = (
        f"{channel} of {name} stands at {values[0]:.6g} throughout: a sensor that is off or not "
        "connected; the channel is left out of this run"
    )
    return Finding("still", name, (channel,), float(series.times[0]), text)


def _saturated(name: str, series: TimeSeries, channel: str) -> Finding | None:
    """A limit is a last value that is met far more often than all those next to it.

    Noise, a resolution of the converter and a motion that repeats itself crowd the values next to
    an extreme as well.
    """
    values = series[channel]
    levels, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    for limit, count, beside in (
        (levels[-1], counts[-1], counts[-1 - NEAR : -1]),
        (levels[0], counts[0], counts[1 : 1 + NEAR]),
    ):
        if count >= AT_LIMIT and len(beside) and count > CROWDED * beside.max():
            first = float(series.times[int((values == limit).argmax())])
            text = (
                f"{channel} of {name} is cut at {limit:.6g}: {int(count)} samples stand there, "
                f"first at {first:.6g} s: widen the range of the sensor; the channel is left out "
                "of this run"
            )
            return Finding("saturated", name, (channel,), first, text)
    return None
