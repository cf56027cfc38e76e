"""Fractions of time that a mesh spends in drive contact, separated and in back contact."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from herringbone_sim.analysis.motion import Motion


@dataclass(frozen=True)
class ContactShares:
    """Fractions of time of one mesh; their sum is 1, or all are NaN if the backlash is unknown.

    Attributes:
        mesh: name such as ``sp_L``.
        drive: x > b', contact on the drive flank.
        separated: |x| <= b'.
        back: x < -b', contact on the back flank.
    """

    mesh: str
    drive: float
    separated: float
    back: float


def contact_shares(
    motion: Motion, half_backlash_m: Mapping[str, float] | None
) -> tuple[ContactShares, ...]:
    """Fractions of time in each contact of every mesh, from its displacement (Eqs. 1, 3).

    The mesh force can't be used: its damping part c v acts in separation too.

    Args:
        motion: displacements in m.
        half_backlash_m: b' of ``sp`` and ``rp``; None, or a missing kind, gives NaN.
    """
    known = half_backlash_m or {}
    return tuple(
        _shares(motion, column, known.get(mesh, known.get(mesh[:2], float("nan"))))
        for column, mesh in enumerate(motion.meshes)
    )


def _shares(motion: Motion, column: int, half_backlash: float) -> ContactShares:
    """Fractions of time in each contact of the mesh in one column of the motion."""
    x, mesh = motion.x[:, column], motion.meshes[column]
    if not np.isfinite(half_backlash):
        return ContactShares(mesh, float("nan"), float("nan"), float("nan"))
    drive, back = float(np.mean(x > half_backlash)), float(np.mean(x < -half_backlash))
    return ContactShares(mesh, drive, 1.0 - drive - back, back)
