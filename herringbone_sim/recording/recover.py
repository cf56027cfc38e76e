"""Recover a run that was cut off: all intact data, with a new index and ``metadata.yaml``.

After every step the run can be read, or recovered again: a new file is completed beside the old
file, which gets a second name if the new file lacks some of its data, and then replaces it.
"""

from __future__ import annotations

import filecmp
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from herringbone_sim.errors import RecordingError, listed
from herringbone_sim.recording.bag import METADATA_NAME, split_metadata, write_metadata
from herringbone_sim.recording.files import (
    NUMBERED,
    BagInformation,
    bag_files,
    bag_information,
    check_file,
    natural,
)
from herringbone_sim.recording.guarded_file import is_written
from herringbone_sim.recording.rebuild import Survey, rebuild, survey
from herringbone_sim.recording.run_folder import remedy


@dataclass(frozen=True)
class RecoveryReport:
    """Result of a recovery.

    Attributes:
        paths: the .mcap files of the recovered run, in order.
        was_complete: whether all files were finished before.
        changed: whether anything was written.
        messages, samples: numbers of intact messages, and of readable samples.
        span_s: times of the first and last readable sample [s]; None without samples.
        bytes_dropped: length of the incomplete records at the ends of the files.
        chunks_dropped: number of damaged records, mainly chunks, left out.
        originals: files as they were before: with the ending ``.cut`` where data were left out;
            all source files if the run was recovered into another folder.
        missing: names of files that ``metadata.yaml`` lists and that do not exist.
        notes: a sentence on each irregularity.
    """

    paths: tuple[Path, ...]
    was_complete: bool
    changed: bool
    messages: int
    samples: int
    span_s: tuple[float, float] | None
    bytes_dropped: int
    chunks_dropped: int
    originals: tuple[Path, ...]
    missing: tuple[str, ...]
    notes: tuple[str, ...]


def recover(path: Path | str, out: Path | str | None = None) -> RecoveryReport:
    """Rebuild index, summary and ``metadata.yaml`` of a run that was not finished.

    Each new file replaces the old file atomically. The old file remains as ``NAME_0.mcap.cut`` if
    anything in it had to be left out. Finished files are not changed; a missing or wrong
    ``metadata.yaml`` is replaced, with the names of missing files preserved. A recovery that was
    killed can be repeated.

    Args:
        path: run folder, or a .mcap file in it.
        out: folder to create for the recovered run, leaving the original unchanged; None to
            recover in place.

    Raises:
        RecordingError: there is nothing to recover, the folder has files of several runs, ``out``
            exists, the run is still being recorded (without ``out``), or the disk fails; files not
            recovered by then are unchanged.
    """
    files = _files(Path(path))
    if out is None:
        _check_ended(files)
    surveys = [survey(file) for file in files]
    information = bag_information(surveys[0].file.parent)
    report = _report(surveys, information)
    try:
        if out is not None:
            return _recover_elsewhere(surveys, Path(os.path.abspath(out)), report)
        return _recover_in_place(surveys, report, information)
    except RecordingError:
        raise
    except (OSError, ValueError) as error:
        advice = remedy(error) if isinstance(error, OSError) else "name another run"
        raise RecordingError(
            f"can't write the recovered run of {surveys[0].file} ({error}): what was not "
            f"recovered is as it was; {advice}, or choose another folder with --out"
        ) from error


def _files(path: Path) -> list[Path]:
    """Return all files of the run, also if ``path`` is one: they share ``metadata.yaml``."""
    alone = check_file(path)
    if alone and path.suffix != ".mcap":
        return [path]
    folder = path.parent if alone else path
    files = bag_files(folder)
    runs = {numbered[1] if (numbered := NUMBERED.fullmatch(file.name)) else file for file in files}
    if len(runs) > 1 or (alone and path.name not in {file.name for file in files}):
        raise RecordingError(
            f"the files of a run must be NAME_0.mcap, NAME_1.mcap, ... in a folder of its own, "
            f"{folder} has {listed([file.name for file in files])}: move the cut one into a "
            "folder of its own"
        )
    return files


def _check_ended(files: Sequence[Path]) -> None:
    """Raise RecordingError if a file of the run, or its next one, is still being written."""
    for file in (*files, *_next(files[-1])):
        if is_written(file):
            raise RecordingError(
                f"{file} is being recorded: stop the recording first, which finishes it, or "
                "recover what is there so far into a new folder with --out"
            )


def _report(surveys: Sequence[Survey], information: BagInformation) -> RecoveryReport:
    """Make the report as it is before anything is written."""
    spans = [file_survey.span_s for file_survey in surveys if file_survey.span_s]
    cut = [file_survey.scan for file_survey in surveys if not file_survey.scan.complete]
    return RecoveryReport(
        paths=tuple(file_survey.file for file_survey in surveys),
        was_complete=not cut,
        changed=False,
        messages=sum(file_survey.messages for file_survey in surveys),
        samples=sum(file_survey.samples for file_survey in surveys),
        span_s=(spans[0][0], spans[-1][1]) if spans else None,
        bytes_dropped=sum(scan.size - scan.intact_bytes for scan in cut),
        chunks_dropped=sum(file_survey.scan.damaged for file_survey in surveys),
        originals=(),
        missing=information.missing,
        notes=(
            *(note for file_survey in surveys for note in file_survey.notes),
            *information.file_notes,
        ),
    )


