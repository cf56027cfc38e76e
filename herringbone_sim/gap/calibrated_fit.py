"""Fit runs of a campaign, with the nominal gear calibrated to them without effects."""

from __future__ import annotations

from dataclasses import dataclass

from herringbone_sim.arrays import Array
from herringbone_sim.gap.attribution.effect_forces import FusedRun


@dataclass(frozen=True)
class Calibrated:
    """Fit runs and the calibration of the nominal gear to them.

    Attributes:
        cases: fit runs with their fused motion.
        factors: (6,) on k, c and e of both kinds of meshes, see ``recalibrate.NAMES``.
        per_mesh: (n_mesh,) mean square of the residual of the calibrated force law in units of its
            noise; None where the force law is not observed.
    """

    cases: tuple[FusedRun, ...]
    factors: Array
    per_mesh: Array | None
