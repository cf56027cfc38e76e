"""Channels that can't be used, told before anything is computed from them.

A channel with NaN, one that stands still or one that is cut at a limit is named with the time and
left out of its run; nothing is filled in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.timeseries import TimeSeries

Array = NDArray[np.float64]

HEAD = ("t", "phase", "K", "delta_T", "T_1")
AT_LIMIT = 5  # samples in a row at the largest or smallest value: noise never repeats one


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


def screen(name: str, series: TimeSeries) -> tuple[TimeSeries, tuple[Finding, ...]]:
    """A run without the channels that can't be used, and why each was left out."""
    found, bad = [], set()
    for channel in series.names:
        if channel in HEAD:
            continue
        finding = _nan(name, series, channel) or _still(name, series, channel)
        finding = finding or _saturated(name, series, channel)
        if finding is not None:
            found.append(finding)
            bad.add(channel)
    keep = tuple(n for n in series.names if n not in bad)
    clean = TimeSeries(series.times, series.columns(keep), keep) if bad else series
    return clean, (*_clock(name, series), *found)


def _nan(name: str, series: TimeSeries, channel: str) -> Finding | None:
    missing = ~np.isfinite(series[channel])
    if not missing.any():
        return None
    first, share = float(series.times[int(missing.argmax())]), float(missing.mean())
    text = (
        f"{channel} of {name} is no number in {share:.1%} of the samples, first at {first:.6g} s: "
        "the channel is left out of this run; its place follows from others where geometry allows"
    )
    return Finding("nan", name, (channel,), first, text)


def _still(name: str, series: TimeSeries, channel: str) -> Finding | None:
    values = series[channel]
    if np.ptp(values) > 0.0 or len(values) < AT_LIMIT:
        return None
    text = (
        f"{channel} of {name} stands at {values[0]:.6g} throughout: a sensor that is off or not "
        "connected; the channel is left out of this run"
    )
    return Finding("still", name, (channel,), None, text)


def _saturated(name: str, series: TimeSeries, channel: str) -> Finding | None:
    values = series[channel]
    for limit in (values.max(), values.min()):
        flat = np.concatenate([[0], values == limit, [0]]).astype(int)
        starts, ends = np.flatnonzero(np.diff(flat) == 1), np.flatnonzero(np.diff(flat) == -1)
        length = ends - starts
        if length.size and length.max() >= AT_LIMIT:
            first = float(series.times[starts[int((length >= AT_LIMIT).argmax())]])
            text = (
                f"{channel} of {name} is cut at {limit:.6g}: {int(flat.sum())} samples stand "
                f"there, first at {first:.6g} s: widen the range of the sensor; the channel is "
                "left out of this run"
            )
            return Finding("saturated", name, (channel,), first, text)
    return None


def _clock(name: str, series: TimeSeries) -> list[Finding]:
    found = []
    if len(series) > 2:
        steps = np.diff(series.times)
        odd = np.abs(steps / np.median(steps) - 1.0) > 0.5
        if odd.any():
            at = int(odd.argmax())
            text = (
                f"the clock of {name} jumps by {steps[at]:.6g} s at {series.times[at]:.6g} s, "
                f"a step is {np.median(steps):.6g} s: samples are missing; what needs the time "
                "between samples is wrong there, the force law is not"
            )
            found.append(Finding("clock", name, ("t",), float(series.times[at]), text))
    if "phase" in series and len(series) > 2:
        turn = np.diff(series["phase"])
        slips = ~(np.abs(turn / np.median(turn) - 1.0) < 0.5)
        if slips.any():
            at = int(slips.argmax())
            text = (
                f"the mesh phase of {name} goes on by {turn[at]:.6g} rad at "
                f"{series.times[at]:.6g} s, a step is {np.median(turn):.6g} rad: k(t) and e(t) "
                "are not known across it"
            )
            found.append(Finding("phase", name, ("phase",), float(series.times[at]), text))
    return found
