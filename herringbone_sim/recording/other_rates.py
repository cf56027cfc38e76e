"""Put the readings of sensors with a sampling rate of their own beside the samples of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import listed

# Largest time difference of simultaneous samples, in sample steps: at 16 samples a mesh cycle it
# shifts a channel by 0.4 % of its amplitude, less than the noise of 40 dB.
SAME = 0.01


class OtherSamples(NamedTuple):
    """Samples (n, c) of a topic as ``samples_torque``, with a ``t`` on the clock of the run."""

    topic: str
    names: tuple[str, ...]
    rows: Array


def beside(samples: TimeSeries, others: Sequence[OtherSamples]) -> tuple[TimeSeries, list[str]]:
    """Return samples with channels of other topics that they lack, and sentences on what is lost.

    A reading stands beside the sample of its time; the channel is NaN at the other samples. One
    that lies between samples is left out: nothing is interpolated.
    """
    notes = []
    for topic, names, rows in others:
        taken = [name for name in names if name not in samples.names]
        twice = [name for name in names if name not in taken and name not in ("t", "phase")]
        if twice:
            notes.append(f"{listed(twice)} of {topic} is left out: another topic has it, too")
        reading, at = _coincident(samples.times, rows[:, names.index("t")])
        if len(reading) and taken:
            columns = np.full((len(samples), len(taken)), np.nan)
            columns[at] = rows[reading][:, [names.index(name) for name in taken]]
            data = np.hstack([samples.data, columns])
            samples = TimeSeries(samples.times, data, (*samples.names, *taken))
        if len(reading) < len(rows):
            notes.append(
                f"{len(rows) - len(reading)} of {len(rows)} readings of {topic} are between "
                "samples and left out: 'python -m herringbone_sim campaign import' interpolates"
            )
    return samples, notes


def _coincident(times: Array, others: Array) -> tuple[Indices, Indices]:
    """Return the indices of entries of ``others`` at one of the increasing times, and of these."""
    known = np.flatnonzero(np.isfinite(others))
    if len(times) < 2 or not len(known):
        return known[:0], known[:0]
    at = nearest(others[known], times)
    same = np.abs(times[at] - others[known]) <= SAME * np.median(np.diff(times))
    return known[same], at[same]


def nearest(times: Array, others: Array) -> Indices:
    """Return the index (n,) of the entry of the increasing ``others`` nearest to each time."""
    after = np.clip(np.searchsorted(others, times), 1, len(others) - 1)
    return np.asarray(after - (times - others[after - 1] < others[after] - times))
