"""Import a campaign: read the files of a spec, convert to SI and one clock, write bags."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import MEANINGS, describe
from herringbone_sim.core.model import build
from herringbone_sim.errors import HerringboneError, RecordingError
from herringbone_sim.recording.campaign import write_campaign
from herringbone_sim.recording.importing.clock import ClockGroup, clock_groups, first_date, merged
from herringbone_sim.recording.importing.columns import Columns, read_columns
from herringbone_sim.recording.importing.ranges import remarks
from herringbone_sim.recording.importing.spec import (
    ChannelSpec,
    FileSpec,
    ImportSpec,
    RunSpec,
    recorded_name,
)
from herringbone_sim.recording.importing.turns import span, unwrapped, with_turns
from herringbone_sim.recording.importing.units import si_unit
from herringbone_sim.recording.parameter_file import save_parameters
from herringbone_sim.recording.writer import RunWriter

Say = Callable[[str], None]
NOMINAL = "nominal.yaml"


@dataclass(frozen=True)
class ImportedChannel:
    """Source, rate and range of an imported channel.

    Attributes:
        channel, unit: name and SI unit in the written run.
        source: imported file, column and unit.
        rate_hz: sample rate of the imported file [Hz].
        low, high: range of the finite values [SI]; NaN without any.
    """

    channel: str
    unit: str
    source: str
    rate_hz: float
    low: float
    high: float


@dataclass(frozen=True)
class ImportedRun:
    """Summary of an imported run.

    Attributes:
        name, role: name and role of the run.
        samples: number of samples.
        rate_hz, cycles: sample rate of the run [Hz]; number of mesh cycles recorded.
        taken: the imported channels.
        left: (channel or column, reason) for each that was not imported.
        remarks: sentences on samples cut off or interpolated, and on values that the data sheet
            does not explain.
    """

    name: str
    role: str
    samples: int
    rate_hz: float
    cycles: float
    taken: tuple[ImportedChannel, ...]
    left: tuple[tuple[str, str], ...]
    remarks: tuple[str, ...]


def import_campaign(
    spec: ImportSpec, out: Path, say: Say = lambda text: None
) -> tuple[ImportedRun, ...]:
    """Import a spec: write runs, ``campaign.yaml`` and ``nominal.yaml`` into a new folder.

    Args:
        spec: the parsed specification.
        out: folder to write, which must not exist, or be empty.
        say: called with the name of each run before it is imported.

    Returns:
        A summary of each run.

    Raises:
        RecordingError: the folder is in use, or a file can't be read or contradicts the spec; then
            nothing is written.
    """
    with _new_folder(out) as part:
        imported = []
        for run in spec.runs:
            say(run.name)
            try:
                imported.append(_import_run(spec, run, part))
            except HerringboneError as error:
                raise RecordingError(f"{run.name}: {error}") from None
        entries = [{"path": r.name, **r.point, "role": r.role} for r in spec.runs]
        write_campaign(part, spec.rig, entries, spec.noise, spec.sensors)
        save_parameters(part / NOMINAL, spec.nominal, f"The nominal gear of {spec.rig}.")
    return tuple(imported)


@contextmanager
def _new_folder(out: Path) -> Iterator[Path]:
    """Context manager: a temporary folder, moved to ``out`` on success and removed otherwise."""
    out = out.resolve()
    there = next(folder for folder in out.parents if folder.exists())
    part = there / f".{out.name}.part"
    try:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise RecordingError(
                f"--out must be a new folder, got {out}: an import never overwrites; name another"
            )
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir()
        yield part
        if not out.exists():
            out.parent.mkdir(parents=True, exist_ok=True)
            part.replace(out)
        else:
            for entry in list(part.iterdir()):  # the folder stays, as it may be the working one
                entry.replace(out / entry.name)
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError(
            f"can't write {out} ({error.strerror or error}): choose another --out"
        ) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _import_run(spec: ImportSpec, run: RunSpec, folder: Path) -> ImportedRun:
    """Convert and write one run; return its summary."""
    read = [(file, _columns(file)) for file in run.files]
    dates = [date for file, columns in read if (date := first_date(file, columns)) is not None]
    zero = min(dates) if dates else None
    groups = [g for file, columns in read for g in clock_groups(file, columns, zero)]
    parts = [_unwrapped_angles(group) for group in groups]
    on_one = merged(parts)
    model = build(spec.nominal.changed(run.point))
    values = with_turns(model, spec.shaft, spec.phase_offset, on_one.times, on_one.values)
    if "phase" not in values:
        raise RecordingError(
            f"the mesh phase was left: {on_one.left.get(spec.shaft or 'phase')}, or put its file "
            "first"
        )
    _write(folder, run.name, spec.rig, {"t": on_one.times, **values})
    rates = {name: group.rate_hz for group in parts for name in group.values}
    times = on_one.times
    return ImportedRun(
        run.name,
        run.role,
        len(times),
        float((len(times) - 1) / times[-1]),
        span(values["phase"]) / (2.0 * np.pi),
        _imported(spec, run, values, rates),
        (*on_one.left.items(), *_unnamed(read)),
        (*on_one.notes, *_wrapped_phase(groups), *remarks(model, times, values)),
    )


def _columns(file: FileSpec) -> Columns:
    """Read the columns of a file that its channels and its clock need."""
    column_names = [channel.column for channel in file.channels]
    column_names += [file.time.column] if file.time.column else []
    return read_columns(file.path, file.kind, list(dict.fromkeys(column_names)), file.options)


def _unwrapped_angles(stream: ClockGroup) -> ClockGroup:
    """Return the group with unwrapped phases and angles, which can be interpolated."""
    values = {
        name: unwrapped(column) if name == "phase" or name.startswith("angle_") else column
        for name, column in stream.values.items()
    }
    return ClockGroup(stream.label, stream.times, values, stream.resample)


def _wrapped_phase(groups: Sequence[ClockGroup]) -> list[str]:
    """Return a sentence if a file has the mesh phase modulo 2 pi, which ``unwrapped`` undoes."""
    phases = [group.values["phase"] for group in groups if "phase" in group.values]
    if not any(unwrapped(p) is not p and span(p) <= 2.0 * np.pi for p in phases):
        return []
    return [
        "the mesh phase starts anew at every turn and was unwrapped: events of single teeth and "
        "run-out need it counted on, from the same teeth in all runs"
    ]


def _unnamed(read: Sequence[tuple[FileSpec, Columns]]) -> list[tuple[str, str]]:
    """Return (file and column, reason) of each column that the spec does not use."""
    named: dict[Path, set[str]] = {}
    for file, _ in read:
        used = {channel.column for channel in file.channels} | {file.time.column or ""}
        named.setdefault(file.path, set()).update(used)
    names_by_path = {file.path: columns.names for file, columns in read}
    return [
        (f"{path.name}: {name}", "the spec does not name it")
        for path, names in names_by_path.items()
        for name in names
        if name not in named[path]
    ]


def _imported(
    spec: ImportSpec, run: RunSpec, values: Mapping[str, Array], rates: Mapping[str, float]
) -> tuple[ImportedChannel, ...]:
    """Return a summary of each channel of a run."""
    sources: dict[str, tuple[FileSpec, ChannelSpec]] = {
        recorded_name(source.name): (file, source)
        for file in run.files
        for source in file.channels
    }
    if spec.shaft:
        sources["phase"] = sources[recorded_name(spec.shaft)]
    channels = []
    for channel, samples in values.items():
        file, source = sources[channel]
        known = samples[np.isfinite(samples)]
        low, high = (float(f(known)) if len(known) else float("nan") for f in (np.min, np.max))
        origin = f"{file.path.name}: {source.column} [{source.unit}]"
        rate = rates[source.name]
        channels.append(ImportedChannel(channel, si_unit(channel), origin, rate, low, high))
    return tuple(channels)


def _write(folder: Path, name: str, rig: str, columns: Mapping[str, Array]) -> None:
    """Write columns (n,) of a run as the bag ``name`` in a folder."""
    names, data = tuple(columns), np.column_stack(list(columns.values()))
    content = {"channels": [_described(channel) for channel in names], "source": rig}
    writer = RunWriter.create(folder, name, "/rig", content, names, 0)
    writer.write_samples(data)
    writer.close()


def _described(channel: str) -> dict[str, str]:
    """Return the entry of a channel in the ``channels`` message."""
    if channel in MEANINGS or channel.split("_")[0] in MEANINGS:
        return describe(channel)
    return {"name": channel, "unit": si_unit(channel), "meaning": "as docs/importing.md has it"}
