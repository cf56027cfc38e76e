"""States fitted to the windows of a run so far: the starts of later fits.

A fit is told by its key: names of the functions with an amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from herringbone_sim.arrays import Indices
from herringbone_sim.gap.observations.shooting import FittedStates
from herringbone_sim.gap.observations.window_restarts import Group

Key = tuple[str, ...]


@dataclass
class FitsOfKey:
    """Fits of one key.

    Attributes:
        best: states of least chi2; None before the first fit that converged.
        last_chi2: chi2 of the last fit.
        restart_chi2: chi2 when states were restarted last; None before.
        restarted_at_rest: whether they were restarted when chi2 changed no more.
        tried_chi2: chi2 of ``StateMemory.least`` when it was the start of a fit last.
        anew: other states from which the next fit starts, too.
    """

    best: FittedStates | None = None
    last_chi2: float = np.inf
    restart_chi2: float | None = None
    restarted_at_rest: bool = False
    tried_chi2: float | None = None
    anew: FittedStates | None = None

    @property
    def chi2(self) -> float:
        """Least chi2, inf before the first fit."""
        return np.inf if self.best is None else self.best.cost

    def keep(self, fitted: FittedStates) -> None:
        """Keep the states of a fit if their chi2 is the least."""
        if fitted.cost <= self.chi2:
            self.best = fitted


@dataclass
class StateMemory:
    """Fitted states of a run.

    Attributes:
        of_key: fits, by key.
        least: states of least chi2 under any change without sensor errors; None before.
        failures: windows whose restart gained nothing, with chi2.
    """

    of_key: dict[Key, FitsOfKey] = field(default_factory=dict)
    least: FittedStates | None = None
    failures: list[tuple[Group, float]] = field(default_factory=list)

    def fits(self, key: Key) -> FitsOfKey:
        """Fits of a key, made if there are none."""
        return self.of_key.setdefault(key, FitsOfKey())

    def keep_least(self, fitted: FittedStates) -> None:
        """Keep states that were fitted without sensor errors if their chi2 is the least."""
        if self.least is None or fitted.cost < self.least.cost:
            self.least = fitted

    def copy(self) -> StateMemory:
        """Copy that changes on its own."""
        of_key = {key: replace(fits) for key, fits in self.of_key.items()}
        return StateMemory(of_key, self.least, list(self.failures))

    def reordered(self, at: Indices) -> StateMemory:
        """Copy with the 18 components of each state in the order ``at``, see ``Trajectory``."""
        of_key = {
            key: replace(
                fits,
                best=None if fits.best is None else fits.best.reordered(at),
                tried_chi2=None,
                anew=None,
            )
            for key, fits in self.of_key.items()
        }
        return StateMemory(of_key, None, list(self.failures))

    def since(self, before: StateMemory) -> StateMemory:
        """What a copy of ``before`` has that ``before`` has not."""
        new = {key: fits for key, fits in self.of_key.items() if fits != before.of_key.get(key)}
        least = None if self.least is before.least else self.least
        return StateMemory(new, least, self.failures[len(before.failures) :])

    def add(self, other: StateMemory) -> None:
        """Add what was fitted elsewhere; of two fits of a key, keep that of less chi2."""
        for key, fits in other.of_key.items():
            if fits.chi2 < self.fits(key).chi2:
                self.of_key[key] = fits
        if other.least is not None:
            self.keep_least(other.least)
        self.failures += other.failures
