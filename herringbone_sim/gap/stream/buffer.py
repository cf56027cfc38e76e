"""Buffer of the newest unbroken stretch of a stream of samples."""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy.ndimage import median_filter

from herringbone_sim.arrays import Array
from herringbone_sim.core.timeseries import TimeSeries, check_unique
from herringbone_sim.errors import RecordingError, listed
from herringbone_sim.gap.data.breaks import unwrap_phase
from herringbone_sim.recording.messages import MOST_S

MOST, LEAST = 2048, 64  # samples of a stretch
SMOOTH = 64  # samples over which a measured operating point is smoothed; chosen
POINT_DRIFT = {"delta_T": 1.0, "K": 0.01, "T_1": 0.01}  # drift in a stretch: [K], -, relative
SPEED_TOLERANCE = 0.05  # relative drift of the mesh frequency in a stretch


class SampleBuffer:
    """Collects blocks of samples and returns the newest stretch: the samples after the last break.

    A break is a lost block, a clock that goes back, other channels, or a change of the operating
    point.

    Args:
        most, least: largest and smallest number of samples of a stretch.

    Attributes:
        names: channels of the newest block.
        received: number of samples received.
        lost: number of missing samples, by gaps in the time.
        restarts: how often the clock went back or the channels changed.
        t_s: time of the newest sample [s], NaN before the first.
    """

    def __init__(self, most: int = MOST, least: int = LEAST) -> None:
        self.most, self.least = most, least
        self.names: tuple[str, ...] = ()
        self.received = self.lost = self.restarts = 0
        self.t_s = float("nan")
        self._blocks: deque[Array] = deque()
        self._step = float("nan")

    def put(self, names: tuple[str, ...], rows: Array) -> None:
        """Add a block of samples; samples before a break are discarded.

        Args:
            names: names of the c channels.
            rows: (n, c) samples [SI].

        Raises:
            RecordingError: no channel ``t``, or a time that is not finite.
            AnalysisError: a channel twice.
        """
        if "t" not in names:
            raise RecordingError(f"a block of samples needs a channel t, got {listed(names)}")
        check_unique(names)
        if not len(rows):
            return
        times = rows[:, names.index("t")]
        if not (np.abs(times) < MOST_S).all():
            raise RecordingError(
                "a block holds a time t that is no number of seconds below 2^31: check the rig's "
                "clock"
            )
        self.received += len(rows)
        if names != self.names:
            self.restarts += bool(self.names)
            self.names, self.t_s = names, float("nan")
            self._blocks.clear()
        first = self._after_breaks(times)
        self._blocks.append(rows[first:])
        self.t_s = float(times[-1])
        while sum(map(len, self._blocks)) - len(self._blocks[0]) >= self.most:
            self._blocks.popleft()

    def take(self) -> TimeSeries | None:
        """Return and remove the newest stretch; None while it has fewer than ``least`` samples."""
        if not self._blocks:
            return None
        rows = np.vstack(self._blocks)[-self.most :]
        times = rows[:, self.names.index("t")]
        rows = unwrap_phase("the rig", TimeSeries(times, rows, self.names))[0].data
        first = _last_change(self.names, rows)
        if len(rows) - first < self.least:
            return None
        self._blocks.clear()
        return TimeSeries(times[first:].copy(), rows[first:], self.names)

    def _after_breaks(self, times: Array) -> int:
        """Return the index of the first sample after the last gap or step back in the times (n,).

        Updates counts and sample period; discards the earlier blocks if there is such a break.
        """
        steps = np.diff(times, prepend=self.t_s)
        forward = steps[steps > 0.0]
        if len(forward) >= 3:
            self._step = float(np.median(forward))
        back = steps <= 0.0
        late = steps > 1.5 * self._step
        self.restarts += int(back.sum())
        self.lost += int(np.sum(np.round(steps[late] / self._step) - 1.0))
        broken = np.flatnonzero(back | late)
        if not len(broken):
            return 0
        self._blocks.clear()
        return int(broken[-1])


def _last_change(names: tuple[str, ...], rows: Array) -> int:
    """Return the index from which on all rows (n, c) have the last row's operating point.

    It may be measured: medians of ``SMOOTH`` readings are compared, and mean speeds over as many
    steps. A change of speed in the last ``SMOOTH / 2`` samples is not seen yet.
    """
    other = np.zeros(len(rows), dtype=bool)
    for name, tolerance in POINT_DRIFT.items():
        values = rows[:, names.index(name)] if name in names else np.empty(0)
        known = np.flatnonzero(np.isfinite(values))
        if len(known) < 2:
            continue
        level = median_filter(values[known], min(SMOOTH, len(known)), mode="reflect")
        noise = float(np.median(np.abs(np.diff(values[known]))))
        limit = tolerance * abs(level[-1]) if name == "T_1" else tolerance
        other[known] |= np.abs(level - level[-1]) > limit + noise
    if "phase" in names and len(rows) > 16:
        k = min(SMOOTH, len(rows) // 2)
        phase, t = rows[:, names.index("phase")], rows[:, names.index("t")]
        speed = (phase[k:] - phase[:-k]) / (t[k:] - t[:-k])
        changed = np.abs(speed - speed[-1]) > SPEED_TOLERANCE * abs(speed[-1])
        other[k // 2 : k // 2 + len(speed)] |= changed
    return int(np.flatnonzero(other)[-1]) + 1 if other.any() else 0
