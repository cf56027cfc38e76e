"""Residual and motion statistics of a stretch: consecutive samples at one operating point.

The channels are fused, the gear is recalibrated inside its tolerances and compared with the force
law, as in a diagnosis; no effects are sought. Two chaotic motions diverge, so rig and simulator
are compared by statistics.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters, coerce
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.attribution.effect_forces import fused_run
from herringbone_sim.gap.data.prepare import prepare_run
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.residuals.balance_without_forces import (
    fused_noise,
    motion_balance,
    recalibrate_motion,
)
from herringbone_sim.gap.residuals.fusion import Fused, fuse
from herringbone_sim.gap.residuals.recalibrate import force_law, recalibrate
from herringbone_sim.gap.sensors.detrended import without_detrended
from herringbone_sim.gap.stream.stretch import MotionStatistics, Residual
from herringbone_sim.recording.campaign import POINT, CampaignRun
from herringbone_sim.recording.channels import Channels
from herringbone_sim.recording.reader import Recording

NOISELESS = 1e-4  # least noise over RMS of a channel, that of a converter of 14 bits
ROUNDS = 3  # Gauss-Newton steps of a recalibration
SEED = 20  # of the noise realisation for the noise of the accelerations


def parameters_for_channels(nominal: Parameters, names: Iterable[str]) -> Parameters:
    """Return nominal parameters with the model that the channels are named for.

    It is ``reduced`` if a channel x, v or F is of a mesh without a planet number (``x_sp_L``),
    else ``full``, with rotations alone, too.
    """
    plain = any(re.fullmatch(r"[xvF]_(sp|rp)_[LR]", name) for name in names)
    return nominal.changed({"model": "reduced" if plain else "full"})


def operating_point(
    series: TimeSeries, nominal: Parameters, declared: Mapping[str, Any]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the operating point of a stretch, and remarks on quantities without a channel.

    Args:
        series: samples with ``phase``.
        nominal: parameters of the data sheet, for quantities with neither channel nor declaration.
        declared: parameters that the topic ``channels`` holds.

    Returns:
        delta_T [K], K, T_1 [N m] and Omega by name; sentences.
    """
    point, remarks = {}, []
    for name in ("delta_T", "K", "T_1"):
        if name in series and np.isfinite(series[name]).any():
            point[name] = float(np.nanmedian(series[name]))
        else:
            said = declared.get(name)
            known = isinstance(said, (int, float)) and not isinstance(said, bool)
            value: Any = coerce(name, said) if known else getattr(nominal, name)
            point[name] = float(value)
            source = "the topic channels" if known else "the nominal gear"
            remarks.append(f"no channel {name}: {point[name]:g} of {source} is taken")
    turned = float(series["phase"][-1] - series["phase"][0])
    frequency = turned / float(series.times[-1] - series.times[0])
    point["Omega"] = frequency / build(nominal).scales.omega_n
    return point, tuple(remarks)


def residual(
    series: TimeSeries,
    nominal: Parameters,
    noise_share: float | None = None,
    declared: Mapping[str, Any] | None = None,
) -> Residual:
    """Return the residual of a stretch of equidistant samples, by mesh or coordinate.

    It is that of the force law if x (or u), v and F of a mesh are known, else that of the torque
    balance.

    Args:
        series: samples of any channels of a recording.
        nominal: parameters of the data sheet.
        noise_share: RMS of the noise over that of each channel; None: estimated from spectra, an
            upper bound.
        declared: parameters that the topic ``channels`` holds.

    Raises:
        AnalysisError: the channels don't allow a residual.
        ParameterError: the operating point is out of the range of the parameters.
    """
    if "phase" not in series:
        raise AnalysisError("no residual without a channel phase: k(t) and e(t) are not known")
    gear = parameters_for_channels(nominal, series.names)
    point, remarks = operating_point(series, gear, declared or {})
    recording = Recording(Path("stream"), "stream", series, Channels(), (), True, ())
    with np.errstate(invalid="ignore"):
        run = without_detrended(
            prepare_run(CampaignRun(Path("stream"), point, "fit"), recording, gear, noise_share)
        )
        x, v, F, u = (_with_least_noise(measured) for measured in (run.x, run.v, run.F, run.u))
        run = replace(run, x=x, v=v, F=F, u=u)
        fused = fuse(run)
        remarks += tuple(finding.text for finding in run.findings)
        if fused_run(run, fused).usable.any():
            return _force_law_residual(run, fused, float(series.times[-1]), remarks)
        if fused.known_meshes.all():
            return _motion_residual(run, fused, float(series.times[-1]), remarks)
    raise AnalysisError(
        "no residual: it needs x (or u), v and F of a mesh, or x (or u) and v of all, got "
        f"{_kinds(series.names)}"
    )


