"""Current motion of a live simulation: period, largest exponent, contact, block by block."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from herringbone_sim.analysis.periods import find_period
from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.integrate import Block
from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.core.sensitivity import has_tangents

WINDOW = 96  # latest section points, in which a period is looked for
LEAST = 48  # section points needed for a label
EXPONENT_WINDOW = 400  # mesh cycles
TOLERANCE = 1e-4  # of find_period; samples of a simulation have no noise


@dataclass(frozen=True)
class Regime:
    """Motion over the last mesh cycles.

    Attributes:
        label: ``P1``, ``P2``, ...; without a period ``chaotic`` by a positive exponent, else
            ``aperiodic``; ``settling`` before 48 cycles, and without a period before 400.
        exponent: largest Lyapunov exponent per tau over the last 400 cycles; NaN at first.
        contact: (n_mesh, 3) fraction of the time in back contact, separated, in drive contact.
        cycles: mesh cycles since the last restart.
    """

    label: str
    exponent: float
    contact: Array
    cycles: int


class RegimeMonitor:
    """Classifies the motion of a live simulation; restart it when a parameter changes."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Discard all data."""
        self._points: deque[Array] = deque(maxlen=WINDOW)
        self._growth: deque[tuple[int, float]] = deque()
        self._contact: deque[Indices] = deque(maxlen=16)
        self._cycles = 0

    def update(self, block: Block, model: Model) -> None:
        """Add a block of samples with a tangent vector, computed with the given model."""
        n, s = model.layout.n_mesh, model.scales
        points = block.rows[block.section, 5 : 5 + 2 * n]
        unit = np.repeat([s.b_c, s.velocity_m_per_s], n)
        self._points.extend(points[-WINDOW:] / unit)
        self._contact.append(block.contact)
        self._cycles += len(block.section)
        self._growth.append((block.end.cycle, float(block.end.growth[0])))
        while len(self._growth) > 2 and block.end.cycle - self._growth[1][0] >= EXPONENT_WINDOW:
            self._growth.popleft()

    def regime(self, model: Model) -> Regime:
        """Classify the motion since the last restart, for the current model."""
        exponent = self._exponent(model)
        return Regime(self._label(exponent), exponent, self._shares(), self._cycles)

    def _exponent(self, model: Model) -> float:
        """Mean growth per tau of the tangent vector over the last EXPONENT_WINDOW cycles.

        NaN without one, as by Runge-Kutta 4.
        """
        if not has_tangents(model):
            return float("nan")
        if len(self._growth) < 2 or self._growth[-1][0] == self._growth[0][0]:
            return float("nan")
        (from_cycle, start), (to_cycle, end) = self._growth[0], self._growth[-1]
        return (end - start) * model.packed.Omega / (TWO_PI * (to_cycle - from_cycle))

    def _label(self, exponent: float) -> str:
        """Label of the motion, see ``Regime``."""
        if len(self._points) < LEAST:
            return "settling"
        period = find_period(np.array(self._points), tolerance=TOLERANCE)
        if period.value:
            return period.label
        if self._cycles < EXPONENT_WINDOW:
            return "settling"
        return "chaotic" if exponent > 0.0 else "aperiodic"

    def _shares(self) -> Array:
        """(n_mesh, 3) fraction of samples in each contact over the last 16 blocks."""
        counts = np.sum(np.array(self._contact), axis=0) if self._contact else np.zeros((1, 3))
        shares: Array = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        return shares
