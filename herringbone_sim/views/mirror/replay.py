"""Convert a recording to blocks for the mirror, so that it is drawn like a live run."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import ceil, isfinite, nan, pi

import numpy as np

from herringbone_sim.analysis.motion import Motion, motion_of
from herringbone_sim.analysis.noise import white_noise_rms
from herringbone_sim.analysis.periods import find_period
from herringbone_sim.analysis.sections import stroboscopic_section
from herringbone_sim.arrays import Array, rms
from herringbone_sim.core.layout import Layout
from herringbone_sim.core.model import by_kind, half_backlashes
from herringbone_sim.core.parameters import Parameters, live_names
from herringbone_sim.core.scaling import scales
from herringbone_sim.core.timeseries import TimeSeries, held
from herringbone_sim.errors import AnalysisError, ParameterError
from herringbone_sim.recording.parameter_file import EFFECTS, gear_of_values
from herringbone_sim.recording.reader import Recording
from herringbone_sim.views.mirror.block import MirrorBlock, Scale

MESH = re.compile(r"[xvF]_(?:sp|rp)(\d*)_[LR]")
STATUS_PARAMETERS = ("K", "delta_T", "xi", "T_1", "Omega", "control_phase")
OPERATING = ("K", "delta_T", "T_1")
ROWS_WITHOUT_PHASE = 400
PERIOD_CYCLES = 128


@dataclass(frozen=True)
class Replay:
    """A recording prepared for the mirror.

    Attributes:
        names: channels of the rows; ``t`` is put first if the recording has no channel ``t``.
        rows: (n, c) samples.
        sections: (m, c) samples at phase 0, NaN where a channel can't be had there.
        noise: displacement channel -> RMS of its white noise [m]; empty without sections.
        layout: the meshes.
        gear: parameters of the recorded gear, None if unknown.
        notes: sentences on missing data, with reasons, and on recorded effects.
    """

    names: tuple[str, ...]
    rows: Array
    sections: Array
    noise: Mapping[str, float]
    layout: Layout
    gear: Parameters | None
    notes: tuple[str, ...]

    @property
    def scale(self) -> Scale | None:
        """Units and backlash of the gear, None without one."""
        return scale_of(self.gear) if self.gear else None


def prepare(recording: Recording, nominal: bool = False) -> Replay:
    """Compute section points, layout and gear of a recording.

    Args:
        recording: with any subset of the channels.
        nominal: use the nominal gear if the recording has no parameters.
    """
    samples = _with_held_point(recording.samples)
    gear, notes = gear_of(recording, nominal)
    names = samples.names if "t" in samples else ("t", *samples.names)
    rows = samples.data if "t" in samples else np.column_stack((samples.times, samples.data))
    sections, noise = np.empty((0, len(names))), {}
    try:
        motion = motion_of(samples)
        sections = section_rows(samples, motion, names)
        sizes = white_noise_rms(motion.x)
        noise = {f"x_{m}": float(s) for m, s in zip(motion.meshes, sizes, strict=True)}
    except AnalysisError as error:
        notes += [f"no section points: {error}"]
    return Replay(names, rows, sections, noise, layout_of(names), gear, tuple(notes))


def _with_held_point(samples: TimeSeries) -> TimeSeries:
    """Return samples in which the gaps of ``OPERATING`` channels are ``held``."""
    data = samples.data.copy()
    for column in (samples.names.index(name) for name in OPERATING if name in samples):
        data[:, column] = held(data[:, column])
    return TimeSeries(samples.times, data, samples.names)


def replay_blocks(
    recording: Recording, replay: Replay, burst_cycles: int, max_blocks: int
) -> Iterator[MirrorBlock]:
    """Yield the blocks of a recording in the order of time.

    A block has ``burst_cycles`` mesh cycles, or more if there would be over ``max_blocks`` blocks.
    Of each, the viewer draws all section points, but the samples only of the last
    ``Drawing.burst_cycles``, which should be the same number.
    """
    times = replay.rows[:, replay.names.index("t")]
    end_ns = recording.path.stat().st_mtime_ns if recording.path.exists() else 0
    events = events_of(recording, replay)
    sent = 0
    for start, stop in block_edges(replay, burst_cycles, max_blocks):
        last = float(times[stop - 1])
        until = len(events) if stop == len(times) else sum(t <= last for t, _ in events)
        yield replay_block(
            recording,
            replay,
            slice(start, stop),
            tuple(text for _, text in events[sent:until]),
            end_ns + round((last - float(times[-1])) * 1e9),
        )
        sent = until


def replay_block(
    recording: Recording, replay: Replay, cut: slice, events: tuple[str, ...], wall_ns: int
) -> MirrorBlock:
    """Return the block of the samples in a slice of rows.

    Args:
        recording, replay: the recording, and the same prepared.
        cut: rows of the block.
        events: texts for the log of the viewer.
        wall_ns: wall-clock time of the last row.
    """
    rows = replay.rows[cut]
    at = replay.sections[:, replay.names.index("t")]
    now = replay.names.index("t")
    later = replay.rows[cut.stop, now] if cut.stop < len(replay.rows) else np.inf
    first, behind = np.searchsorted(at, [rows[0, now], later])
    parameters = parameters_at(recording, replay, rows[-1])
    gear = at_temperature(replay.gear, parameters)
    return MirrorBlock(
        wall_ns=wall_ns,
        names=replay.names,
        rows=rows,
        sections=replay.sections[first:behind],
        parameters=parameters,
        events=events,
        regime=regime_at(recording, replay, int(behind)),
        b_half=scale_of(gear).b_half if gear else None,
    )


def block_edges(replay: Replay, burst_cycles: int, max_blocks: int) -> list[tuple[int, int]]:
    """Return the first row of each block and the row after its last; ``max_blocks`` >= 1."""
    count = len(replay.rows)
    phase = replay.rows[:, replay.names.index("phase")] if "phase" in replay.names else np.empty(0)
    known = np.flatnonzero(np.isfinite(phase))
    if known.size:
        turns = (phase[known] - phase[known[0]]) / (2 * pi)
        cycles = max(burst_cycles, ceil(turns[-1] / max_blocks))
        cuts = known[np.searchsorted(turns, np.arange(0, turns[-1], cycles) - 1e-9)]
    else:
        cuts = np.arange(0, count, max(ROWS_WITHOUT_PHASE, ceil(count / max_blocks)))
    edges = np.unique([*cuts.tolist(), 0, count])
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def section_rows(samples: TimeSeries, motion: Motion, names: tuple[str, ...]) -> Array:
    """Return samples (m, c) at mesh phase 0, the Poincaré section, with columns ``names``.

    Phase is the exact multiple of 2 pi; t, x and v are interpolated; K, delta_T and T_1 are those
    of the sample before; all other channels are NaN.
    """
    section = stroboscopic_section(motion)
    before = np.searchsorted(samples.times, section.times + 1e-12, side="right") - 1
    phase: Array = 2 * pi * section.cycles.astype(np.float64)
    known = {"t": section.times, "phase": phase}
    known |= {name: samples[name][before] for name in OPERATING if name in samples}
    for column, mesh in enumerate(section.meshes):
        known |= {f"x_{mesh}": section.x[:, column], f"v_{mesh}": section.v[:, column]}
    nothing = np.full(len(section), np.nan)
    return np.column_stack([known.get(name, nothing) for name in names])


def layout_of(names: tuple[str, ...]) -> Layout:
    """Return the smallest layout that has all meshes among the channel names."""
    numbers = [match.group(1) for name in names if (match := MESH.fullmatch(name))]
    largest = max((int(number) for number in numbers if number), default=0)
    return Layout(max(largest, 1), numbered=largest > 0)


def gear_of(recording: Recording, nominal: bool) -> tuple[Parameters | None, list[str]]:
    """Return the recorded parameters, else nominal ones if ``nominal``, else None; and notes."""
    recorded = recording.channels.parameters
    try:
        if recorded:
            notes = [f"effects: {recorded[EFFECTS]}"] if recorded.get(EFFECTS) else []
            return gear_of_values(recorded)[0], notes
    except ParameterError as error:
        return None, [f"parameters that can't be read, so no scale and no backlash: {error}"]
    if nominal:
        return Parameters(), ["no parameters recorded: scale and backlash of the nominal rig"]
    return None, ["no parameters recorded, so no scale and no backlash (try --nominal)"]


def at_temperature(gear: Parameters | None, parameters: Mapping[str, float]) -> Parameters | None:
    """Return the gear with ``delta_T`` of ``parameters``; unchanged where either is unknown."""
    delta_T = parameters.get("delta_T", nan)
    if gear is None or not isfinite(delta_T):
        return gear
    return gear.changed({"delta_T": delta_T})


def scale_of(gear: Parameters) -> Scale:
    """Return units and half backlash of each kind's first mesh; 0 if Eq. (3) makes it negative."""
    unit = scales(gear)
    try:
        half = half_backlashes(gear, unit)
    except ParameterError:
        half = np.zeros(2)
    return Scale(unit.b_c, by_kind(half), unit.omega_n)


