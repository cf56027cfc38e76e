"""The fit runs of a campaign against the calibrated machine, before any effect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.attribution.hypothesis import Case

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Calibrated:
    """Fit runs and calibration.

    Attributes:
        cases: fit runs with their motion.
        factors: (6,) on k, c and e of both kinds of meshes.
        per_mesh: (n_mesh,) mean square of the force law's residual over its noise; None without.
    """

    cases: tuple[Case, ...]
    factors: Array
    per_mesh: Array | None
