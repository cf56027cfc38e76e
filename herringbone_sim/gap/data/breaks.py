"""Breaks of a recording: the clock jumps, samples are missing, all channels are blank.

What needs the time between samples holds on one side of a break only, so a run is cut there and
its longest part is kept; nothing is filled in and no clock is put right.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.gap.data.screen import HEAD, Finding, may_be_gated

Mask = NDArray[np.bool_]

ODD = 0.5  # share by which a step of time or phase is off the usual one
BLANK = 0.5  # share of the channels that are no number


def longest_part(name: str, series: TimeSeries) -> tuple[TimeSeries, tuple[Finding, ...]]:
    """The longest part of a run without a break, and what broke it, with channel and time."""
    if len(series) < 3:
        return series, ()
    clock, phase, blank = _clock(series), _phase(series), _blank(series)
    ends = clock | phase | blank[1:] | blank[:-1]
    if not ends.any():
        return series, ()
    edges = np.concatenate([[0], np.flatnonzero(ends) + 1, [len(series)]])
    longest = int(np.diff(edges).argmax())
    first, last = int(edges[longest]), int(edges[longest + 1])
    kept = TimeSeries(series.times[first:last], series.data[first:last], series.names)
    told = (
        f"the part from {kept.times[0]:.6g} s to {kept.times[-1]:.6g} s is kept, "
        f"{last - first} of {len(series)} samples, the rest is left out"
    )
    found = []
    if clock.any():
        found.append(_jump(name, series, clock, told))
    if (phase & ~clock).any():
        found.append(_slip(name, series, phase & ~clock, told))
    if blank.any():
        found.append(_hole(name, series, blank, told))
    return kept, tuple(found)


def unwrapped(name: str, series: TimeSeries) -> tuple[TimeSeries, tuple[Finding, ...]]:
    """A run whose phase starts anew at every turn, unwrapped, and that this was done."""
    if "phase" not in series or len(series) < 3 or not np.isfinite(series["phase"]).all():
        return series, ()
    phase = series["phase"]
    odd, whole = _phase(series), np.unwrap(phase)
    data = series.data.copy()
    data[:, series.names.index("phase")] = whole
    mended = TimeSeries(series.times, data, series.names)
    if not odd.any() or np.ptp(phase) > 2.0 * np.pi or _phase(mended).any():
        return series, ()
    at = float(series.times[int(odd.argmax())])
    text = (
        f"the mesh phase of {name} starts anew at every turn, first at {at:.6g} s: it was "
        "unwrapped; events of single teeth and run-out need it counted on, from the same teeth in "
        "all runs"
    )
    return mended, (Finding("phase", name, ("phase",), at, text),)


def _clock(series: TimeSeries) -> Mask:
    steps = np.diff(series.times)
    odd: Mask = np.abs(steps / np.median(steps) - 1.0) > ODD
    return odd


def _phase(series: TimeSeries) -> Mask:
    if "phase" not in series:
        return np.zeros(len(series) - 1, dtype=bool)
    turn = np.diff(series["phase"])
    known = np.isfinite(turn)
    usual = float(np.median(turn[known])) if known.any() else np.nan
    odd: Mask = known & ~(np.abs(turn / usual - 1.0) < ODD)
    return odd


def _blank(series: TimeSeries) -> Mask:
    """Samples (n,) in which most channels that work at all, or the phase, are no number.

    Gauges that see at times, see ``screen``, don't count.
    """
    gated = may_be_gated(series.names)
    on = np.array([name not in HEAD and not (gated and name[0] == "F") for name in series.names])
    missing = ~np.isfinite(series.data)
    works = on & ~missing.all(axis=0)
    blank: Mask = np.zeros(len(series), dtype=bool)
    if works.any():
        blank = missing[:, works].mean(axis=1) > BLANK
    if "phase" in series and np.isfinite(series["phase"]).any():
        blank |= ~np.isfinite(series["phase"])
    return blank


def _jump(name: str, series: TimeSeries, odd: Mask, told: str) -> Finding:
    steps, at = np.diff(series.times), int(odd.argmax())
    often = f", the first of {int(odd.sum())} such steps" if odd.sum() > 1 else ""
    text = (
        f"the clock of {name} jumps by {steps[at]:.6g} s at {series.times[at]:.6g} s{often}, a "
        f"step is {np.median(steps):.6g} s: samples are missing or the clock was set; {told}"
    )
    return Finding("clock", name, ("t",), float(series.times[at]), text)


def _slip(name: str, series: TimeSeries, odd: Mask, told: str) -> Finding:
    turn, at = np.diff(series["phase"]), int(odd.argmax())
    text = (
        f"the mesh phase of {name} goes on by {turn[at]:.6g} rad at {series.times[at]:.6g} s, a "
        f"step is {np.nanmedian(turn):.6g} rad: k(t) and e(t) are not known across it; {told}"
    )
    return Finding("phase", name, ("phase",), float(series.times[at]), text)


def _hole(name: str, series: TimeSeries, blank: Mask, told: str) -> Finding:
    at = float(series.times[int(blank.argmax())])
    text = (
        f"most channels or the phase of {name} are no number in {int(blank.sum())} samples, first "
        f"at {at:.6g} s: a dropout of the recorder; {told}"
    )
    return Finding("dropout", name, (), at, text)
