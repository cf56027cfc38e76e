"""Time series of channels: the form in which samples leave the model or a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.errors import AnalysisError, listed, shown


def held(values: Array) -> Array:
    """Return values (n,) in whose gaps the last one before holds, or the first one after.

    Unchanged without gaps, and if no value is finite.
    """
    known = np.flatnonzero(np.isfinite(values))
    if len(known) in (0, len(values)):
        return values
    last = np.searchsorted(known, np.arange(len(values)), side="right") - 1
    return np.asarray(values[known[np.maximum(last, 0)]])


@dataclass(frozen=True)
class TimeSeries:
    """Samples of named channels over time.

    Attributes:
        times: (n,) seconds, strictly increasing.
        data: (n, n_channels) one row a sample, SI units.
        names: n_channels names, as in ``core.layout``.

    Raises:
        AnalysisError: shapes disagree, a name is repeated, or time does not increase.
    """

    times: Array
    data: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        if self.data.shape != (len(self.times), len(self.names)):
            raise AnalysisError(
                f"data must be (n, n_channels) = ({len(self.times)}, {len(self.names)}), "
                f"got {self.data.shape}: hand in one row a sample and one name a column"
            )
        check_unique(self.names)
        steps = np.diff(self.times)
        if steps.size and not np.all(steps > 0):
            at = int(np.argmax(~(steps > 0)))
            raise AnalysisError(
                f"times must increase strictly, got {self.times[at]!r} s then "
                f"{self.times[at + 1]!r} s at sample {at + 1}: cut the series there"
            )

    def __len__(self) -> int:
        return len(self.times)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, name: str) -> Array:
        """Samples (n,) of one channel; KeyError lists the existing channels."""
        try:
            return self.data[:, self.names.index(name)]
        except ValueError:
            raise KeyError(f"no channel {shown(name)}; there are {listed(self.names)}") from None

    def rows(self, start: int, stop: int) -> TimeSeries:
        """Return samples ``start`` (included) to ``stop`` (excluded), as views."""
        return TimeSeries(self.times[start:stop], self.data[start:stop], self.names)

    def columns(self, names: tuple[str, ...]) -> Array:
        """Return the samples (n, len(names)) of some channels, a copy; KeyError: unknown name."""
        return np.stack([self[name] for name in names], axis=1)


def check_unique(names: Sequence[str]) -> None:
    """Raise AnalysisError if a channel name stands twice."""
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise AnalysisError(f"channel names must be unique, got twice: {listed(twice)}")
