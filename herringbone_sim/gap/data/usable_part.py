"""Part of a long recording that the diagnosis uses."""

from __future__ import annotations

import numpy as np

from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.gap.data.screen import Finding

# Limits on the used part of a run, chosen for run time and memory.
MOST_TURNS = 4  # of the carrier: each tooth of the ring meets each planet once a turn
MOST_SAMPLES = 12_000
FEWEST_PER_CYCLE = 16  # samples of a mesh cycle that are left at least


def usable_part(
    name: str, series: TimeSeries, ring_teeth: int
) -> tuple[TimeSeries, tuple[Finding, ...]]:
    """Return the middle of a run that is long, every k-th sample of it, and a finding.

    The middle holds ``MOST_TURNS`` turns of the carrier, and k leaves ``MOST_SAMPLES`` samples at
    most, unless fewer than ``FEWEST_PER_CYCLE`` of a mesh cycle would remain.

    Args:
        name: of the run, for the finding.
        series: samples without breaks.
        ring_teeth: mesh cycles of a turn of the carrier.
    """
    if len(series) < 2:
        return series, ()
    cycles = float(np.ptp(series["phase"])) / (2.0 * np.pi)
    per_cycle = len(series) / cycles
    most = round(MOST_TURNS * ring_teeth * per_cycle)
    first = max(0, len(series) - most) // 2
    part = slice(first, first + most)
    every = min(-(-min(most, len(series)) // MOST_SAMPLES), int(per_cycle / FEWEST_PER_CYCLE))
    if first == 0 and every <= 1:
        return series, ()
    every = max(every, 1)
    data, times = series.data[part][::every], series.times[part][::every]
    text = (
        f"{name} is long, {cycles:.0f} mesh cycles of {per_cycle:.0f} samples: the middle, "
        f"{len(times)} samples from {times[0]:.6g} s to {times[-1]:.6g} s, is used; more runs at "
        "other operating points tell more than longer ones"
    )
    used = TimeSeries(times, data, series.names)
    return used, (Finding("long", name, ("t",), float(times[0]), text),)