def parameters_at(recording: Recording, replay: Replay, row: Array) -> dict[str, float]:
    """Return the known parameters in force at a row (c,), by name."""
    t = row[replay.names.index("t")]
    values: dict[str, object] = {}
    if replay.gear:
        values = {name: getattr(replay.gear, name) for name in STATUS_PARAMETERS}
    for change in recording.changes:
        if change.t_s <= t:
            values |= {
                name: value for name, value in change.values.items() if name in STATUS_PARAMETERS
            }
    values |= {name: row[replay.names.index(name)] for name in OPERATING if name in replay.names}
    return {n: float(v) for n, v in values.items() if isinstance(v, (int, float))}


def events_of(recording: Recording, replay: Replay) -> list[tuple[float, str]]:
    """Return (time [s], text): name and size of the run, every note and every parameter change."""
    start = float(recording.samples.times[0])
    events = [(start, f"{recording.name}: {len(recording.samples)} samples")]
    events += [(start, note) for note in (*recording.notes, *replay.notes)]
    for change in recording.changes:
        new = {n: v for n, v in change.values.items() if n in live_names()}
        if new and change.t_s > start:
            text = ", ".join(f"{name} = {readable(value)}" for name, value in new.items())
            events.append((change.t_s, f"t = {change.t_s:.6g} s: {text}"))
    return events


