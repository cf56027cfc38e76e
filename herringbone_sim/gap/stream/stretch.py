"""Residual and motion statistics of a stretch of samples, as sums that add over stretches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np

from herringbone_sim.arrays import Array

CONTACTS = ("back", "apart", "drive")
NOISE_LIMIT = 1.15  # reduced chi2 up to which a mesh or coordinate counts as noise
SAME_POINT = {"delta_T": 1.0, "K": 0.01}  # within one operating point: [K], -


@dataclass(frozen=True)
class Residual:
    """Residual of a stretch of samples, as sums over the samples; ``join`` adds stretches.

    Attributes:
        metric: ``force_law`` [N], or ``torque_balance`` [m/s^2] where no force is measured.
        places: names of k meshes, or coordinates (q_S sun against carrier, rN_S planet N).
        t_s: time of the last sample [s].
        point: operating point delta_T [K], K, T_1 [N m], Omega.
        count: number of samples.
        square: (k,) chi2, sum of residual^2 over its noise variance.
        nominal, recalibrated: (k,) sum of squares of the residual before and after recalibration.
        floor: (k,) sum of the noise variance of the residual.
        signal: (k,) sum of squares of the measured force or acceleration.
        contact_square, contact_count: (3,) ``square`` and number of samples in back contact,
            apart and in drive contact; zero where unknown.
        remarks: sentences on missing channels and other limits.
    """

    metric: str
    places: tuple[str, ...]
    t_s: float
    point: Mapping[str, float]
    count: int
    square: Array
    nominal: Array
    recalibrated: Array
    floor: Array
    signal: Array
    contact_square: Array
    contact_count: Array
    remarks: tuple[str, ...]

    @property
    def chi(self) -> Array:
        """RMS (k,) of residual over noise at each mesh or coordinate: 1 for noise alone."""
        return np.asarray(np.sqrt(self.square / self.count), dtype=np.float64)

    @property
    def shares(self) -> Array:
        """Fraction (k,) of the chi2 above noise at each place; 0 below ``NOISE_LIMIT``."""
        return _shares(self.square, np.full(self.square.shape, float(self.count)))

    @property
    def total_chi(self) -> float:
        """RMS of residual over noise over all meshes or coordinates."""
        return float(np.sqrt(self.square.sum() / (self.count * len(self.places))))

    def rms(self, what: str) -> float:
        """RMS over all places of ``nominal``, ``recalibrated``, ``floor`` or ``signal``."""
        sums: Array = getattr(self, what)
        return float(np.sqrt(sums.sum() / (self.count * len(self.places))))

    @property
    def rms_by_place(self) -> Array:
        """RMS (k,) of the residual after recalibration, in the unit of ``metric``."""
        return np.asarray(np.sqrt(self.recalibrated / self.count), dtype=np.float64)

    def shares_by(self, factor: str) -> dict[str, float]:
        """Return fractions of the chi2 above noise by the names of a factor; empty if unknown.

        ``factor``: ``kind`` of mesh, ``planet``, ``side`` or ``contact`` state.
        """
        if factor == "contact":
            if not self.contact_count.any():
                return {}
            shares = _shares(self.contact_square, self.contact_count)
            return dict(zip(CONTACTS, map(float, shares), strict=True))
        totals: dict[str, float] = {}
        for place, share in zip(self.places, self.shares, strict=True):
            part = _part(place, factor)
            if part:
                totals[part] = totals.get(part, 0.0) + float(share)
        return totals


@dataclass(frozen=True)
class MotionStatistics:
    """Statistics of the motion in a stretch, as sums; NaN for meshes without the channel.

    Attributes:
        meshes: names of the n meshes.
        point: operating point as in ``Residual``.
        count: number of samples.
        force: (n,) sum of squares of the mesh force [N^2].
        contact: (n, 3) number of samples in back contact, apart, in drive contact.
    """

    meshes: tuple[str, ...]
    point: Mapping[str, float]
    count: int
    force: Array
    contact: Array

    @property
    def force_rms_n(self) -> Array:
        """RMS (n,) of the mesh force [N]."""
        return np.asarray(np.sqrt(self.force / self.count), dtype=np.float64)

    @property
    def contact_shares(self) -> Array:
        """Fraction of time (n, 3) in back contact, apart, in drive contact."""
        return np.asarray(self.contact / self.count, dtype=np.float64)


Stretch = TypeVar("Stretch", Residual, MotionStatistics)


def join(stretches: Sequence[Stretch]) -> Stretch:
    """Add the sums of ``joinable`` stretches, at least one; all else is that of the last."""
    last = stretches[-1]
    arrays = [f.name for f in fields(last) if isinstance(getattr(last, f.name), np.ndarray)]
    added: dict[str, Any] = {n: np.sum([getattr(s, n) for s in stretches], axis=0) for n in arrays}
    return replace(last, count=sum(s.count for s in stretches), **added)


def joinable(new: Residual | MotionStatistics, old: Residual | MotionStatistics) -> bool:
    """Whether places (or meshes) and metric are equal, and ``same_operating_point`` holds."""
    if isinstance(new, Residual) and isinstance(old, Residual):
        same = (new.metric, new.places) == (old.metric, old.places)
    else:
        same = getattr(new, "meshes", None) == getattr(old, "meshes", None)
    return same and same_operating_point(new.point, old.point)


def same_operating_point(a: Mapping[str, float], b: Mapping[str, float]) -> bool:
    """Whether operating points agree to 1 K in delta_T, 0.01 in K and 1 % in T_1 and Omega."""
    near = all(abs(a[q] - b[q]) <= tolerance for q, tolerance in SAME_POINT.items())
    return near and all(abs(a[q] - b[q]) <= 0.01 * abs(a[q]) for q in ("T_1", "Omega"))


def _shares(square: Array, count: Array) -> Array:
    """Return the fraction of the chi2 above noise in each sum ``square`` of ``count`` values."""
    above = np.where(square > NOISE_LIMIT * count, square - count, 0.0)
    return np.asarray(above / max(float(above.sum()), 1e-300), dtype=np.float64)


def _part(place: str, factor: str) -> str:
    """Return kind, planet or side of a mesh ``sp1_L`` or coordinate ``r1_L``; empty if none."""
    head, _, side = place.partition("_")
    if factor == "side":
        return side
    number = head.lstrip("abcdefghijklmnopqrstuvwxyz")
    if factor == "planet":
        return number
    return head.removesuffix(number) if head[:2] in ("sp", "rp") else ""
