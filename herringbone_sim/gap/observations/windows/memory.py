"""States fitted to the windows of a run so far: the starts of later fits.

A fit is told by its key: names of the functions with an amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from herringbone_sim.arrays import Indices
from herringbone_sim.gap.observations.windows.restarts import WindowRange
from herringbone_sim.gap.observations.windows.shooting import FittedStates

Key = tuple[str, ...]


class Failure(NamedTuple):
    """Windows whose restart gained nothing, ``tries`` times, at a chi2 of the run."""

    group: WindowRange
    chi2: float
    tries: int


@dataclass
class KnownStates:
    """What is known of the fits of one key.

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
        by_key: what is known of each key.
        least: states of least chi2 under any change without sensor errors; None before.
        failures: windows whose restart gained nothing.
    """

    by_key: dict[Key, KnownStates] = field(default_factory=dict)
    least: FittedStates | None = None
    failures: list[Failure] = field(default_factory=list)

    def known(self, key: Key) -> KnownStates:
        """What is known of a key, from now on if nothing was."""
        return self.by_key.setdefault(key, KnownStates())

    def keep_least(self, fitted: FittedStates) -> None:
        """Set ``least`` to states if their chi2 is less than that of ``least``.

        Args:
            fitted: states fitted without sensor errors, which is not checked.
        """
        if self.least is None or fitted.cost < self.least.cost:
            self.least = fitted

    def copy(self) -> StateMemory:
        """Copy that changes on its own."""
        by_key = {key: replace(known) for key, known in self.by_key.items()}
        return StateMemory(by_key, self.least, list(self.failures))

    def reordered(self, at: Indices) -> StateMemory:
        """Copy with the 18 components of each state in the order ``at``, see ``Trajectory``."""
        by_key = {
            key: replace(
                known,
                best=None if known.best is None else known.best.reordered(at),
                tried_chi2=None,
                anew=None,
            )
            for key, known in self.by_key.items()
        }
        return StateMemory(by_key, None, list(self.failures))

    def since(self, before: StateMemory) -> StateMemory:
        """What a copy of ``before`` has that ``before`` has not."""
        new = {key: now for key, now in self.by_key.items() if now != before.by_key.get(key)}
        least = None if self.least is before.least else self.least
        return StateMemory(new, least, self.failures[len(before.failures) :])

    def add(self, other: StateMemory) -> None:
        """Add what was fitted elsewhere; of two fits of a key, keep that of less chi2.

        Where it is the same, what was tried in vain elsewhere counts.
        """
        for key, known in other.by_key.items():
            if known.chi2 <= self.known(key).chi2:
                self.by_key[key] = known
        if other.least is not None:
            self.keep_least(other.least)
        self.failures += other.failures
