"""Final motions of a gear from random initial states, compared with its motion from rest.

The fraction of initial states that end on the motion from rest is its basin stability (Menck et
al., Nature Physics 9 (2013) 89); the transverse exponent tells whether its left-right symmetry is
stable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.model import Model, initial_state
from herringbone_sim.dynamics.attractors import ALIKE, Attractor
from herringbone_sim.dynamics.basins import Sections, explore, wilson
from herringbone_sim.dynamics.exponent_methods import identify_motion
from herringbone_sim.dynamics.flow import GearFlow, settle, symmetry
from herringbone_sim.dynamics.transverse import symmetric_exponents
from herringbone_sim.errors import AnalysisError, DivergenceError

FATES = ("as from rest", "another, left = right", "left and right differ", "chaotic, they differ")
# Mesh cycles: averaged over; in which perturbations align; of transient.
PERIODS, TURNING, SETTLING = 600, 100, 1000


@dataclass(frozen=True)
class Survival:
    """Final motions of random initial states at one operating point.

    Attributes:
        motion: kind of the motion from rest (see ``motion_kind``), ``-`` where it diverged.
        counts: (4,) number of initial states by final motion, as in ``FATES``: the motion from
            rest, another left-right symmetric one, a regular asymmetric one, a chaotic asymmetric
            one.
        starts: number of random initial states, those that diverged included.
        within: (2,) largest exponent per tau of left-right symmetric perturbations of the motion
            from rest, and its standard error; NaN if the motion is not symmetric.
        transverse: (2,) the same of antisymmetric perturbations.
    """

    motion: str
    counts: Indices
    starts: int
    within: Array
    transverse: Array

    @property
    def shares(self) -> Array:
        """(4, 3) fraction of the initial states by final motion, with its 95 % Wilson interval."""
        return np.array([[c / self.starts, *wilson(int(c), self.starts)] for c in self.counts])


def survival(model: Model, sections_of: Sections, starts: Array, at: int = 0) -> Survival:
    """Classify the final motions of random initial states, and the stability of that from rest.

    Args:
        model: see ``core.model.build``.
        sections_of: maps initial states to stroboscopic sections, see ``basins.explore``.
        starts: (n_starts, n_state) random initial states, without states that effects add.
        at: mesh cycles from the initial state to the last point of a section.
    """
    rest_state = initial_state(model)
    basins = explore(sections_of, np.vstack([rest_state, starts]), symmetry(model))
    kinds = [
        identify_motion(model, attractor, PERIODS, TURNING, at)[0]
        for attractor in basins.attractors
    ]
    first, labels = basins.labels[0], basins.labels[1:]
    fates = [
        _fate(i == first, kind, attractor)
        for i, (kind, attractor) in enumerate(zip(kinds, basins.attractors, strict=True))
    ]
    counts = np.bincount([fates[i] for i in labels if i >= 0], minlength=len(FATES))
    within, transverse = _stability(model)
    motion = kinds[first] if first >= 0 else "-"
    return Survival(motion, counts, len(starts), within, transverse)


def _fate(from_rest: bool, kind: str, attractor: Attractor) -> int:
    """Index into ``FATES`` of an attractor whose kind (``motion_kind``) is ``kind``."""
    if from_rest:
        return 0
    if attractor.symmetry == ALIKE:
        return 1
    return 3 if "chaotic" in kind else 2


def _stability(model: Model) -> tuple[Array, Array]:
    """Largest exponent per tau of symmetric and antisymmetric perturbations of that from rest.

    Each (2,) with its standard error; NaN if the gear or the motion is not symmetric.
    """
    flow, exchange = GearFlow(model, 1), symmetry(model)
    none = np.full(2, np.nan)
    if exchange is None:
        return none, none
    try:
        y = settle(flow, flow.start(), SETTLING)
        exponents = symmetric_exponents(flow, y, exchange, PERIODS, TURNING, at=SETTLING)
    except (AnalysisError, DivergenceError):
        return none, none
    pairs = [
        np.array([growth.exponents[0], growth.errors[0]])
        for growth in (exponents.within, exponents.transverse)
    ]
    return pairs[0], pairs[1]
