"""Does a gear show the motion that it has from rest? Stability against parting of left and right,
and the share of starts that reach it: basin stability, Menck et al., Nature Physics 9 (2013) 89.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model, initial_state
from herringbone_sim.dynamics.attractors import ALIKE, Attractor
from herringbone_sim.dynamics.basins import Sections, explore, wilson
from herringbone_sim.dynamics.flow import GearFlow, settle, symmetry
from herringbone_sim.dynamics.opinions import identify
from herringbone_sim.dynamics.transverse import symmetric_exponents
from herringbone_sim.errors import AnalysisError, DivergenceError

Array = NDArray[np.float64]

FATES = ("as from rest", "another, left = right", "left and right differ", "chaotic, they differ")
PERIODS, TURNING, SETTLING = 600, 100, 1000


@dataclass(frozen=True)
class Survival:
    """What becomes of the motion from rest at one operating point.

    Attributes:
        motion: kind of the motion from rest, ``-`` where the run failed.
        counts: (4,) starts that end as ``FATES`` say: on the motion from rest, on another that
            keeps left and right alike, on a regular one that does not, on a chaotic one.
        starts: random starts run, failed ones among them.
        within: (2,) largest exponent of perturbations that keep left and right alike, and error.
        transverse: (2,) of those that part them; NaN for a motion from rest that is not symmetric.
    """

    motion: str
    counts: NDArray[np.int64]
    starts: int
    within: Array
    transverse: Array

    @property
    def shares(self) -> Array:
        """(4, 3) share of each fate and its 95 % Wilson interval."""
        return np.array([[c / self.starts, *wilson(int(c), self.starts)] for c in self.counts])


def survival(model: Model, sections_of: Sections, starts: Array, at: int = 0) -> Survival:
    """Fate of the starts and stability of the motion from rest, that is from the initial state.

    Args:
        model: see ``core.model.build``.
        sections_of: see ``basins.explore``.
        starts: (n_starts, n_state) states.
        at: mesh cycles that have passed at the last point of a section.
    """
    rest = initial_state(model)
    found = explore(sections_of, np.vstack([rest, starts]), symmetry(model))
    kinds = [identify(model, one, PERIODS, TURNING, at)[0] for one in found.attractors]
    first, labels = found.labels[0], found.labels[1:]
    fates = [
        _fate(i == first, kind, one)
        for i, (kind, one) in enumerate(zip(kinds, found.attractors, strict=True))
    ]
    counts = np.bincount([fates[i] for i in labels if i >= 0], minlength=len(FATES))
    within, transverse = _stability(model, rest)
    motion = kinds[first] if first >= 0 else "-"
    return Survival(motion, counts, len(starts), within, transverse)


def _fate(from_rest: bool, kind: str, attractor: Attractor) -> int:
    if from_rest:
        return 0
    if attractor.symmetry == ALIKE:
        return 1
    return 3 if "chaotic" in kind else 2


def _stability(model: Model, y: Array) -> tuple[Array, Array]:
    flow, exchange = GearFlow(model, 1), symmetry(model)
    none = np.full(2, np.nan)
    if exchange is None:
        return none, none
    try:
        y = settle(flow, y, SETTLING)
        found = symmetric_exponents(flow, y, exchange, PERIODS, TURNING, at=SETTLING)
    except (AnalysisError, DivergenceError):
        return none, none
    pairs = [
        np.array([one.exponents[0], one.errors[0]]) for one in (found.within, found.transverse)
    ]
    return pairs[0], pairs[1]
