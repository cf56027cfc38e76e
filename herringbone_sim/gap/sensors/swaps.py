"""Detect two swapped channels of one quantity."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.sensors.consistency import channel_arrays, relations
from herringbone_sim.gap.sensors.groups import sensor_names

APART = 1.5  # least mean square of the difference of two channels over that of its noise


def find_swap(runs: Sequence[PreparedRun]) -> tuple[str, str] | None:
    """Return the two channels whose exchange improves consistency most; None if none does.

    The pair is of one quantity: x, v or u. The exchange adds the difference d of the channels to
    one and subtracts it from the other. It lowers the sum of squared residuals by 2 r - s, with r
    the inner product of the residuals and the pattern of d, and s the sum of squares of that
    pattern; the expectation of both by noise is subtracted. Relations of v alone can't show a swap
    of sun and ring mesh of one planet; those between x and v do.
    """
    names = sensor_names(runs[0].model.layout)
    pairs = [(i, j) for i, j in combinations(range(len(names)), 2) if names[i][:2] == names[j][:2]]
    a, b = np.array(pairs).T
    fall = np.zeros(len(pairs))
    for run in runs:
        fall += _falls(run, a, b)
    best = int(fall.argmax())
    return (names[a[best]], names[b[best]]) if fall[best] > 0.0 else None


def _falls(run: PreparedRun, a: Indices, b: Indices) -> Array:
    """Return the decrease (p,) of the sum of squared residuals by exchange of a[p] and b[p]."""
    values, sigma = channel_arrays(run)
    known = np.isfinite(sigma)
    values, variance = np.where(known, values, 0.0), np.where(known, sigma, 0.0) ** 2
    difference = values[:, a] - values[:, b]
    both = len(difference) * (variance[a] + variance[b])
    apart = np.sum(difference**2, axis=0) > APART * both
    falls = np.zeros(len(a))
    for relation in relations(run, values[:, :, None]):
        d = relation.signals[:, a, 0] - relation.signals[:, b, 0]
        scaled_variance = variance * relation.noise
        pattern = relation.columns[:, a] - relation.columns[:, b]
        noise = np.einsum(
            "dp,dp->p",
            pattern,
            relation.columns[:, a] * scaled_variance[a]
            - relation.columns[:, b] * scaled_variance[b],
        )
        along = np.einsum("tp,tp->p", relation.residual @ pattern, d) - len(d) * noise
        size = np.sum(pattern**2, axis=0)
        square = size * (np.sum(d**2, axis=0) - len(d) * (scaled_variance[a] + scaled_variance[b]))
        falls += 2.0 * along - square
    return np.where(apart & known[a] & known[b], falls, 0.0)