def readable(value: object) -> str:
    """Return a parameter as text, numbers with six significant digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def regime_at(recording: Recording, replay: Replay, behind: int) -> str:
    """Return the motion in the last cycles before section point ``behind``, such as ``P2``.

    Only cycles since the last parameter change count; empty if there are none.
    """
    columns = [i for i, name in enumerate(replay.names) if name in replay.noise]
    window = replay.sections[max(0, behind - PERIOD_CYCLES) : behind]
    window = window[constant_since(recording, replay, window) :]
    if not columns or not len(window):
        return ""
    x = window[:, columns]
    size = np.std(replay.rows[:, columns], axis=0).clip(min=1e-12)
    noise = np.array([replay.noise[replay.names[i]] for i in columns]) / size
    return find_period(x / size, rms(noise)).label


def constant_since(recording: Recording, replay: Replay, window: Array) -> int:
    """Return the index of the first of section points (m, c) after the last parameter change."""
    names = [replay.names.index(name) for name in OPERATING if name in replay.names]
    moved = np.flatnonzero(np.any(np.diff(window[:, names], axis=0) != 0, axis=1))
    changes = [change.t_s for change in recording.changes]
    at: Array = window[:, replay.names.index("t")]
    first = int(moved[-1]) + 1 if moved.size else 0
    past = [int(np.searchsorted(at, t)) for t in changes if len(at) and t <= at[-1]]
    return max([first, *past])
