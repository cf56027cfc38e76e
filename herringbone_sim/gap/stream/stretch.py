"""What a stretch of samples says of the gap, in sums that add up over stretches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CONTACTS = ("back", "apart", "drive")
QUIET = 1.15  # mean square of residual over floor up to which a place counts as noise
NEAR = {"delta_T": 1.0, "K": 0.01}  # operating points that count as one


@dataclass(frozen=True)
class Residual:
    """Sums over a stretch of samples; those of several stretches add up, see ``join``.

    Attributes:
        metric: ``force_law`` [N], or ``torque_balance`` [m/s^2] where no force is measured.
        places: (k,) meshes, or coordinates (q_S sun against carrier, rN_S planet N).
        t_s: time of the last sample.
        point: operating point delta_T [K], K, T_1 [N m], Omega.
        count: samples.
        square: (k,) sum of residual^2 over floor^2.
        nominal, recalibrated, floor, signal: (k,) sums of squares of the residual before and
            after recalibration inside the tolerances, of its floor, of what was measured.
        contact_square, contact_count: (3,) sums of residual^2 over floor^2 and samples in back
            contact, apart, in drive contact; zero where unknown.
        remarks: what is missing or odd.
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
        """RMS (k,) of the residual over its floor: 1 is noise."""
        return np.asarray(np.sqrt(self.square / self.count), dtype=np.float64)

    @property
    def shares(self) -> Array:
        """Share (k,) of each place in the energy above the floor; 0 where it is noise."""
        return _shares(self.square, np.full(self.square.shape, float(self.count)))

    @property
    def total_chi(self) -> float:
        """RMS of all residuals over their floors."""
        return float(np.sqrt(self.square.sum() / (self.count * len(self.places))))

    def rms(self, what: str) -> float:
        """RMS over all places of ``nominal``, ``recalibrated``, ``floor`` or ``signal``."""
        sums: Array = getattr(self, what)
        return float(np.sqrt(sums.sum() / (self.count * len(self.places))))

    @property
    def rms_of_place(self) -> Array:
        """RMS (k,) of the recalibrated residual."""
        return np.asarray(np.sqrt(self.recalibrated / self.count), dtype=np.float64)

    def shares_by(self, factor: str) -> dict[str, float]:
        """Shares by ``kind``, ``planet``, ``side`` or ``contact``; empty where unknown."""
        if factor == "contact":
            if not self.contact_count.any():
                return {}
            shares = _shares(self.contact_square, self.contact_count)
            return dict(zip(CONTACTS, map(float, shares), strict=True))
        found: dict[str, float] = {}
        for place, share in zip(self.places, self.shares, strict=True):
            part = _part(place, factor)
            if part:
                found[part] = found.get(part, 0.0) + float(share)
        return found


@dataclass(frozen=True)
class Motion:
    """Statistics of a motion, as sums; meshes whose channel is absent have NaN.

    Attributes:
        meshes: n names.
        point: operating point.
        count: samples.
        force: (n,) sum of squares [N^2].
        contact: (n, 3) samples in back contact, apart, in drive contact.
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
        """Share of time (n, 3) in back contact, apart, in drive contact."""
        return np.asarray(self.contact / self.count, dtype=np.float64)


def join(stretches: Sequence[Residual]) -> Residual:
    """Stretches of one operating point, metric and set of places as one; the last one's head."""
    of_contact = ("contact_square", "contact_count")
    sums = ("square", "nominal", "recalibrated", "floor", "signal", *of_contact)
    added: dict[str, Any] = {n: np.sum([getattr(s, n) for s in stretches], axis=0) for n in sums}
    return replace(stretches[-1], count=sum(s.count for s in stretches), **added)


def join_motions(stretches: Sequence[Motion]) -> Motion:
    """The same for statistics."""
    return replace(
        stretches[-1],
        count=sum(s.count for s in stretches),
        force=np.sum([s.force for s in stretches], axis=0),
        contact=np.sum([s.contact for s in stretches], axis=0),
    )


def belongs(new: Residual | Motion, old: Residual | Motion) -> bool:
    """Whether two stretches may be joined."""
    if isinstance(new, Residual) and isinstance(old, Residual):
        same = (new.metric, new.places) == (old.metric, old.places)
    else:
        same = getattr(new, "meshes", None) == getattr(old, "meshes", None)
    return same and alike(new.point, old.point)


def alike(a: Mapping[str, float], b: Mapping[str, float]) -> bool:
    """Whether two operating points are one: within 1 K, 0.01 of K, 1 % of T_1 and Omega."""
    near = all(abs(a[name] - b[name]) <= least for name, least in NEAR.items())
    return near and all(abs(a[q] - b[q]) <= 0.01 * abs(a[q]) for q in ("T_1", "Omega"))


def _shares(square: Array, count: Array) -> Array:
    above = np.where(square > QUIET * count, square - count, 0.0)
    return np.asarray(above / max(float(above.sum()), 1e-300), dtype=np.float64)


def _part(place: str, factor: str) -> str:
    """Kind, planet or side of a mesh ``sp1_L`` or a coordinate ``r1_L``; empty if it has none."""
    head, _, side = place.partition("_")
    if factor == "side":
        return side
    number = head.lstrip("abcdefghijklmnopqrstuvwxyz")
    if factor == "planet":
        return number
    return head.removesuffix(number) if head[:2] in ("sp", "rp") else ""
