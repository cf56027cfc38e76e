"""Amplitude spectrum over mesh orders, and its lines at the orders h / n of a period n."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import scipy.fft

from herringbone_sim.analysis.motion import Motion
from herringbone_sim.arrays import Array

BLOCK_CYCLES = 240
LINE_BINS = 2  # half-width of a line with the Hann window


@dataclass(frozen=True)
class Spectrum:
    """One-sided amplitude spectra of the displacements of some meshes.

    Attributes:
        orders: (n,) frequency in units of the mesh frequency.
        amplitudes: (n, k) amplitude of a sine at that order, m; RMS over the blocks.
        meshes: k names such as ``sp_L``.
    """

    orders: Array
    amplitudes: Array
    meshes: tuple[str, ...]


@dataclass(frozen=True)
class Line:
    """Amplitude [m] of the displacement of one mesh at the mesh order ``h / n``."""

    mesh: str
    h: int
    n: int
    amplitude: float

    @property
    def order(self) -> float:
        """Frequency in units of the mesh frequency."""
        return self.h / self.n

    @property
    def label(self) -> str:
        """Order in lowest terms: ``1/3``, ``2``."""
        return str(Fraction(self.h, self.n))


def amplitude_spectrum(motion: Motion, period: int = 1) -> Spectrum:
    """Amplitude spectra of the displacements, Hann window, scaled to the amplitude of a sine.

    Blocks have up to 240 cycles and a multiple of the period, so that the lines h / n fall on
    bins; squares are averaged over the blocks. The mean of each channel is removed.

    Args:
        motion: at least one period long; samples need not be evenly spaced in phase.
        period: in mesh cycles, 0 or 1 if there is none.
    """
    x = _evenly_in_phase(motion)
    repeat = max(period, 1)
    cycles = max(min(BLOCK_CYCLES, int(motion.cycles)) // repeat * repeat, 1)
    size = min(round(cycles * motion.samples_per_cycle), len(x))
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(size) / size)
    blocks = x[: len(x) // size * size].reshape(-1, size, x.shape[1]) - x.mean(axis=0)
    lines = scipy.fft.rfft(blocks * window[:, None], axis=1)
    amplitudes = 2 / window.sum() * np.sqrt(np.mean(np.abs(lines) ** 2, axis=0))
    orders = np.arange(len(amplitudes)) * motion.samples_per_cycle / size
    return Spectrum(orders, amplitudes, motion.meshes)


def _evenly_in_phase(motion: Motion) -> Array:
    """Displacements (n, k), interpolated to even steps of the phase if they are uneven."""
    steps = np.diff(motion.turns)
    if np.ptp(steps) < 1e-3 * steps.mean():
        return motion.x
    grid = np.linspace(motion.turns[0], motion.turns[-1], len(motion))
    return np.stack([np.interp(grid, motion.turns, column) for column in motion.x.T], axis=1)


def lines(spectrum: Spectrum, period: int) -> tuple[Line, ...]:
    """Amplitudes of all meshes at the orders h / n of the spectrum, h = 1 ... 6 n.

    n is the period, or 1 if it is 0; an amplitude is the largest of three bins at its order.
    """
    n = max(period, 1)
    wanted = np.arange(1, 6 * n + 1)
    wanted = wanted[wanted / n <= spectrum.orders[-1]]
    bins = np.rint(wanted / n / spectrum.orders[1]).astype(int)
    return tuple(
        Line(mesh, int(h), n, float(_peak(spectrum.amplitudes[:, column], at)))
        for column, mesh in enumerate(spectrum.meshes)
        for h, at in zip(wanted, bins, strict=True)
    )


def share_off_lines(spectrum: Spectrum, period: int) -> Array:
    """Fraction (k,) of the spectral power, without the mean, off the orders h / n, n the period.

    NaN for a mesh without power.
    """
    power = spectrum.amplitudes**2
    spacing = 1 / max(period, 1) / spectrum.orders[1]
    bins = np.arange(len(power))
    distance = np.abs(bins - np.rint(bins / spacing) * spacing)
    on_line = (distance <= LINE_BINS) & (bins > LINE_BINS)
    off_line = (distance > LINE_BINS) & (bins > LINE_BINS)
    total = power[on_line].sum(axis=0) + power[off_line].sum(axis=0)
    share: Array = np.divide(
        power[off_line].sum(axis=0), total, out=np.full(len(total), np.nan), where=total > 0
    )
    return share


def _peak(amplitudes: Array, at: int) -> float:
    """Largest amplitude in a bin and its two neighbours."""
    return float(amplitudes[max(at - 1, 0) : at + 2].max())
