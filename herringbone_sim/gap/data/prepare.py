"""Read the runs of a campaign and lay them out as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.core.layout import PREFIX_UNITS, QUANTITIES, Layout
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import AnalysisError, HerringboneError, listed
from herringbone_sim.gap.data.breaks import longest_part, unwrap_phase
from herringbone_sim.gap.data.mesh_excitation import waves
from herringbone_sim.gap.data.noise import (
    at_least_quantisation,
    quantisation_noise,
    spectral_floor,
)
from herringbone_sim.gap.data.prepared import (
    Measured,
    PreparedCampaign,
    PreparedRun,
)
from herringbone_sim.gap.data.rotations import (
    detrended_rotations,
    with_rotations,
    without_angles_not_in_rad,
)
from herringbone_sim.gap.data.screen import Finding, screen
from herringbone_sim.gap.data.usable_part import usable_part
from herringbone_sim.recording.campaign import CampaignRun, read_campaign
from herringbone_sim.recording.reader import Recording, read_recording

Sensors = Mapping[str, Mapping[str, float]]  # channel -> data in campaign.yaml


def prepare(folder: Path, nominal: Parameters) -> PreparedCampaign:
    """Read a campaign and lay it out as arrays.

    A run that can't be read is listed in ``missing`` of the result with the reason.

    Args:
        folder: with ``campaign.yaml``.
        nominal: parameters of the data sheet; its model is set to ``full``.

    Raises:
        RecordingError: the folder holds no campaign.
        AnalysisError: no run can be read.
    """
    campaign = read_campaign(folder)
    full = nominal.changed({"model": "full"})
    runs, missing = [], list(campaign.faults)
    for run in campaign.runs:
        try:
            recording = read_recording(run.path, cut_at_jump=True)
            runs.append(prepare_run(run, recording, full, campaign.noise_share, campaign.sensors))
        except HerringboneError as error:
            missing.append((run.path.name, str(error)))
    if not runs:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in missing)
        raise AnalysisError(f"no run of {folder} can be read: {reasons}")
    return PreparedCampaign(
        campaign.rig,
        full,
        tuple(runs),
        tuple(missing),
        noise_is_known(runs, campaign.noise_share, campaign.sensors),
        gain_tolerances(full.layout, campaign.sensors),
    )


def noise_is_known(
    runs: Sequence[PreparedRun], noise_share: float | None, sensors: Sensors
) -> bool:
    """Whether campaign.yaml gives the noise: as a fraction of the RMS, or of each channel.

    A fraction doesn't do for rotations without their mean, as their RMS is not that of the motion.
    """
    shared = noise_share is not None and not any(run.detrended for run in runs)
    return shared or all_noise_told(runs, sensors)


def all_noise_told(runs: Sequence[PreparedRun], sensors: Sensors) -> bool:
    """Whether campaign.yaml gives the noise of every recorded channel individually."""
    for run in runs:
        recorded = {
            name
            for q in QUANTITIES
            for name, on in zip(
                run.model.layout.channels_of(q), getattr(run, q).recorded, strict=True
            )
            if on
        }
        if not recorded <= told_noise(run.model, sensors).keys():
            return False
    return True


def told_noise(model: Model, sensors: Sensors) -> dict[str, float]:
    """Return the noise RMS [SI], by channel, that campaign.yaml gives for single channels.

    That of an angle ``angle_*`` is multiplied by the base radius and assigned to ``u_*``.
    """
    given_noise = {
        name: float(sensor["rms"]) for name, sensor in sensors.items() if "rms" in sensor
    }
    for body in model.layout.bodies:
        if f"angle_{body}" in given_noise:
            of_angle = given_noise.pop(f"angle_{body}") * model.scales.base_radius(body)
            given_noise.setdefault(f"u_{body}", of_angle)
    return given_noise


def gain_tolerances(layout: Layout, sensors: Sensors) -> tuple[float, ...]:
    """Return the relative gain tolerance (n_mesh,) of force sensors by campaign.yaml, or 0."""
    return tuple(
        float(sensors.get(f"F_{m}", {}).get("gain_tolerance", 0.0)) for m in layout.meshes
    )


def prepare_run(
    run: CampaignRun,
    recording: Recording,
    nominal: Parameters,
    noise_share: float | None,
    sensors: Sensors | None = None,
) -> PreparedRun:
    """Lay out one run as arrays: the middle of its longest unbroken part, usable channels.

    Args:
        run: path, role and operating point.
        recording: the run as read.
        nominal: parameters of the data sheet.
        noise_share: RMS of the noise over that of each channel; None: estimated from spectra.
        sensors: data of single channels in campaign.yaml; their ``rms`` is the noise.

    Raises:
        AnalysisError: no phase that increases, or fewer than two samples.
        ParameterError: the operating point is out of the range of the parameters.
    """
    name, samples = run.path.name, recording.samples
    _check_phase(name, samples)
    samples, wrap_findings = unwrap_phase(name, samples)
    part, break_findings = longest_part(name, samples)
    model = build(nominal.changed(run.point))
    layout = model.layout
    part, length_findings = usable_part(name, part, nominal.z_r)
    centred = detrended_rotations(samples, layout.channels_of("u"))  # any part of it has a mean
    units = declared_units(recording)
    part, unit_findings = without_angles_not_in_rad(name, part, units)
    part, turned = with_rotations(model, part)
    series, findings = screen(name, part, units)
    if len(series) < 2:
        raise AnalysisError(
            f"{name} needs two samples or more in a row, got {len(series)}: record more cycles"
        )
    phase = series["phase"].copy()
    omega = float((phase[-1] - phase[0]) / (series.times[-1] - series.times[0]))
    given_noise = told_noise(model, sensors or {})
    detrended = tuple(n for n in turned or centred if n in series)
    measured: dict[str, Any] = {
        q: _measured(series, layout.channels_of(q), noise_share, given_noise, detrended)
        for q in QUANTITIES
    }
    return PreparedRun(
        name=name,
        role=run.role,
        point=run.point,
        times=series.times - samples.times[0],
        phase=phase,
        **measured,
        model=model,
        waves=waves(model, phase, omega),
        recorded_point={q: series[q].copy() for q in ("K", "delta_T", "T_1") if q in series},
        findings=(
            *_reader_findings(name, recording),
            *wrap_findings,
            *break_findings,
            *length_findings,
            *unit_findings,
            *_unknown_channels(name, series, layout),
            *findings,
        ),
        detrended=detrended,
    )


def _check_phase(name: str, series: TimeSeries) -> None:
    """Raise AnalysisError unless the series has a phase that increases."""
    if "phase" not in series:
        raise AnalysisError(
            f"{name} needs a channel phase, got {listed(series.names)}: record the mesh phase "
            "with the run"
        )
    turns = np.diff(series["phase"])
    known = turns[np.isfinite(turns)]
    if not turns.size:
        return
    turn = float(np.median(known) or np.mean(known)) if known.size else float("nan")
    if not turn > 0.0:
        what = (
            "runs backwards" if turn < 0.0 else "stands still" if turn == 0.0 else "is no number"
        )
        raise AnalysisError(
            f"the mesh phase of {name} {what}, got {turn:.6g} rad from sample to sample: k(t) and "
            "e(t) depend on it; correct channel phase"
        )


def declared_units(recording: Recording) -> dict[str, str]:
    """Return the units that the ``channels`` topic declares, by channel."""
    return {name: unit for name, unit in recording.channels.units.items() if unit}


def _reader_findings(name: str, recording: Recording) -> list[Finding]:
    """Return the notes of the reader as findings: damaged files, a clock that jumps back."""
    times = recording.samples.times
    findings = []
    for note in recording.notes:
        jumped = recording.jump_s is not None and note is recording.notes[-1]
        what, channels = ("clock", ("t",)) if jumped else ("recording", ())
        at = recording.jump_s if jumped else None
        findings.append(Finding(what, name, channels, at, f"{name}: {note}"))
    if not recording.complete:
        text = f"{name} is not whole and ends at {times[-1]:.6g} s: it is used as far as it goes"
        findings.append(Finding("cut_off", name, ("t",), float(times[-1]), text))
    return findings


def _unknown_channels(name: str, series: TimeSeries, layout: Layout) -> list[Finding]:
    """Return a finding on channels of meshes and bodies that the nominal gear lacks, if any."""
    known = {*layout.channels, *layout.channels_of("a"), *layout.channels_of("pin")}
    others = tuple(n for n in series.names if n.split("_")[0] in PREFIX_UNITS and n not in known)
    if not others:
        return []
    text = (
        f"{listed(others[:3])}{', ...' if len(others) > 3 else ''} of {name} belong to no mesh "
        f"or body of the nominal gear, which has {len(layout.planets)} planets: the nominal file, "
        "or the recording, is that of another gear or of the reduced model; they are not used"
    )
    return [Finding("foreign", name, others, None, text)]


def _measured(
    series: TimeSeries,
    names: tuple[str, ...],
    noise_share: float | None,
    given_noise: Mapping[str, float],
    detrended: Sequence[str],
) -> Measured:
    """Return the channels ``names`` of a series with their noise; absent ones are NaN.

    The noise is at least the quantisation noise of a channel.

    Args:
        noise_share: RMS of the noise over that of the channel, mean included; quantisation noise
            of the converter is added. None: the noise is estimated from the spectrum, as is that
            of channels without their mean (``detrended``).
        given_noise: RMS of the noise of single channels, which has priority over both.
    """
    values = np.full((len(series), len(names)), np.nan)
    there = np.array([name in series for name in names])
    for j in np.flatnonzero(there):
        values[:, j] = series[names[j]]
    if noise_share is None:
        sigma = spectral_floor(values)
    else:
        known = np.maximum(np.isfinite(values).sum(axis=0), 1)
        power = np.nansum(values**2, axis=0) / known / (1.0 + noise_share**2)
        sigma = np.sqrt(noise_share**2 * power + quantisation_noise(values) ** 2)
        lost = np.isin(names, detrended)
        sigma[lost] = spectral_floor(values[:, lost]) if lost.any() else sigma[lost]
    given_sigma = np.array([given_noise.get(name, np.nan) for name in names])
    sigma = at_least_quantisation(np.where(np.isfinite(given_sigma), given_sigma, sigma), values)
    return Measured(values, there, np.where(there, sigma, np.nan), np.isfinite(given_sigma))
