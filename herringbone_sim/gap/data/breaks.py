"""Breaks of a recording: clock jumps, phase jumps and dropouts.

Derivatives and integrals over time are invalid across a break, so a run is cut there and only its
longest part is used. Nothing is interpolated and no time stamp is changed.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.core.layout import HEAD
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.gap.data.screen import Finding, may_have_gaps

STEP_TOLERANCE = 0.5  # relative deviation of a step of time or phase from the median step
COUNT_SHARE = 0.01  # of the steps of phase, from which a size of step is an encoder's; chosen
DROPOUT_SHARE = 0.5  # fraction of NaN channels above which a sample counts as a dropout


def longest_part(name: str, series: TimeSeries) -> tuple[TimeSeries, tuple[Finding, ...]]:
    """Return the longest part of a run without a break, and a finding for each kind of break.

    Args:
        name: of the run, for the findings.
        series: samples of the run.
    """
    if len(series) < 3:
        return series, ()
    clock = _odd(np.diff(series.times))
    turns = np.diff(series["phase"]) if "phase" in series else np.full(len(clock), np.nan)
    phase = _odd(turns, _count(turns))
    dropout = _dropouts(series)
    breaks = clock | phase | dropout[1:] | dropout[:-1]
    if not breaks.any():
        return series, ()
    edges = np.concatenate([[0], np.flatnonzero(breaks) + 1, [len(series)]])
    longest = int(np.diff(edges).argmax())
    first, last = int(edges[longest]), int(edges[longest + 1])
    part = TimeSeries(series.times[first:last], series.data[first:last], series.names)
    remedy = (
        f"the part from {part.times[0]:.6g} s to {part.times[-1]:.6g} s is kept, "
        f"{last - first} of {len(series)} samples, the rest is left out"
    )
    findings = []
    if clock.any():
        findings.append(_clock_jump(name, series, clock, remedy))
    if (phase & ~clock).any():
        findings.append(_phase_jump(name, series, phase & ~clock, remedy))
    if dropout.any():
        findings.append(_dropout_finding(name, series, dropout, remedy))
    return part, tuple(findings)


def unwrap_phase(name: str, series: TimeSeries) -> tuple[TimeSeries, tuple[Finding, ...]]:
    """Unwrap a mesh phase that was recorded modulo 2 pi, and report it as a finding.

    A phase in which unwrapping leaves more than half of the odd steps is returned unchanged,
    without a finding.
    """
    if "phase" not in series or len(series) < 3:
        return series, ()
    phase, unwrapped = series["phase"], series["phase"].copy()
    known = np.isfinite(phase)
    unwrapped[known] = np.unwrap(phase[known])
    count = _count(np.diff(unwrapped))
    odd, left = _odd(np.diff(phase), count), _odd(np.diff(unwrapped), count)
    if not odd.any() or np.ptp(phase[known]) > 2.0 * np.pi or 2 * left.sum() > odd.sum():
        return series, ()
    data = series.data.copy()
    data[:, series.names.index("phase")] = unwrapped
    at = float(series.times[int(odd.argmax())])
    text = (
        f"the mesh phase of {name} starts anew at every turn, first at {at:.6g} s: it was "
        "unwrapped; events of single teeth and run-out need it counted on, from the same teeth in "
        "all runs"
    )
    finding = Finding("phase", name, ("phase",), at, text)
    return TimeSeries(series.times, data, series.names), (finding,)


def _count(turns: Array) -> float:
    """Return the count of an encoder by which steps of the phase (n,) differ; 0: none is seen."""
    levels, times = np.unique(np.round(turns[np.isfinite(turns)], 9), return_counts=True)
    levels = levels[(times > COUNT_SHARE * len(turns)) & (levels >= 0.0)]
    return 1.001 * float(np.diff(levels).min()) if len(levels) > 1 else 0.0


def _odd(steps: Array, count: float = 0.0) -> Flags:
    """Flag steps (n,) that differ from their median by ``STEP_TOLERANCE`` and more than a count.

    NaN is not flagged.
    """
    known = np.isfinite(steps)
    usual = float(np.median(steps[known])) if known.any() else np.nan
    return np.asarray(known & ~(np.abs(steps - usual) <= STEP_TOLERANCE * abs(usual) + count))


def _dropouts(series: TimeSeries) -> Flags:
    """Flag samples (n,) in which most channels, or the phase, are NaN.

    Channels without two readings in a row (none at all, or those of a slower sensor), and force
    gauges that may have gaps (``may_have_gaps``), don't count.
    """
    gaps = may_have_gaps(series.names)
    counted = np.array(
        [name not in HEAD and not (gaps and name[0] == "F") for name in series.names]
    )
    missing = ~np.isfinite(series.data)
    counted &= (~missing[1:] & ~missing[:-1]).any(axis=0)
    dropout: Flags = np.zeros(len(series), dtype=bool)
    if counted.any():
        dropout = missing[:, counted].mean(axis=1) > DROPOUT_SHARE
    if "phase" in series and np.isfinite(series["phase"]).any():
        dropout |= ~np.isfinite(series["phase"])
    return dropout


def _clock_jump(name: str, series: TimeSeries, odd: Flags, remedy: str) -> Finding:
    """Return a finding on the irregular time steps ``odd`` (n - 1,); ``remedy`` ends its text."""
    steps, at = np.diff(series.times), int(odd.argmax())
    often = f", the first of {int(odd.sum())} such steps" if odd.sum() > 1 else ""
    text = (
        f"the clock of {name} jumps by {steps[at]:.6g} s at {series.times[at]:.6g} s{often}, a "
        f"step is {np.median(steps):.6g} s: samples are missing or the clock was set; {remedy}"
    )
    return Finding("clock", name, ("t",), float(series.times[at]), text)


def _phase_jump(name: str, series: TimeSeries, odd: Flags, remedy: str) -> Finding:
    """Return a finding on irregular phase steps ``odd`` (n - 1,); ``remedy`` ends its text."""
    turn, at = np.diff(series["phase"]), int(odd.argmax())
    text = (
        f"the mesh phase of {name} goes on by {turn[at]:.6g} rad at {series.times[at]:.6g} s, a "
        f"step is {np.nanmedian(turn):.6g} rad: k(t) and e(t) are not known across it; {remedy}"
    )
    return Finding("phase", name, ("phase",), float(series.times[at]), text)


def _dropout_finding(name: str, series: TimeSeries, dropout: Flags, remedy: str) -> Finding:
    """Return a finding on the samples ``dropout`` (n,); ``remedy`` ends its text."""
    at = float(series.times[int(dropout.argmax())])
    text = (
        f"most channels or the phase of {name} are no number in {int(dropout.sum())} samples, "
        f"first at {at:.6g} s: a dropout of the recorder; {remedy}"
    )
    return Finding("dropout", name, (), at, text)
