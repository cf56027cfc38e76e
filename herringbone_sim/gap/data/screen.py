"""Remove channels that can't be used: with NaN, constant, saturated, or not in SI units.

Each is reported as a finding with its time and left out of its run; nothing is interpolated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.core.layout import HEAD, PREFIX_UNITS
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import shown

AT_LIMIT = 8  # least number of samples at the extreme value of a saturated channel
CROWDED = 4.0  # least ratio of that number to the samples at any neighbouring value
NEAR = 20  # number of neighbouring values compared


@dataclass(frozen=True)
class Finding:
    """A problem of the data of a campaign, or a limit on what they can show.

    Attributes:
        what: id of the kind of problem, such as ``nan``, ``saturated``, ``unit``, ``clock``.
        run: name of the run; empty for the campaign.
        channels: channels concerned; empty for all.
        time_s: time at which the problem begins [s]; None if it has no definite time.
        text: what is wrong, the value got, and how the data are used.
        fatal: whether the run (or, without a run, the campaign) can't be used.
        limit: whether the data are right, but too few to decide something.
    """

    what: str
    run: str
    channels: tuple[str, ...]
    time_s: float | None
    text: str
    fatal: bool = False
    limit: bool = False


def finding_texts(findings: Sequence[Finding]) -> list[str]:
    """Return the texts of findings; a text common to several runs once, with their names."""
    runs: dict[str, list[str]] = {}
    for finding in findings:
        name, colon, statement = finding.text.partition(": ")
        alike = colon and name == finding.run
        runs.setdefault(statement if alike else finding.text, []).extend([name] if alike else [])
    return [f"{', '.join(names)}: {text}" if names else text for text, names in runs.items()]


def screen(
    name: str, series: TimeSeries, units: Mapping[str, str] | None = None
) -> tuple[TimeSeries, tuple[Finding, ...]]:
    """Remove channels that are NaN, constant, saturated or in a wrong unit.

    Args:
        name: of the run.
        series: as recorded.
        units: declared units by channel; None: none are declared.

    Returns:
        Series of the remaining channels, and a finding for each kind of fault.
    """
    findings = []
    gaps = may_have_gaps(series.names)
    for channel in series.names:
        if channel in HEAD:
            continue
        finding = _nan(name, series, channel, gaps) or _constant(name, series, channel)
        finding = finding or _not_si(name, series, channel, (units or {}).get(channel))
        finding = finding or _saturated(name, series, channel)
        if finding is not None:
            findings.append(finding)
    bad = {channel for finding in findings for channel in finding.channels}
    keep = tuple(n for n in series.names if n not in bad)
    clean = TimeSeries(series.times, series.columns(keep), keep) if bad else series
    return clean, tuple(_merge_by_rule(findings))


def may_have_gaps(names: Sequence[str]) -> bool:
    """Whether force channels may be NaN at times: only if no displacement is among the channels.

    Without displacements no force law is used. A gauge at a fixed point of the ring records only
    while a planet passes it.
    """
    return not any(name.startswith("x_") for name in names)


def _merge_by_rule(findings: list[Finding]) -> list[Finding]:
    """Merge findings with the same ``what``: text of the earliest, channels of all."""
    kinds: dict[str, list[Finding]] = {}
    for finding in findings:
        kinds.setdefault(finding.what, []).append(finding)
    merged = []
    for same in kinds.values():
        first = min(same, key=lambda entry: entry.time_s or 0.0)
        others = [channel for entry in same if entry is not first for channel in entry.channels]
        text = f"{first.text}; so it is with {', '.join(others)}" if others else first.text
        merged.append(replace(first, channels=(*first.channels, *others), text=text))
    return merged


def _not_si(name: str, series: TimeSeries, channel: str, unit: str | None) -> Finding | None:
    """Return a finding if the declared unit of a channel is not the SI unit of its quantity."""
    expected = PREFIX_UNITS.get(channel.split("_")[0])
    if unit is None or expected is None or unit == expected:
        return None
    text = (
        f"{channel} of {name} is declared in {shown(unit)}, a recording holds {expected}: another "
        "unit than SI; the channel is left out of this run, not rescaled"
    )
    return Finding("unit", name, (channel,), float(series.times[0]), text)


def _nan(name: str, series: TimeSeries, channel: str, gaps: bool) -> Finding | None:
    """Return a finding if a channel has NaN; for a force with ``gaps``, if it has nothing else."""
    missing = ~np.isfinite(series[channel])
    if not missing.any() or (gaps and channel[0] == "F" and not missing.all()):
        return None
    first, share = float(series.times[int(missing.argmax())]), float(missing.mean())
    rest = "" if channel[0] == "F" else "; its place follows from others where geometry allows"
    text = (
        f"{channel} of {name} is no number in {share:.1%} of the samples, first at {first:.6g} s: "
        f"the channel is left out of this run{rest}"
    )
    return Finding("nan", name, (channel,), first, text)


def _constant(name: str, series: TimeSeries, channel: str) -> Finding | None:
    """Return a finding if a channel has the same value in all samples."""
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
    """Return a finding if the largest or smallest value occurs far more often than its neighbours.

    Noise, quantisation and periodic motion raise the counts of the neighbouring values as well.
    """
    values = series[channel]
    levels, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    for limit, count, neighbours in (
        (levels[-1], counts[-1], counts[-1 - NEAR : -1]),
        (levels[0], counts[0], counts[1 : 1 + NEAR]),
    ):
        if count >= AT_LIMIT and len(neighbours) and count > CROWDED * neighbours.max():
            first = float(series.times[int((values == limit).argmax())])
            text = (
                f"{channel} of {name} is cut at {limit:.6g}: {int(count)} samples stand there, "
                f"first at {first:.6g} s: widen the range of the sensor; the channel is left out "
                "of this run"
            )
            return Finding("saturated", name, (channel,), first, text)
    return None
