"""The gap while it runs: residual and place of a stretch of samples, and how two motions differ.

The steps of a diagnosis before attribution, on one stretch at a time: fusion by geometry,
recalibration inside the tolerances, the force law mesh by mesh. No trajectory is computed. Two
chaotic motions never match, so rig and simulator are compared by statistics alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.attribution.hypothesis import case
from herringbone_sim.gap.data.prepare import prepare_run
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.residuals.fusion import Fused, fuse
from herringbone_sim.gap.residuals.motion import fused_noise, motion_balance, recalibrate_motion
from herringbone_sim.gap.residuals.recalibrate import force_law, recalibrate
from herringbone_sim.gap.stream.stretch import Motion, Residual
from herringbone_sim.recording.campaign import CampaignRun
from herringbone_sim.recording.channels import Channels
from herringbone_sim.recording.reader import Recording

Array = NDArray[np.float64]

NOISELESS = 1e-4  # least noise as a share of a channel's RMS: a converter of 14 bits
ROUNDS = 3  # of a recalibration
SEED = 20  # of the noise that gives the floor of the accelerations


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
    recording = Recording(Path("stream"), "stream", series, Channels(), (), True, ())
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
    n = len(balance.measured)
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


def _with_floor(measured: Measured) -> Measured:
    rms = np.sqrt(np.mean(measured.values**2, axis=0))
    return replace(measured, sigma=np.maximum(measured.sigma, NOISELESS * rms))


def _kinds(names: Iterable[str]) -> str:
    return ", ".join(sorted({name.partition("_")[0] for name in names}))
