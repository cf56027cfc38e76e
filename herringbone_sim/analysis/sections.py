"""Stroboscopic section: the state at every passage of the mesh phase through 0, modulo 2 pi."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.analysis.motion import Motion
from herringbone_sim.arrays import Array, Indices

SNAP = 1e-6  # cycles: a sample this close to the phase is the section point


@dataclass(frozen=True)
class Section:
    """States at mesh phase 0, one per cycle.

    Attributes:
        cycles: (m,) number of the cycle, counted by the phase channel.
        times: (m,) seconds.
        x: (m, k) relative displacements, m.
        v: (m, k) relative velocities, m/s.
        meshes: k names such as ``sp_L``.
    """

    cycles: Indices
    times: Array
    x: Array
    v: Array
    meshes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.cycles)

    def after(self, dropped: int) -> Section:
        """The section without its first ``dropped`` points."""
        return Section(
            self.cycles[dropped:],
            self.times[dropped:],
            self.x[dropped:],
            self.v[dropped:],
            self.meshes,
        )


def stroboscopic_section(motion: Motion) -> Section:
    """Interpolate the state (x, v) at every passage of phase 0, modulo 2 pi.

    A sample within 1e-6 cycles of it is used as it is. Between two samples x is the cubic
    Hermite polynomial with the slopes v, and v the cubic with its central differences as slopes.
    The motion may begin at any phase. A single sample gives an empty section.
    """
    if len(motion) < 2:
        none = np.zeros(0, dtype=np.int64)
        return Section(none, motion.times[:0], motion.x[:0], motion.v[:0], motion.meshes)
    turns = motion.turns
    cycles = np.arange(np.ceil(turns[0] - SNAP), np.floor(turns[-1] + SNAP) + 1).astype(np.int64)
    right = np.clip(np.searchsorted(turns, cycles), 1, len(turns) - 1)
    left = right - 1
    share = _shares(turns, cycles, left, right)
    times, step = motion.times[left], np.diff(motion.times)[left]
    slopes = [_central_differences(motion, rows) for rows in (left, right)]
    return Section(
        cycles,
        times + share * step,
        cubic(motion.x[left], motion.x[right], motion.v[left], motion.v[right], share, step),
        cubic(motion.v[left], motion.v[right], slopes[0], slopes[1], share, step),
        motion.meshes,
    )


def section_noise(motion: Motion, noise: tuple[Array, Array]) -> Array:
    """RMS noise (2 k,) of section points, x [m] then v [m/s], from that of the samples.

    Interpolation averages neighbours, which removes up to a third of the noise. The noise of the
    first section point is returned for all.

    Args:
        motion: whose times and phases are used.
        noise: RMS of the samples, (k,) for x [m] and (k,) for v [m/s].
    """
    if len(motion) < 2:
        return np.concatenate(noise)
    turns = motion.turns
    start = np.ceil(turns[0] - SNAP)
    right = int(np.clip(np.searchsorted(turns, start), 1, len(turns) - 1))
    u = float(np.clip((start - turns[right - 1]) / (turns[right] - turns[right - 1]), 0, 1))
    h = float(motion.times[right] - motion.times[right - 1])
    ends = np.array([(1 + 2 * u) * (1 - u) ** 2, u**2 * (3 - 2 * u)])
    slopes = np.array([u * (1 - u) ** 2, -(u**2) * (1 - u)])
    x = np.sqrt(np.sum(ends**2) * noise[0] ** 2 + h**2 * np.sum(slopes**2) * noise[1] ** 2)
    weights = (
        np.append(ends, [0, 0]) + np.array([-slopes[1], slopes[0], -slopes[0], slopes[1]]) / 2
    )
    return np.concatenate((x, np.sqrt(np.sum(weights**2)) * noise[1]))


def _shares(
    turns: Array, cycles: Indices, left: NDArray[np.intp], right: NDArray[np.intp]
) -> Array:
    """Position (m,) of each passage between its neighbouring samples, 0 = left, 1 = right.

    Positions within ``SNAP`` cycles of a sample are set to 0 or 1.

    Args:
        turns: (n,) phase of the samples in cycles.
        cycles: (m,) whole numbers at which the passages lie.
        left, right: (m,) indices of the samples around each passage.
    """
    share: Array = (cycles - turns[left]) / (turns[right] - turns[left])
    share = np.where(np.abs(turns[left] - cycles) < SNAP, 0.0, share)
    return np.where(np.abs(turns[right] - cycles) < SNAP, 1.0, share)


def _central_differences(motion: Motion, rows: NDArray[np.intp]) -> Array:
    """Accelerations (m, k) at some rows, from central differences of the velocities."""
    before, behind = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(motion) - 1)
    span = (motion.times[behind] - motion.times[before])[:, None]
    slopes: Array = (motion.v[behind] - motion.v[before]) / span
    return slopes


def cubic(
    left: Array, right: Array, slope_left: Array, slope_right: Array, share: Array, step: Array
) -> Array:
    """Cubic Hermite interpolation of values (m, k) at ``share`` (m,) of steps (m,)."""
    u, h = share[:, None], step[:, None]
    values: Array = (
        (1 + 2 * u) * (1 - u) ** 2 * left
        + u**2 * (3 - 2 * u) * right
        + h * u * (1 - u) * ((1 - u) * slope_left - u * slope_right)
    )
    return values
