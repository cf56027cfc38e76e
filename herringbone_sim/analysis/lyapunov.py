"""Largest Lyapunov exponent from data: growth of a tangent vector under locally fitted maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from herringbone_sim.analysis.periods import find_period
from herringbone_sim.arrays import Array

# Steps of the orbit used, at most and at least; first steps ignored while the vector aligns.
MAX_STEPS = 6000
MIN_STEPS = 80
SKIP = 20
CUT = 1e-3  # smallest singular value used, as a fraction of the largest
NOISE_CUT = 3.0  # smallest singular value used, as a multiple of the noise
REACH = 10.0  # smallest spread of the neighbours, as a multiple of the noise
MAX_NOISY = 3000  # candidates for neighbours when there is noise
LARGEST_REACH = 0.3  # above it the fits are not local, see Exponent.reach
BLOCKS = 30  # of the bootstrap
RESAMPLES = 400
LONGEST = 64  # longest period in cycles that is looked for before maps are fitted


@dataclass(frozen=True)
class Exponent:
    """Largest Lyapunov exponent estimated from data.

    Attributes:
        value: per step of the points (per mesh cycle for a section); NaN with a ``reason``.
        low, high: 90 % interval from a block bootstrap along the orbit. It covers the scatter
            along the orbit but not the bias of the local fits, which is towards low values: some
            per cent for a few hundred clean points, tens of per cent at a noise of 1 %.
        reach: median distance of the farthest neighbour of a fit, divided by the RMS distance of
            two points of the orbit; the fits are local if it is much smaller than 1.
        reason: why there is no value, in words.
    """

    value: float
    low: float
    high: float
    reach: float = float("nan")
    reason: str = ""


def no_exponent(reason: str) -> Exponent:
    """Missing exponent (NaN) with its reason."""
    return Exponent(float("nan"), float("nan"), float("nan"), reason=reason)


def largest_exponent(points: Array, rng: np.random.Generator, noise: float = 0.0) -> Exponent:
    """Estimate the largest Lyapunov exponent: growth of a tangent vector under fitted linear maps.

    After Sano and Sawada (1985) and Eckmann et al. (1986): the Jacobian at a point is estimated as
    the linear map from the differences to its nearest neighbours to the same differences one step
    later. Unlike the divergence of neighbour pairs, the tangent vector has the whole orbit to
    align with the fastest direction. Growth in directions in which the data have no extent
    (left-right antisymmetric perturbations of a symmetric motion, say) can't be seen.

    Args:
        points: (m, k) successive states, coordinates in comparable units.
        rng: draws the bootstrap resamples of the interval.
        noise: RMS of the measurement noise per coordinate, in the units of ``points``.

    Returns:
        The exponent per step; NaN with the reason if the points do not suffice or are periodic.
    """
    if len(points) < MIN_STEPS + SKIP:
        return no_exponent(f"{len(points)} cycles are too few, {MIN_STEPS + SKIP} are needed")
    plane = _extended_directions(points, noise)
    if not plane.shape[1]:
        return no_exponent("the points do not spread beyond noise and rounding")
    period = find_period(points, noise, LONGEST).value
    if period:
        return no_exponent(f"repeats every {period} cycles: neighbours differ by rounding")
    fitted = _local_maps(plane, noise)
    if fitted is None:
        return no_exponent("near neighbours can't be told from noise: record longer")
    maps, reach = fitted
    if reach > LARGEST_REACH:
        return no_exponent(
            f"too few points for this motion: neighbours lie {reach:.0%} of its size apart, "
            f"{LARGEST_REACH:.0%} is the most that tells: record longer"
        )
    growth = _growth(plane, maps)[SKIP:]
    if not np.isfinite(growth).all():
        return no_exponent("neighbours fall onto each other: the motion repeats exactly")
    return _with_interval(growth, reach, rng)


def _extended_directions(points: Array, noise: float) -> Array:
    """Coordinates (m, d) along principal directions whose spread exceeds rounding and noise."""
    centred = points - points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(centred[:MAX_STEPS], full_matrices=False)
    spread = sizes / np.sqrt(min(len(points), MAX_STEPS))
    floor = max(1e-5 * spread[0], 1e-9, NOISE_CUT * noise)
    plane: Array = centred @ axes[spread > floor].T
    return plane


def _local_maps(points: Array, noise: float) -> tuple[Array, float] | None:
    """Fit linear maps (n, d, d) from neighbours to their images one step later; also the reach.

    Each fit uses 2 d neighbours; with noise as many as needed for their spread to exceed the noise
    tenfold. None if there are too few points for that. See ``Exponent.reach``.
    """
    n, d = min(len(points) - 1, MAX_STEPS), points.shape[1]
    stride = 1 if noise == 0 else -(-(len(points) - 1) // MAX_NOISY)
    tree = cKDTree(points[:-1:stride])
    for count in (2 * d,) if noise == 0 else tuple(6 * d * 2**i for i in range(6)):
        if count > max(tree.n // 4, 2 * d):
            return None
        distances, indices = tree.query(points[:n], k=count + 1)
        near = indices[:, 1:] * stride
        left, sizes, right = np.linalg.svd(points[near] - points[:n, None], full_matrices=False)
        if np.median(sizes[:, 0]) >= REACH * noise * np.sqrt(count):
            break
    else:
        return None
    floor = np.maximum(CUT * sizes[:, :1], NOISE_CUT * noise * np.sqrt(count))
    floor = np.minimum(floor, sizes[:, :1])  # keep at least the widest direction
    inverse = np.where(sizes >= floor, 1 / np.maximum(sizes, 1e-300), 0.0)
    behind = points[near + 1] - points[1 : n + 1, None]
    maps: Array = (right.transpose(0, 2, 1) * inverse[:, None]) @ left.transpose(0, 2, 1) @ behind
    pair = np.sqrt(2 * np.sum(np.var(points, axis=0)))
    return maps, float(np.median(distances[:, -1]) / pair)


def _growth(points: Array, maps: Array) -> Array:
    """Log growth (n,) of one tangent vector under maps (n, d, d); NaN if it vanishes."""
    vector = np.ones(points.shape[1])
    growth = np.empty(len(maps))
    for step, matrix in enumerate(maps):
        vector = vector @ matrix
        size = float(np.sqrt(vector @ vector))
        if not size > 0:
            return np.full(SKIP + 1, np.nan)
        growth[step] = np.log(size)
        vector /= size
    return growth


def _with_interval(growth: Array, reach: float, rng: np.random.Generator) -> Exponent:
    """Exponent per step, the mean of the log growth, with its 90 % interval by a block bootstrap.

    Args:
        growth: (n,) natural logarithm of the growth of the tangent vector from each point to the
            next; n >= ``BLOCKS``.
        reach: of the local fits, see ``Exponent.reach``.
        rng: draws the resamples.
    """
    # Blocks, because successive growth values are correlated.
    edges = np.linspace(0, len(growth), BLOCKS + 1).astype(int)
    sums, lengths = np.add.reduceat(growth, edges[:-1]), np.diff(edges)
    draws = rng.integers(0, BLOCKS, (RESAMPLES, BLOCKS))
    resampled = sums[draws].sum(axis=1) / lengths[draws].sum(axis=1)
    low, high = np.quantile(resampled, [0.05, 0.95])
    return Exponent(float(growth.mean()), float(low), float(high), reach)