def motion_statistics(series: TimeSeries, model: Model) -> MotionStatistics:
    """Return the statistics of a stretch; the half-backlash of the model determines contact."""
    meshes = model.layout.meshes
    p = model.parameters
    point = {name: float(getattr(p, name)) for name in POINT}
    force = np.full(len(meshes), np.nan)
    contact = np.full((len(meshes), 3), np.nan)
    for j, mesh in enumerate(meshes):
        if f"F_{mesh}" in series:
            force[j] = _known_sum(series[f"F_{mesh}"] ** 2)
        if f"x_{mesh}" in series:
            x, b = series[f"x_{mesh}"], model.half_backlash_m[j]
            states = np.array([x < -b, np.abs(x) <= b, x > b])
            contact[j] = [_known_sum(np.where(np.isfinite(x), state, np.nan)) for state in states]
    return MotionStatistics(meshes, point, len(series), force, contact)


def _known_sum(values: Array) -> float:
    """Return the sum of values (n,), those that are NaN taken as the mean of the others."""
    known = values[np.isfinite(values)]
    return float(np.mean(known)) * len(values) if len(known) else float("nan")


def motion_at_operating_point(
    series: TimeSeries, nominal: Parameters, declared: Mapping[str, Any] | None = None
) -> MotionStatistics:
    """Return the statistics of a stretch, with the nominal gear at its operating point.

    Args:
        series: samples with ``phase``.
        nominal: parameters of the data sheet.
        declared: parameters that the topic ``channels`` holds.

    Raises:
        AnalysisError: no channel phase.
        ParameterError: the operating point is out of the range of the parameters.
    """
    if "phase" not in series:
        raise AnalysisError("no channel phase: the operating point is not known")
    gear = parameters_for_channels(nominal, series.names)
    return motion_statistics(
        series, build(gear.changed(operating_point(series, gear, declared or {})[0]))
    )


def _force_law_residual(
    run: PreparedRun, fused: Fused, t_s: float, remarks: tuple[str, ...]
) -> Residual:
    """Return the residual of the force law at meshes with x, v and F.

    Args:
        run, fused: the stretch as a run, and its fused motion.
        t_s: time of its last sample [s].
        remarks: remarks to which those on missing channels are added.
    """
    before = force_law(run, fused, np.ones(6))
    law = force_law(run, fused, recalibrate([run], [fused], ROUNDS))
    on = np.isfinite(law.residual_n).sum(axis=0) == len(run)
    names = tuple(m for m, there in zip(run.model.layout.meshes, on, strict=True) if there)
    missing = [m for m in run.model.layout.meshes if m not in names]
    if missing:
        remarks += (f"no residual of {', '.join(missing)}: x, v or F is missing",)
    square = (law.residual_n[:, on] / law.sigma_n[:, on]) ** 2
    flank = law.flank[:, on].ravel()
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
        contact_square=np.bincount(flank, square.ravel(), 3).astype(float),
        contact_count=np.bincount(flank, minlength=3).astype(float),
        remarks=remarks,
    )


def _motion_residual(
    run: PreparedRun, fused: Fused, t_s: float, remarks: tuple[str, ...]
) -> Residual:
    """Return the residual of the torque balance with forces of the law, by coordinate."""
    rng = np.random.default_rng(SEED)
    factors, inverse_inertias = recalibrate_motion([run], [fused], rng, 2)
    noise = fused_noise(run, rng)
    before = motion_balance(run, fused, noise, np.ones(6), np.ones(3))
    balance = motion_balance(run, fused, noise, factors, inverse_inertias)
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


def _with_least_noise(measured: Measured) -> Measured:
    """Raise the noise of each channel to at least ``NOISELESS`` times its RMS."""
    rms = np.sqrt(np.mean(measured.values**2, axis=0))
    return replace(measured, sigma=np.maximum(measured.sigma, NOISELESS * rms))


def _kinds(names: Iterable[str]) -> str:
    """Return the prefixes of channel names as text, such as ``F, phase, x``."""
    return ", ".join(sorted({name.partition("_")[0] for name in names}))
