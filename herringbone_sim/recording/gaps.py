"""Find and count missing samples by the phase, which advances in equal steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from herringbone_sim.arrays import Array

# Largest count that a double holds exactly.
MOST_MISSING = 2.0**53
WIDE = 1.5  # of the usual step: between one step and two, so that a single missing sample is seen
WINDOW = 9  # steps about one; more than twice MOST_WIDE, so that their median is no wide step
MOST_WIDE = 3  # wide steps in a window; with more of them the step varies


@dataclass(frozen=True)
class Gap:
    """Consecutive missing samples.

    Attributes:
        index: index of the first sample after the gap.
        t_s: time of the last sample before it [s].
        missing: number of missing samples.
    """

    index: int
    t_s: float
    missing: int


def find_gaps(times: Array, counter: Array) -> tuple[Gap, ...]:
    """Find gaps: steps of ``counter`` above ``WIDE`` times the usual step.

    The usual step is the longer one of both neighbours. Beside another wide step it is the median
    of ``WINDOW`` steps if that is shorter and few of them are wide, so that gaps with single
    samples between them are found too. A lasting change of the step (other samples per cycle,
    other speed) is not a gap.

    Args:
        times: (n,) times [s].
        counter: (n,) the phase [rad], or any quantity that advances in equal steps.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.diff(counter)
        if len(steps) < 2:
            return ()
        before, after = np.r_[steps[1], steps[:-1]], np.r_[steps[1:], steps[-2]]
        finite = np.isfinite(steps)
        median = np.full(len(steps), np.nan)
        median[finite] = median_filter(steps[finite], WINDOW, mode="reflect")
        above = steps > WIDE * median
        share = uniform_filter1d(above.astype(float), WINDOW, mode="reflect")
        few = share < (MOST_WIDE + 0.5) / WINDOW
        beside = np.r_[False, above[:-1]] | np.r_[above[1:], False]
        usual = np.maximum(before, after)
        usual = np.where(above & beside & few, np.fmin(usual, median), usual)
        wide = np.flatnonzero((usual > 0) & finite & (steps > WIDE * usual))
        ratios = np.minimum(steps[wide] / usual[wide], MOST_MISSING)
    return tuple(
        Gap(int(i) + 1, float(times[i]), round(float(ratio)) - 1)
        for i, ratio in zip(wide, ratios, strict=True)
    )


def sample_gaps(names: tuple[str, ...], rows: Array) -> tuple[Gap, ...]:
    """Find gaps in samples (n, c) by the channel ``phase``, or by ``t`` if there is no phase."""
    counter = "phase" if "phase" in names else "t"
    return find_gaps(rows[:, names.index("t")], rows[:, names.index(counter)])


def gap_notes(names: tuple[str, ...], rows: Array) -> list[str]:
    """Return one sentence on missing samples in (n, c); an empty list if none are missing."""
    gaps = sample_gaps(names, rows)
    if not gaps:
        return []
    return [
        f"{sum(gap.missing for gap in gaps)} samples are missing in {len(gaps)} gaps, the first "
        f"after t = {gaps[0].t_s:.9g} s (sample {gaps[0].index})"
    ]
