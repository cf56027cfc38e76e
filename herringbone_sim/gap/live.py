"""The gap while it runs: residual and place of a stretch of samples, and how two motions differ.

The steps of a diagnosis before attribution, on one stretch at a time: fusion by geometry,
recalibration inside the tolerances, the force law mesh by mesh. No trajectory is computed. Two
chaotic motions never match, so rig and simulator are compared by statistics alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.fusion import Fused, fuse
from herringbone_sim.gap.hypothesis import case
from herringbone_sim.gap.motion import fused_noise, motion_balance, recalibrate_motion
from herringbone_sim.gap.prepared import Measured, PreparedRun, prepare_run
from herringbone_sim.gap.recalibrate import force_law, recalibrate
from herringbone_sim.recording.campaign import CampaignRun
from herringbone_sim.recording.reader import Recording

Array = NDArray[np.float64]

CONTACTS = ("back", "apart", "drive")
NOISELESS = 1e-4  # least noise as a share of a channel's RMS: a converter of 14 bits
ROUNDS = 3  # of a recalibration
SEED = 20  # of the noise that gives the floor of the accelerations
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


def of_layout(nominal: Parameters, names: Iterable[str]) -> Parameters:
    """The nominal gear as the reduced or the full model, by the channels' names."""
    plain = any(re.fullmatch(r"[xvF]_(sp|rp)_[LR]", name) for name in names)
    return nominal.changed({"model": "reduced" if plain else "full"})


