"""Recover a run that was cut off: all that is whole, with a new index and ``metadata.yaml``.

Every step leaves a run that can be read, or recovered again: a new file is written whole beside
the old one, which gets a second name before the new one takes its place.
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
)
from herringbone_sim.recording.rebuild import Survey, rebuild, survey
from herringbone_sim.recording.run_folder import remedy
from herringbone_sim.recording.stream import is_written


@dataclass(frozen=True)
class RecoveryReport:
    """What was found in a run and what became of it.

    Attributes:
        paths: the .mcap files that are good now, in order.
        was_complete: whether all files were finished already; then they were left as they are.
        changed: whether anything was written at all.
        messages: messages kept.
        samples: samples kept.
        span_s: times of the first and last sample kept [s]; None without samples.
        bytes_dropped: length of the tails that were no whole record.
        chunks_dropped: damaged chunks left out.
        originals: where cut files were kept; none where nothing was left out.
        missing: names of files that ``metadata.yaml`` tells of and are not there.
        notes: a sentence on everything odd.
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

    Each new file replaces the old one at once when it is whole. The old one stays as
    ``NAME_0.mcap.cut`` if anything in it had to be left out. A finished file is left as it is; a
    missing or wrong ``metadata.yaml`` is written; it keeps the names of files that are not there.
    Killed at any instant, it can be called again.

    Args:
        path: run folder, or a .mcap file of it.
        out: folder to create for the recovered run; the original is then left alone.

    Raises:
        RecordingError: nothing to recover, files of several runs in the folder, ``out`` exists,
            without ``out`` a run that is still being recorded, or the disk fails; what was not
            recovered is then as it was.
    """
    files = _files(Path(path))
    if out is None:
        _check_ended(files)
    surveys = [survey(file) for file in files]
    told = bag_information(surveys[0].file.parent)
    report = _report(surveys, told)
    try:
        if out is not None:
            return _recover_elsewhere(surveys, Path(os.path.abspath(out)), report)
        return _recover_in_place(surveys, report, told)
    except RecordingError:
        raise
    except (OSError, ValueError) as error:
        advice = remedy(error) if isinstance(error, OSError) else "name another run"
        raise RecordingError(
            f"can't write the recovered run of {surveys[0].file} ({error}): what was not "
            f"recovered is as it was; {advice}, or choose another folder with --out"
        ) from error


def _files(path: Path) -> list[Path]:
    """Those of the run, also where one of them is named, as they share ``metadata.yaml``."""
    alone = check_file(path)
    if alone and path.suffix != ".mcap":
        return [path]
    folder = path.parent if alone else path
    files = bag_files(folder)
    runs = {found[1] if (found := NUMBERED.fullmatch(file.name)) else file for file in files}
    if len(runs) > 1 or (alone and path.name not in {file.name for file in files}):
        raise RecordingError(
            f"the files of a run must be NAME_0.mcap, NAME_1.mcap, ... in a folder of its own, "
            f"{folder} has {listed([file.name for file in files])}: move the cut one into a "
            "folder of its own"
        )
    return files


def _check_ended(files: Sequence[Path]) -> None:
    """RecordingError where a file of the run, or its next one, is still being written."""
    for file in (*files, *_next(files[-1])):
        if is_written(file):
            raise RecordingError(
                f"{file} is being recorded: stop the recording first, which finishes it, or "
                "recover what is there so far into a new folder with --out"
            )


def _report(surveys: Sequence[Survey], told: BagInformation) -> RecoveryReport:
    spans = [one.span_s for one in surveys if one.span_s]
    cut = [one.scan for one in surveys if not one.scan.complete]
    return RecoveryReport(
        paths=tuple(one.file for one in surveys),
        was_complete=not cut,
        changed=False,
        messages=sum(one.messages for one in surveys),
        samples=sum(one.samples for one in surveys),
        span_s=(spans[0][0], spans[-1][1]) if spans else None,
        bytes_dropped=sum(scan.size - scan.kept for scan in cut),
        chunks_dropped=sum(one.scan.damaged for one in surveys),
        originals=(),
        missing=told.missing,
        notes=(*(note for one in surveys for note in one.notes), *told.file_notes),
    )


def _recover_elsewhere(
    surveys: Sequence[Survey], out: Path, report: RecoveryReport
) -> RecoveryReport:
    if os.path.lexists(out):
        raise RecordingError(f"the folder for the recovered run must be new, {out} exists")
    part = out.with_name(f"{out.name}.part")
    _sweep_folder(part, out.name)
    part.mkdir(parents=True)
    names = [f"{out.name}_{number}.mcap" for number in range(len(surveys))]
    try:
        tallies = [
            rebuild(one, part / name, name) for one, name in zip(surveys, names, strict=True)
        ]
        held = dict(zip(names, tallies, strict=True))
        write_metadata(part, split_metadata(held, report.missing))
        part.rename(out)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise
    paths = tuple(out / name for name in names)
    return replace(report, paths=paths, changed=True, originals=report.paths)


def _sweep_folder(part: Path, name: str) -> None:
    """Remove what a recovery that was killed left, and nothing else."""
    if not os.path.lexists(part):
        return
    held = {file.name for file in part.iterdir()} if part.is_dir() else {part.name}
    strange = [
        one
        for one in held - {METADATA_NAME, f"{METADATA_NAME}.part"}
        if (numbered := NUMBERED.fullmatch(one)) is None or numbered[1] != name
    ]
    if strange or part.is_symlink():
        raise RecordingError(
            f"{part} is in the way and not of a recovery before this one: move it away, or choose "
            "another folder with --out"
        )
    shutil.rmtree(part)


def _recover_in_place(
    surveys: Sequence[Survey], report: RecoveryReport, told: BagInformation
) -> RecoveryReport:
    cut = [one for one in surveys if not one.scan.complete]
    for one in cut:
        _check_kept(one)
    for one in surveys:
        for half in ("part", "cut.part"):
            _beside(one.file, half).unlink(missing_ok=True)
    for following in _next(surveys[-1].file):
        following.unlink(missing_ok=True)
    originals = []
    for one in cut:
        part = _beside(one.file, "part")
        rebuild(one, part, one.file.name)
        if one.lost:
            originals.append(_keep(one.file))
        part.replace(one.file)
    written = _mend_metadata(surveys, told)
    notes = report.notes
    if written and not cut:
        notes = (*notes, f"{METADATA_NAME} was missing or wrong and is written anew")
    return replace(report, changed=bool(cut) or written, originals=tuple(originals), notes=notes)


def _next(last: Path) -> list[Path]:
    """What there is of the next file of a run while it is opened, if its files have numbers."""
    numbered = NUMBERED.fullmatch(last.name)
    if not numbered:
        return []
    return [_beside(last.with_name(f"{numbered[1]}_{int(numbered[2]) + 1}.mcap"), "part")]


def _beside(file: Path, ending: str) -> Path:
    return file.with_name(f"{file.name}.{ending}")


def _check_kept(one: Survey) -> None:
    kept = _beside(one.file, "cut")
    if one.lost and os.path.lexists(kept) and not _is_kept(one.file, kept):
        raise RecordingError(
            f"{kept} exists, from a recovery before this one: move it away, then recover again"
        )


def _is_kept(file: Path, kept: Path) -> bool:
    """Whether the second name of a file is there already: a recovery was killed behind it."""
    return kept.is_file() and (file.samefile(kept) or filecmp.cmp(file, kept, shallow=False))


def _keep(file: Path) -> Path:
    """Second name for the cut file, which never lacks one; a copy where there are no links."""
    kept = _beside(file, "cut")
    if _is_kept(file, kept):
        return kept
    try:
        os.link(file, kept)
    except OSError:
        copy = _beside(kept, "part")
        with file.open("rb") as source, copy.open("wb") as target:
            shutil.copyfileobj(source, target)
            target.flush()
            os.fsync(target.fileno())
        copy.replace(kept)
    return kept


def _mend_metadata(surveys: Sequence[Survey], told: BagInformation) -> bool:
    """Write ``metadata.yaml`` where it does not say what the files hold; whether it was."""
    held = {one.file.name: tuple(one.tallies.values()) for one in surveys}
    folder = surveys[0].file.parent
    if told.told and told.n_messages == sum(one.messages for one in surveys):
        return False
    write_metadata(folder, split_metadata(held, told.missing))
    return True
