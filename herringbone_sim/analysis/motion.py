"""Mesh phase, relative displacements and velocities of the meshes in a time series."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import AnalysisError, listed

MIN_SAMPLES = 32


@dataclass(frozen=True)
class Motion:
    """Phase and relative displacements of some meshes over time.

    Attributes:
        times: (n,) seconds.
        turns: (n,) mesh phase in cycles, strictly increasing.
        x: (n, k) relative displacements, m.
        v: (n, k) relative velocities, m/s.
        meshes: k names such as ``sp_L``.
        notes: sentences on channels not used and velocities derived from displacements.
    """

    times: Array
    turns: Array
    x: Array
    v: Array
    meshes: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.times)

    @property
    def cycles(self) -> float:
        """Length in mesh cycles."""
        return float(self.turns[-1] - self.turns[0]) if len(self) else 0.0

    @property
    def samples_per_cycle(self) -> float:
        """Mean number of samples per mesh cycle."""
        return (len(self) - 1) / self.cycles if self.cycles else float("nan")

    @property
    def frequency_hz(self) -> float:
        """Mean mesh frequency [Hz]."""
        return self.cycles / float(self.times[-1] - self.times[0])

    def rows(self, start: int, stop: int) -> Motion:
        """Samples start (included) to stop (excluded), as views."""
        cut = slice(start, stop)
        return Motion(
            self.times[cut], self.turns[cut], self.x[cut], self.v[cut], self.meshes, self.notes
        )


def motion_of(series: TimeSeries) -> Motion:
    """Extract phase, displacements and velocities of all meshes with a finite ``x`` channel.

    A mesh without a finite ``v`` channel gets its velocity by central differences. A displacement
    that contains NaN or infinity is not used. Notes of the motion tell both.

    Raises:
        AnalysisError: fewer than 32 samples, no usable phase, or no usable ``x`` channel.
    """
    if len(series) < MIN_SAMPLES:
        raise AnalysisError(
            f"an analysis needs at least {MIN_SAMPLES} samples, got {len(series)}: record longer"
        )
    turns = _turns(series)
    recorded = [name[2:] for name in series.names if name.startswith("x_")]
    finite = tuple(mesh for mesh in recorded if np.isfinite(series[f"x_{mesh}"]).all())
    if not finite:
        raise AnalysisError(_why_no_motion(series, recorded))
    rates = {mesh: _recorded_rate(series, mesh) for mesh in finite}
    x = series.columns(tuple(f"x_{mesh}" for mesh in finite))
    return Motion(
        series.times, turns, x, _rates(series, x, rates), finite, _notes(recorded, finite, rates)
    )


def with_phase(series: TimeSeries, frequency_hz: float) -> TimeSeries:
    """Add a phase channel that rises from 0 at a constant mesh frequency to a time series."""
    phase = 2 * np.pi * frequency_hz * (series.times - series.times[0])
    return TimeSeries(
        series.times, np.column_stack((series.data, phase)), (*series.names, "phase")
    )


def _turns(series: TimeSeries) -> Array:
    """Mesh phase (n,) in cycles; AnalysisError unless it is finite and strictly increasing."""
    if "phase" not in series:
        raise AnalysisError(
            "no channel 'phase', and nothing tells the mesh cycles without it: record the phase, "
            f"or give the mesh frequency (--mesh-frequency); channels: {listed(series.names)}"
        )
    turns = series["phase"] / (2 * np.pi)
    steps = np.diff(turns)
    if not np.all(steps > 0):
        at = int(np.argmax(~(steps > 0)))
        raise AnalysisError(
            "phase must be finite and increase from sample to sample, got "
            f"{series['phase'][at]:.6g} rad then {series['phase'][at + 1]:.6g} rad at "
            f"t = {series.times[at + 1]:.6g} s: unwrap the phase, or cut the recording there"
        )
    return turns


def _why_no_motion(series: TimeSeries, meshes: list[str]) -> str:
    """Error message for a series without a usable displacement."""
    if meshes:
        names = ", ".join(f"x_{mesh}" for mesh in meshes)
        return f"every displacement holds NaN or infinity ({names}): record at least one whole"
    return (
        "no displacement to analyse: at least one channel x_sp..., x_rp... is needed, got "
        f"{listed(series.names)}"
    )


def _recorded_rate(series: TimeSeries, mesh: str) -> Array | None:
    """Velocity channel (n,) of a mesh; None if it is missing or not finite."""
    name = f"v_{mesh}"
    if name not in series or not np.isfinite(series[name]).all():
        return None
    return series[name]


def _rates(series: TimeSeries, x: Array, rates: dict[str, Array | None]) -> Array:
    """Velocities (n, k): recorded, else differentiated from the displacements x (n, k)."""
    columns = [
        rate if rate is not None else np.gradient(x[:, column], series.times)
        for column, rate in enumerate(rates.values())
    ]
    return np.stack(columns, axis=1)


def _notes(
    meshes: list[str], finite: tuple[str, ...], rates: dict[str, Array | None]
) -> tuple[str, ...]:
    """Sentences on displacements that are not used and velocities derived by differences."""
    broken = [f"x_{mesh}" for mesh in meshes if mesh not in finite]
    derived = [f"v_{mesh}" for mesh, rate in rates.items() if rate is None]
    notes = []
    if broken:
        notes.append(f"left out, as they hold NaN or infinity: {listed(broken)}")
    if derived:
        notes.append(f"worked out from displacements by differences: {listed(derived)}")
    return tuple(notes)
