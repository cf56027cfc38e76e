"""Two channels of one quantity that were exchanged."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.sensors.consistency import channel_arrays, relations
from herringbone_sim.gap.sensors.groups import Group, sensor_names

Array = NDArray[np.float64]

APART = 1.5  # power of the difference over that of its noise from which an exchange can be seen


def find_swap(runs: Sequence[PreparedRun]) -> tuple[Group | None, float]:
    """The pair of channels whose exchange takes most of the inconsistency away, and how much.

    An exchange adds d = y_a - y_b to a and takes it from b. With b = sum of the remainder along
    the pattern of d and A = the sum of its squares, undoing it lowers the sum of squares by
    2 b - A; what noise alone adds to both is taken off, so that channels that move alike, which
    no exchange can be seen on, say nothing. Geometry alone is blind to v of sun and ring mesh of a
    planet exchanged: that is a planet that moves otherwise, and x and u know better.
    """
    names = sensor_names(runs[0].model.layout)
    pairs = [(i, j) for i, j in combinations(range(len(names)), 2) if names[i][:2] == names[j][:2]]
    a, b = np.array(pairs).T
    fall = np.zeros(len(pairs))
    for run in runs:
        fall += _falls(run, a, b)
    best = int(fall.argmax())
    members = np.zeros(len(names), dtype=bool)
    members[[a[best], b[best]]] = True
    swapped = (names[a[best]], names[b[best]])
    group = Group(swapped[0][0], "all", "all", "all", swapped, members)
    return (group, float(fall[best])) if fall[best] > 0.0 else (None, 0.0)


def _falls(run: PreparedRun, a: NDArray[np.int64], b: NDArray[np.int64]) -> Array:
    values, sigma = channel_arrays(run)
    known = np.isfinite(sigma)
    values, variance = np.where(known, values, 0.0), np.where(known, sigma, 0.0) ** 2
    difference = values[:, a] - values[:, b]
    both = len(difference) * (variance[a] + variance[b])
    apart = np.sum(difference**2, axis=0) > APART * both
    falls = np.zeros(len(a))
    for one in relations(run, values[:, :, None]):
        d = one.signals[:, a, 0] - one.signals[:, b, 0]
        own = variance * one.noise
        pattern = one.columns[:, a] - one.columns[:, b]
        noise = np.einsum(
            "dp,dp->p", pattern, one.columns[:, a] * own[a] - one.columns[:, b] * own[b]
        )
        along = np.einsum("tp,tp->p", one.left @ pattern, d) - len(d) * noise
        size = np.sum(pattern**2, axis=0)
        square = size * (np.sum(d**2, axis=0) - len(d) * (own[a] + own[b]))
        falls += 2.0 * along - square
    return np.where(apart & known[a] & known[b], falls, 0.0)