def _recover_elsewhere(
    surveys: Sequence[Survey], out: Path, report: RecoveryReport
) -> RecoveryReport:
    """Write the recovered run into a new folder; return the final report."""
    if os.path.lexists(out):
        raise RecordingError(f"the folder for the recovered run must be new, {out} exists")
    part = out.with_name(f"{out.name}.part")
    _sweep_folder(part, out.name)
    part.mkdir(parents=True)
    names, missing = _new_names(surveys, report.missing, out.name)
    try:
        tallies = [
            rebuild(file_survey, part / name, name)
            for file_survey, name in zip(surveys, names, strict=True)
        ]
        tallies_by_file = dict(zip(names, tallies, strict=True))
        write_metadata(part, split_metadata(tallies_by_file, missing))
        part.rename(out)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise
    paths = tuple(out / name for name in names)
    return replace(report, paths=paths, changed=True, originals=report.paths)


def _new_names(
    surveys: Sequence[Survey], missing: Sequence[str], run: str
) -> tuple[list[str], list[str]]:
    """Return names that the files and the missing files get in a run of another name.

    Files are numbered in reading order; where some are missing, in the order of their numbers.
    """
    if not missing:
        return [f"{run}_{number}.mcap" for number in range(len(surveys))], []
    present = [file_survey.file.name for file_survey in surveys]
    places = {old: place for place, old in enumerate(sorted([*present, *missing], key=natural))}
    names, lost = ([f"{run}_{places[old]}.mcap" for old in part] for part in (present, missing))
    return names, lost


def _sweep_folder(part: Path, name: str) -> None:
    """Remove the folder of a killed recovery; RecordingError if it holds anything else."""
    if not os.path.lexists(part):
        return
    present = {file.name for file in part.iterdir()} if part.is_dir() else {part.name}
    strange = [
        file_name
        for file_name in present - {METADATA_NAME, f"{METADATA_NAME}.part"}
        if (numbered := NUMBERED.fullmatch(file_name)) is None or numbered[1] != name
    ]
    if strange or part.is_symlink():
        raise RecordingError(
            f"{part} is in the way and not of a recovery before this one: move it away, or choose "
            "another folder with --out"
        )
    shutil.rmtree(part)


def _recover_in_place(
    surveys: Sequence[Survey], report: RecoveryReport, information: BagInformation
) -> RecoveryReport:
    """Replace unfinished files by recovered files in the run folder; return the final report.

    A file from which data are left out is kept as ``NAME.cut``. A missing or wrong
    ``metadata.yaml`` is written anew; remains of a killed recovery are removed.

    Raises:
        RecordingError: another file has the name ``NAME.cut``; nothing is changed then.
        OSError, ValueError: a file can't be written; those not replaced yet are unchanged.
    """
    cut = [file_survey for file_survey in surveys if not file_survey.scan.complete]
    for file_survey in cut:
        _check_original_name(file_survey)
    for file_survey in surveys:
        for half in ("part", "cut.part"):
            _beside(file_survey.file, half).unlink(missing_ok=True)
    for following in _next(surveys[-1].file):
        following.unlink(missing_ok=True)
    originals = []
    for file_survey in cut:
        part = _beside(file_survey.file, "part")
        rebuild(file_survey, part, file_survey.file.name)
        if file_survey.loses_data:
            originals.append(_keep_original(file_survey.file))
        part.replace(file_survey.file)
    written = _mend_metadata(surveys, information)
    notes = report.notes
    if written and not cut:
        notes = (*notes, f"{METADATA_NAME} was missing or wrong and is written anew")
    return replace(report, changed=bool(cut) or written, originals=tuple(originals), notes=notes)


def _next(last: Path) -> list[Path]:
    """Return ``[NAME_3.mcap.part]``, begun after ``NAME_2.mcap``; [] for an unnumbered file."""
    numbered = NUMBERED.fullmatch(last.name)
    if not numbered:
        return []
    return [_beside(last.with_name(f"{numbered[1]}_{int(numbered[2]) + 1}.mcap"), "part")]


def _beside(file: Path, ending: str) -> Path:
    """Return the path with an ending appended to the file name."""
    return file.with_name(f"{file.name}.{ending}")


def _check_original_name(file_survey: Survey) -> None:
    """Raise RecordingError if another file has the name that the original will get."""
    file, original = file_survey.file, _beside(file_survey.file, "cut")
    if file_survey.loses_data and os.path.lexists(original) and not _is_original(file, original):
        raise RecordingError(
            f"{original} exists, from a recovery before this one: move it away, then recover again"
        )


def _is_original(file: Path, original: Path) -> bool:
    """Whether ``original`` is a link to ``file`` or a copy, made by a recovery that was killed."""
    return original.is_file() and (
        file.samefile(original) or filecmp.cmp(file, original, shallow=False)
    )


def _keep_original(file: Path) -> Path:
    """Link a cut file to ``NAME.cut``, or copy it where links are impossible; return that path."""
    original = _beside(file, "cut")
    if _is_original(file, original):
        return original
    try:
        os.link(file, original)
    except OSError:
        copy = _beside(original, "part")
        with file.open("rb") as source, copy.open("wb") as target:
            shutil.copyfileobj(source, target)
            target.flush()
            os.fsync(target.fileno())
        copy.replace(original)
    return original


def _mend_metadata(surveys: Sequence[Survey], information: BagInformation) -> bool:
    """Write ``metadata.yaml`` if it does not describe the files; return whether it was written."""
    tallies_by_file = {
        file_survey.file.name: tuple(file_survey.tallies.values()) for file_survey in surveys
    }
    folder = surveys[0].file.parent
    if information.up_to_date and information.n_messages == sum(
        file_survey.messages for file_survey in surveys
    ):
        return False
    write_metadata(folder, split_metadata(tallies_by_file, information.missing))
    return True
