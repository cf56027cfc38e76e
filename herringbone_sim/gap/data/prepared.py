"""A campaign as arrays: what was measured, its noise, and the nominal waves at every sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.layout import KINDS, PREFIX_UNITS, SIDES, Layout
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import AnalysisError, HerringboneError, listed
from herringbone_sim.gap.data.breaks import longest_part, unwrapped
from herringbone_sim.gap.data.noise import spectral_floor
from herringbone_sim.gap.data.screen import Finding, screen
from herringbone_sim.gap.data.waves import Waves, waves
from herringbone_sim.recording.campaign import CampaignRun, read_campaign
from herringbone_sim.recording.reader import Recording, read_recording

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Measured:
    """One quantity of all its places over a run.

    Attributes:
        values: (n, k) [SI]; NaN where a channel is absent.
        there: (k,) which channels are there.
        sigma: (k,) standard deviation of the noise, same unit; NaN where absent.
    """

    values: Array
    there: Mask
    sigma: Array

    @property
    def complete(self) -> bool:
        return bool(self.there.all())


SHAFTS = ("s_L", "s_R", "c")
NO_MEAN = 1e-9  # of the largest value: what rounding leaves of a mean that was taken off


@dataclass(frozen=True)
class PreparedRun:
    """One run, ready for the steps of the diagnosis.

    Attributes:
        name, role: folder name; ``fit`` or ``held_out``.
        point: operating point delta_T [K], K, T_1 [N m], Omega.
        times: (n,) [s] from the first sample of the recording on, which may have been cut off.
        phase: (n,) mesh phase [rad], unwrapped.
        x, v, F: (n, n_mesh) displacement [m], rate [m/s], force [N], in the order of the layout.
        u, a: (n, n_bodies) rotation times base radius [m], and its acceleration [m/s^2].
        pin: (n, planets) what planets drive the carrier with [N].
        model: nominal model at the operating point: c, b', scales.
        waves: nominal k(t), e(t) and its derivatives at the recorded phase.
        recorded_point: (n,) channels K, delta_T and T_1 as recorded, those that are there.
        findings: channels left out and breaks of the clock; what the reader found odd.
        late_rad: how late in mesh phase all channels are, see ``sensors.late``.
        e_share: what a filter of all channels leaves of e(t) in x.
    """

    name: str
    role: str
    point: Mapping[str, float]
    times: Array
    phase: Array
    x: Measured
    v: Measured
    F: Measured
    u: Measured
    a: Measured
    pin: Measured
    model: Model
    waves: Waves
    recorded_point: Mapping[str, Array]
    findings: tuple[Finding, ...]
    late_rad: float = 0.0
    e_share: float = 1.0

    def __len__(self) -> int:
        return len(self.times)

    @property
    def shafts_known(self) -> bool:
        """Whether rotations or accelerations of both suns and the carrier are measured.

        Rotations without a mean, as of raw angles, lack the wind-up under the load.
        """
        at = [self.model.layout.bodies.index(name) for name in SHAFTS]
        u = self.u.values[:, at]
        wound_up = np.abs(u.mean(axis=0)) > NO_MEAN * np.abs(u).max(axis=0)
        return bool((wound_up | self.a.there[at]).all())

    @property
    def step_s(self) -> float:
        """Mean time between samples [s]."""
        return float((self.times[-1] - self.times[0]) / (len(self.times) - 1))

    @property
    def cycle_s(self) -> float:
        """Time of a mesh cycle [s]."""
        return 2.0 * np.pi / self.omega_rad_per_s

    @property
    def omega_rad_per_s(self) -> float:
        """Mean slope of the phase."""
        return float((self.phase[-1] - self.phase[0]) / (self.times[-1] - self.times[0]))


@dataclass(frozen=True)
class MeshTable:
    """What each mesh is, in the order of mesh arrays; arrays (n_mesh,).

    Attributes:
        names: such as ``sp1_L``.
        kind: 0 sun-planet, 1 ring-planet.
        side: 0 left, 1 right.
        planet: 0 ... N - 1.
    """

    names: tuple[str, ...]
    kind: Index
    side: Index
    planet: Index


@dataclass(frozen=True)
class PreparedCampaign:
    """Runs of one rig as arrays.

    Attributes:
        rig: name.
        nominal: parameters of the full model, at no particular operating point.
        runs: those that could be read.
        meshes: what each mesh is.
        missing: (run, reason) of those that could not be read.
        noise_known: whether the campaign tells it; if not, it is that of the spectra.
        gain_tolerance: (n_mesh,) of the force sensors, as the campaign tells; 0 where it doesn't.
    """

    rig: str
    nominal: Parameters
    runs: tuple[PreparedRun, ...]
    meshes: MeshTable
    missing: tuple[tuple[str, str], ...]
    noise_known: bool = True
    gain_tolerance: tuple[float, ...] = ()

    def of_role(self, role: str) -> tuple[PreparedRun, ...]:
        return tuple(run for run in self.runs if run.role == role)


def prepare(folder: Path, nominal: Parameters) -> PreparedCampaign:
    """Read a campaign and lay it out as arrays.

    Args:
        folder: with ``campaign.yaml``.
        nominal: the rig as the data sheet has it; the full model is made of it.

    Raises:
        RecordingError: no campaign there. A run that can't be read is named in ``missing``.
        AnalysisError: no run at all can be read.
    """
    campaign = read_campaign(folder)
    full = nominal.changed({"model": "full"})
    runs, missing = [], list(campaign.faults)
    for run in campaign.runs:
        try:
            recording = read_recording(run.path, cut_at_jump=True)
            runs.append(prepare_run(run, recording, full, campaign.noise_share))
        except HerringboneError as error:
            missing.append((run.path.name, str(error)))
    if not runs:
        told = "; ".join(f"{name}: {reason}" for name, reason in missing)
        raise AnalysisError(f"no run of {folder} can be read: {told}")
    return PreparedCampaign(
        campaign.rig,
        full,
        tuple(runs),
        mesh_table(full.layout),
        tuple(missing),
        campaign.noise_share is not None,
        force_gains(full.layout, campaign.sensors),
    )


def force_gains(layout: Layout, sensors: Mapping[str, Mapping[str, float]]) -> tuple[float, ...]:
    """Tolerance of the gain of each force sensor, as it is told."""
    return tuple(
        float(sensors.get(f"F_{m}", {}).get("gain_tolerance", 0.0)) for m in layout.meshes
    )


def prepare_run(
    run: CampaignRun, recording: Recording, nominal: Parameters, noise_share: float | None
) -> PreparedRun:
    """One run as arrays.

    Raises:
        AnalysisError: no phase, or less than two samples.
        ParameterError: an operating point at which the nominal gear can't exist.
    """
    name, whole = run.path.name, recording.samples
    _check_phase(name, whole)
    whole, wrapped = unwrapped(name, whole)
    part, broken = longest_part(name, whole)
    series, findings = screen(name, part, declared_units(recording))
    if len(series) < 2:
        raise AnalysisError(
            f"{name} needs two samples or more in a row, got {len(series)}: record more cycles"
        )
    model = build(nominal.changed(run.point))
    phase = series["phase"].copy()
    omega = float((phase[-1] - phase[0]) / (series.times[-1] - series.times[0]))
    layout = model.layout
    x, v, F = (
        measured(series, tuple(f"{q}_{m}" for m in layout.meshes), noise_share) for q in "xvF"
    )
    u = measured(series, tuple(f"u_{body}" for body in layout.bodies), noise_share)
    return PreparedRun(
        name=name,
        role=run.role,
        point=run.point,
        times=series.times - whole.times[0],
        phase=phase,
        x=x,
        v=v,
        F=F,
        u=u,
        a=measured(series, tuple(f"a_{body}" for body in layout.bodies), noise_share),
        pin=measured(series, tuple(f"F_pin{p}" for p in layout.planets), noise_share),
        model=model,
        waves=waves(model, phase, omega),
        recorded_point={q: series[q].copy() for q in ("K", "delta_T", "T_1") if q in series},
        findings=(
            *_noted(name, recording),
            *wrapped,
            *broken,
            *_foreign(name, series, layout),
            *findings,
        ),
    )


def _check_phase(name: str, series: TimeSeries) -> None:
    """AnalysisError without a phase that goes forward."""
    if "phase" not in series:
        raise AnalysisError(
            f"{name} needs a channel phase, got {listed(series.names)}: record the mesh phase "
            "with the run"
        )
    turns = np.diff(series["phase"])
    known = turns[np.isfinite(turns)]
    if not turns.size:
        return
    turn = float(np.median(known)) if known.size else float("nan")
    if not turn > 0.0:
        what = (
            "runs backwards" if turn < 0.0 else "stands still" if turn == 0.0 else "is no number"
        )
        raise AnalysisError(
            f"the mesh phase of {name} {what}, got {turn:.6g} rad from sample to sample: k(t) and "
            "e(t) hang on it; mend channel phase"
        )


def declared_units(recording: Recording) -> dict[str, str]:
    """Unit of each channel as the ``channels`` topic has it; empty where it says nothing."""
    return {name: unit for name, unit in recording.channels.units.items() if unit}


def _noted(name: str, recording: Recording) -> list[Finding]:
    times = recording.samples.times
    found = []
    for note in recording.notes:
        jumped = recording.jump_s is not None and note is recording.notes[-1]
        what, channels = ("clock", ("t",)) if jumped else ("recording", ())
        at = recording.jump_s if jumped else None
        found.append(Finding(what, name, channels, at, f"{name}: {note}"))
    if not recording.complete:
        text = f"{name} is not whole and ends at {times[-1]:.6g} s: it is used as far as it goes"
        found.append(Finding("cut_off", name, ("t",), float(times[-1]), text))
    return found


def _foreign(name: str, series: TimeSeries, layout: Layout) -> list[Finding]:
    """Channels of meshes and bodies that the nominal gear does not have."""
    known = {*layout.channels, *(f"{q}_{body}" for q in "ua" for body in layout.bodies)}
    known |= {f"F_pin{planet}" for planet in layout.planets}
    others = tuple(n for n in series.names if n.split("_")[0] in PREFIX_UNITS and n not in known)
    if not others:
        return []
    text = (
        f"{listed(others[:3])}{', ...' if len(others) > 3 else ''} of {name} belong to no mesh "
        f"or body of the nominal gear, which has {len(layout.planets)} planets: the nominal file, "
        "or the recording, is that of another gear or of the reduced model; they are not used"
    )
    return [Finding("foreign", name, others, None, text)]


def measured(series: TimeSeries, names: tuple[str, ...], noise_share: float | None) -> Measured:
    """Channels of a series, NaN where there is none, and the noise on each.

    Args:
        noise_share: of each channel's RMS, mean included; None: taken from the spectrum. The
            resolution of the converter is on top of it.
    """
    values = np.full((len(series), len(names)), np.nan)
    there = np.array([name in series for name in names])
    for j in np.flatnonzero(there):
        values[:, j] = series[names[j]]
    if noise_share is None:
        return Measured(values, there, spectral_floor(values))
    known = np.maximum(np.isfinite(values).sum(axis=0), 1)
    power = np.nansum(values**2, axis=0) / known / (1.0 + noise_share**2)
    sigma = np.sqrt(noise_share**2 * power + resolution(values) ** 2 / 12.0)
    return Measured(values, there, np.where(there, sigma, np.nan))


def resolution(values: Array) -> Array:
    """Step (k,) of the converter of channels (n, k): the least difference between two values.

    Without a converter it is next to nothing.
    """
    steps = np.diff(np.sort(values, axis=0), axis=0)
    least = 1e-9 * (np.fmax.reduce(values) - np.fmin.reduce(values))
    step: Array = np.where(steps > least, steps, np.inf).min(axis=0, initial=np.inf)
    return np.where(np.isfinite(step), step, 0.0)


def mesh_table(layout: Layout) -> MeshTable:
    """Kind, side and planet of each mesh of a layout."""
    kind, side, planet = np.indices((len(KINDS), len(SIDES), layout.n_classes)).reshape(3, -1)
    return MeshTable(layout.meshes, kind, side, planet)
