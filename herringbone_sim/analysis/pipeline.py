"""Analysis of a run: a result per segment with section, period, exponent, spectrum, contact.

Over 300 lines: all steps of ``analyze_segment`` stand in their order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from herringbone_sim.analysis.contact import ContactShares, contact_shares
from herringbone_sim.analysis.lyapunov import Exponent, largest_exponent, no_exponent
from herringbone_sim.analysis.motion import Motion, motion_of
from herringbone_sim.analysis.noise import noise_floor
from herringbone_sim.analysis.periods import MAX_PERIOD, Period, find_period
from herringbone_sim.analysis.sections import Section, section_noise, stroboscopic_section
from herringbone_sim.analysis.segments import Change, Segment, cut
from herringbone_sim.analysis.spectra import (
    Line,
    Spectrum,
    amplitude_spectrum,
    lines,
    share_off_lines,
)
from herringbone_sim.analysis.transients import settling_cycles
from herringbone_sim.arrays import Array
from herringbone_sim.core.timeseries import TimeSeries

MIN_CYCLES = 6
RESOLVED_NOISE = 4e-3  # of the RMS; smaller estimated noise counts as none
WIDE_REACH = 0.12  # Exponent.reach above which a note says that the exponent is too low


@dataclass(frozen=True)
class Options:
    """Options of the user for the analysis of a run.

    Attributes:
        transient_cycles: cycles dropped at the start of each segment; None = detected.
        noise_share: RMS of the measurement noise as a fraction of the RMS of each channel; None =
            estimated from the top of the spectrum.
        max_period: largest period looked for, mesh cycles.
    """

    transient_cycles: int | None = None
    noise_share: float | None = None
    max_period: int = MAX_PERIOD


@dataclass(frozen=True)
class GearData:
    """Data of the gear that the samples do not contain.

    Attributes:
        b_c_m: displacement scale, m; None if unknown.
        omega_n: natural frequency, rad/s; None if unknown.
        base: parameters at the start of the run, by name; used where they have no channel.
        half_backlash_m: maps an operating point to b' of ``sp`` and ``rp`` in m.
        model_exponent: maps an operating point and a section (whose first point is the initial
            state) to the largest exponent of the model per tau and its standard error.
    """

    b_c_m: float | None = None
    omega_n: float | None = None
    base: Mapping[str, float] = field(default_factory=dict)
    half_backlash_m: Callable[[Mapping[str, float]], Mapping[str, float] | None] | None = None
    model_exponent: Callable[[Mapping[str, float], Section], tuple[float, float]] | None = None


@dataclass(frozen=True)
class SegmentResult:
    """Results of one segment.

    Attributes:
        number: 1, 2, ... within the run.
        span_s: times of its first and last sample.
        segment: rows, operating point, length.
        motion: its samples without the transient.
        section: its stroboscopic points without the transient.
        dropped_cycles: cycles dropped as transient.
        noise: RMS noise of the section points over all coordinates, in units of the scale of the
            motion.
        period: of the section points, in mesh cycles.
        exponent: largest Lyapunov exponent from the section points, per mesh cycle; NaN with a
            reason.
        model_exponent: of the nominal model, per mesh cycle, and its standard error; NaN if
            unknown.
        spectrum: of the displacements; None if there are too few cycles.
        lines: its amplitudes [m] at the mesh orders h / n of all meshes, n the period (1 if there
            is none).
        off_lines: (k,) fraction of the spectral power of each mesh off these lines; empty without
            a spectrum.
        half_backlash_m: b' of ``sp`` and ``rp`` in m; None if unknown.
        contact: fractions of time in each contact, of every mesh.
        cycles_per_tau: Omega / 2 pi, NaN if omega_n is unknown.
        notes: sentences on how far the results can be trusted.
    """

    number: int
    span_s: tuple[float, float]
    segment: Segment
    motion: Motion
    section: Section
    dropped_cycles: int
    noise: float
    period: Period
    exponent: Exponent
    model_exponent: tuple[float, float]
    spectrum: Spectrum | None
    lines: tuple[Line, ...]
    off_lines: Array
    half_backlash_m: Mapping[str, float] | None
    contact: tuple[ContactShares, ...]
    cycles_per_tau: float
    notes: tuple[str, ...]

    @property
    def label(self) -> str:
        """``P2``, ``chaotic`` (aperiodic, exponent above 0), ``aperiodic``, ``ramp`` or ``-``."""
        chaotic = self.period.value == 0 and self.exponent.low > 0
        return "ramp" if self.segment.ramp else "chaotic" if chaotic else self.period.label


def analyze_series(
    series: TimeSeries,
    changes: Sequence[Change] = (),
    options: Options | None = None,
    gear: GearData | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[SegmentResult]:
    """Cut a run at its parameter changes and analyse each segment.

    Args:
        series: the run, channels as in ``core.layout``; ``phase`` and one ``x`` are required.
        changes: (time in s, new values) of parameters that have no channel.
        options: of the user.
        gear: data of the gear; without it, backlash and exponent of the model are unknown.
        progress: called with (segments done, number of segments).

    Raises:
        AnalysisError: too short, no phase, no finite displacement.
    """
    options, gear = options or Options(), gear or GearData()
    motion = motion_of(series)
    segments = cut(series, motion, changes, gear.base)
    noise = sample_noise(motion, options.noise_share)
    results = []
    for number, segment in enumerate(segments, start=1):
        results.append(analyze_segment(motion, segment, number, noise, options, gear))
        progress(number, len(segments))
    return results


def analyze_segment(
    motion: Motion,
    segment: Segment,
    number: int,
    sample_noise: tuple[Array, Array],
    options: Options,
    gear: GearData,
) -> SegmentResult:
    """Analyse one segment of a run; a result that can't be computed is NaN or None.

    Args:
        motion: of the whole run.
        segment: rows and operating point.
        number: of the segment within the run.
        sample_noise: RMS noise of the samples, see ``sample_noise``.
        options: see ``Options``.
        gear: see ``GearData``.
    """
    segment_motion = motion.rows(segment.start, segment.stop)
    scales = _scales(segment_motion)
    noise = _noise(segment_motion, sample_noise, scales)
    section = stroboscopic_section(segment_motion)
    dropped, settled = _dropped(_points(section, scales), segment, options)
    section, settled_motion = section.after(dropped), _after(segment_motion, section, dropped)
    points = _points(section, scales)
    period = _period(points, segment, noise, options)
    exponent = _exponent(points, segment, period, noise)
    spectrum = (
        amplitude_spectrum(settled_motion, period.value or 1)
        if settled_motion.cycles >= MIN_CYCLES
        else None
    )
    half_backlash = gear.half_backlash_m(segment.point) if gear.half_backlash_m else None
    rate = (
        segment_motion.frequency_hz / gear.omega_n
        if gear.omega_n and len(segment_motion) > 1
        else float("nan")
    )
    of_model = _model_exponent(segment, section, gear, rate)
    return SegmentResult(
        number=number,
        span_s=(float(segment_motion.times[0]), float(segment_motion.times[-1])),
        segment=segment,
        motion=settled_motion,
        section=section,
        dropped_cycles=dropped,
        noise=noise,
        period=period,
        exponent=exponent,
        model_exponent=of_model,
        spectrum=spectrum,
        lines=lines(spectrum, period.value or 1) if spectrum else (),
        off_lines=share_off_lines(spectrum, period.value or 1) if spectrum else np.zeros(0),
        half_backlash_m=half_backlash,
        contact=contact_shares(settled_motion, half_backlash),
        cycles_per_tau=rate,
        notes=tuple(_notes(settled_motion, segment, settled, noise, period, (exponent, of_model))),
    )


def _scales(motion: Motion) -> tuple[float, float]:
    """Scale of all displacements [m] and of all velocities [m/s]: root of the mean variance."""
    return _scale(motion.x), _scale(motion.v)


def _scale(data: Array) -> float:
    # The variance of a gear at rest is rounding error: do not scale by it.
    least = 1e-9 * float(np.abs(data).max())
    return max(float(np.sqrt(np.mean(np.var(data, axis=0)))), least) or 1.0


def sample_noise(motion: Motion, share: float | None) -> tuple[Array, Array]:
    """RMS noise of the samples, (k,) in m and (k,) in m/s.

    A given fraction ``share`` of the RMS of each channel; estimated if it is None.
    """
    if share is not None:
        return share * _rms(motion.x), share * _rms(motion.v)
    x, v = noise_floor(motion.x), noise_floor(motion.v)
    # Impacts of a noise-free motion also have power at the top of the band.
    weak = not np.any(np.append(x / _rms(motion.x), v / _rms(motion.v)) > RESOLVED_NOISE)
    return (np.zeros_like(x), np.zeros_like(v)) if weak else (x, v)


def _rms(data: Array) -> Array:
    rms: Array = np.sqrt(np.mean(data**2, axis=0))
    return np.maximum(rms, 1e-300)


def _noise(motion: Motion, samples: tuple[Array, Array], scales: tuple[float, float]) -> float:
    """RMS noise of the section points over all coordinates, in units of the scales."""
    rms = section_noise(motion, samples) / np.repeat(scales, len(samples[0]))
    return float(np.sqrt(np.mean(rms**2)))


def _points(section: Section, scales: tuple[float, float]) -> Array:
    """Section points (m, 2 k) of x and v in units of the scales."""
    return np.hstack((section.x / scales[0], section.v / scales[1]))


def _dropped(points: Array, segment: Segment, options: Options) -> tuple[int, bool]:
    """Number of section points of the transient, and whether the motion settled by half-time."""
    if options.transient_cycles is not None:
        return min(options.transient_cycles, max(len(points) - 1, 0)), True
    return (0, True) if segment.ramp else settling_cycles(points)


def _after(motion: Motion, section: Section, dropped: int) -> Motion:
    """Motion from the time of the section point number ``dropped`` on; all if out of range."""
    if not dropped or dropped >= len(section):
        return motion
    return motion.rows(int(np.searchsorted(motion.times, section.times[dropped])), len(motion))


def _period(points: Array, segment: Segment, noise: float, options: Options) -> Period:
    """Period of the section points; none within a ramp."""
    if segment.ramp:
        return Period(None, float("nan"), f"{segment.ramp} moves all the time")
    return find_period(points, noise, options.max_period)


def _exponent(points: Array, segment: Segment, period: Period, noise: float) -> Exponent:
    """Largest exponent from the section points; none within a ramp or for a periodic motion."""
    if segment.ramp:
        return no_exponent(f"{segment.ramp} moves all the time")
    if period.value:
        return no_exponent(f"periodic (P{period.value}): neighbours differ by noise or rounding")
    return largest_exponent(points, np.random.default_rng(0), noise)


def _model_exponent(
    segment: Segment, section: Section, gear: GearData, rate: float
) -> tuple[float, float]:
    """Largest exponent of the model per mesh cycle and its standard error; NaN if unknown.

    Args:
        rate: mesh cycles per tau.
    """
    if gear.model_exponent is None or not np.isfinite(rate) or not len(section):
        return float("nan"), float("nan")
    value, error = gear.model_exponent(segment.point, section)
    return value / rate, error / rate


def _notes(
    motion: Motion,
    segment: Segment,
    settled: bool,
    noise: float,
    period: Period,
    exponents: tuple[Exponent, tuple[float, float]],
) -> Iterator[str]:
    """Yield sentences on what limits the results of a segment.

    Args:
        exponents: from the section points, and of the model with its standard error.
    """
    exponent, (value, error) = exponents
    yield from motion.notes
    if not settled:
        yield "still settling at half-time: the first half was dropped, results are of the rest"
    if segment.ramp:
        yield f"{segment.ramp} moves all the time: points only"
    if noise:
        yield f"noise of {noise:.2%} of the motion's scale taken into account"
    if exponent.reach > WIDE_REACH:
        yield "few points for an exponent from data: it reads low, by more than its interval says"
    if not _sides_alike(motion):
        return
    if period.value and value > 2.0 * error:
        yield (
            f"P{period.value} is transversally unstable: left and right are the same to rounding, "
            f"and what parts them grows by the model's exponent, {value:.3g} a mesh cycle"
        )
    else:
        yield (
            "left and right are the same to rounding: the exponent from data can't see growth "
            "that parts them, the model's can"
        )


def _sides_alike(motion: Motion) -> bool:
    """Whether the displacements of left and right meshes are equal to rounding."""
    left = [i for i, mesh in enumerate(motion.meshes) if mesh.endswith("_L")]
    pairs = [
        (i, motion.meshes.index(motion.meshes[i][:-1] + "R"))
        for i in left
        if motion.meshes[i][:-1] + "R" in motion.meshes
    ]
    scale = float(np.abs(motion.x).max())
    return bool(pairs) and all(
        np.abs(motion.x[:, i] - motion.x[:, j]).max() <= 1e-9 * scale for i, j in pairs
    )