def point_of(
    series: TimeSeries, nominal: Parameters, told: Mapping[str, Any]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Operating point of a stretch, and what of it was not recorded.

    Args:
        told: parameters that the topic ``channels`` holds.
    """
    point, remarks = {}, []
    for name in ("delta_T", "K", "T_1"):
        if name in series:
            point[name] = float(np.median(series[name]))
        else:
            from_where = told if name in told else vars(nominal)
            point[name] = float(from_where[name])
            source = "the topic channels" if name in told else "the nominal gear"
            remarks.append(f"no channel {name}: {point[name]:g} of {source} is taken")
    turned = float(series["phase"][-1] - series["phase"][0])
    frequency = turned / float(series.times[-1] - series.times[0])
    point["Omega"] = frequency / build(nominal).scales.omega_n
    return point, tuple(remarks)


def residual(
    series: TimeSeries,
    nominal: Parameters,
    noise_share: float | None = None,
    told: Mapping[str, Any] | None = None,
) -> Residual:
    """Residual of a stretch of equidistant samples and where it sits.

    Args:
        series: channels of the recording contract, any subset.
        nominal: the rig as its data sheet has it.
        noise_share: RMS of the noise as a share of each channel's RMS; None: from the spectra,
            which is an upper bound.
        told: parameters that the topic ``channels`` holds.

    Raises:
        AnalysisError: channels from which no residual follows.
        ParameterError: an operating point at which the nominal gear can't exist.
    """
    if "phase" not in series:
        raise AnalysisError("no residual without a channel phase: k(t) and e(t) are not known")
    gear = of_layout(nominal, series.names)
    point, remarks = point_of(series, gear, told or {})
    recording = Recording(Path("stream"), "stream", series, {}, (), True, ())
    with np.errstate(invalid="ignore"):
        run = prepare_run(CampaignRun(Path("stream"), point, "fit"), recording, gear, noise_share)
        x, v, F, u = (_with_floor(one) for one in (run.x, run.v, run.F, run.u))
        run = replace(run, x=x, v=v, F=F, u=u)
        fused = fuse(run)
        remarks += tuple(finding.text for finding in run.findings)
        if case(run, fused).usable.any():
            return _of_forces(run, fused, float(series.times[-1]), remarks)
        if np.isfinite(fused.x).all() and np.isfinite(fused.v).all():
            return _of_motion(run, fused, float(series.times[-1]), remarks)
    raise AnalysisError(
        "no residual: it needs x (or u), v and F of a mesh, or x (or u) and v of all, got "
        f"{_kinds(series.names)}"
    )


def motion(series: TimeSeries, model: Model) -> Motion:
    """Statistics of a stretch; the contact by the model's half-backlash at its delta_T."""
    meshes = model.layout.meshes
    p = model.parameters
    point = {name: float(getattr(p, name)) for name in ("delta_T", "K", "T_1", "Omega")}
    force = np.full(len(meshes), np.nan)
    contact = np.full((len(meshes), 3), np.nan)
    for j, mesh in enumerate(meshes):
        if f"F_{mesh}" in series:
            force[j] = np.sum(series[f"F_{mesh}"] ** 2)
        if f"x_{mesh}" in series:
            x, b = series[f"x_{mesh}"], model.half_backlash_m[j]
            back, drive = int(np.sum(x < -b)), int(np.sum(x > b))
            contact[j] = back, len(x) - back - drive, drive
    return Motion(meshes, point, len(series), force, contact)


def motion_of(
    series: TimeSeries, nominal: Parameters, told: Mapping[str, Any] | None = None
) -> Motion:
    """``motion`` against the nominal gear at the operating point of the stretch.

    Raises:
        AnalysisError: no phase.
        ParameterError: an operating point at which the nominal gear can't exist.
    """
    if "phase" not in series:
        raise AnalysisError("no channel phase: the operating point is not known")
    gear = of_layout(nominal, series.names)
    return motion(series, build(gear.changed(point_of(series, gear, told or {})[0])))


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


def _of_forces(run: PreparedRun, fused: Fused, t_s: float, remarks: tuple[str, ...]) -> Residual:
    calibration = recalibrate([run], [fused], ROUNDS)
    before = force_law(run, fused, np.ones(6))
    law = force_law(run, fused, calibration.factors)
    on = np.isfinite(law.residual_n).sum(axis=0) == len(run)
    names = tuple(m for m, there in zip(run.model.layout.meshes, on, strict=True) if there)
    missing = [m for m in run.model.layout.meshes if m not in names]
    if missing:
        remarks += (f"no residual of {', '.join(missing)}: x, v or F is missing",)
    square = (law.residual_n[:, on] / law.sigma_n[:, on]) ** 2
    state = np.where(law.contact > 0.5, np.where(law.x_m > 0.0, 2, 0), 1)[:, on]
    return Residual(
        metric="force_law",
        places=names,
        t_s=t_s,
        point=run.point,
        count=len(run),
        square=square.sum(axis=0),
        nominal=np.sum(before.residual_n[:, on] ** 2, axis=0),
        recalibrated=np.sum(law.residual_n[:, on] ** 2, axis=0),
        floor=np.sum(law.sigma_n[:, on] ** 2, axis=0),
        signal=np.sum(run.F.values[:, on] ** 2, axis=0),
        contact_square=np.bincount(state.ravel(), square.ravel(), 3).astype(float),
        contact_count=np.bincount(state.ravel(), minlength=3).astype(float),
        remarks=remarks,
    )


def _of_motion(run: PreparedRun, fused: Fused, t_s: float, remarks: tuple[str, ...]) -> Residual:
    rng = np.random.default_rng(SEED)
    calibration, inertias = recalibrate_motion([run], [fused], rng, 2)
    noise = fused_noise(run, rng)
    before = motion_balance(run, fused, noise, np.ones(6), np.ones(3))
    balance = motion_balance(run, fused, noise, calibration.factors, inertias.inverse)
    n = len(balance.at)
    unknown = "no forces: by accelerations a mesh can't be told from others on the same body"
    return Residual(
        metric="torque_balance",
        places=run.model.layout.state_names[: run.model.layout.n_coordinate],
        t_s=t_s,
        point=run.point,
        count=n,
        square=np.sum((balance.residual / balance.sigma) ** 2, axis=0),
        nominal=np.sum(before.residual**2, axis=0),
        recalibrated=np.sum(balance.residual**2, axis=0),
        floor=n * balance.sigma**2,
        signal=np.sum(balance.measured**2, axis=0),
        contact_square=np.zeros(3),
        contact_count=np.zeros(3),
        remarks=(*remarks, unknown),
    )


def _shares(square: Array, count: Array) -> Array:
    above = np.where(square > QUIET * count, square - count, 0.0)
    return np.asarray(above / max(float(above.sum()), 1e-300), dtype=np.float64)


def _with_floor(measured: Measured) -> Measured:
    rms = np.sqrt(np.mean(measured.values**2, axis=0))
    return replace(measured, sigma=np.maximum(measured.sigma, NOISELESS * rms))


def _part(place: str, factor: str) -> str:
    """Kind, planet or side of a mesh ``sp1_L`` or a coordinate ``r1_L``; empty if it has none."""
    head, _, side = place.partition("_")
    if factor == "side":
        return side
    number = head.lstrip("abcdefghijklmnopqrstuvwxyz")
    if factor == "planet":
        return number
    return head.removesuffix(number) if head[:2] in ("sp", "rp") else ""


def _kinds(names: Iterable[str]) -> str:
    return ", ".join(sorted({name.partition("_")[0] for name in names}))
