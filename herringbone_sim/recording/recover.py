"""Recover a run that was cut off: all that is whole, with a new index and ``metadata.yaml``."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.bag import (
    METADATA_NAME,
    Bag,
    Tally,
    bag_metadata,
    write_metadata,
)
from herringbone_sim.recording.load import bag_files, bag_information, is_samples
from herringbone_sim.recording.messages import decode_samples
from herringbone_sim.recording.scan import Found, Scan
from herringbone_sim.recording.writer import RECORD_NAME


@dataclass(frozen=True)
class RecoveryReport:
    """What was found in a run and what became of it.

    Attributes:
        path: the .mcap file that is good now.
        was_complete: whether the file was finished already; then it was left as it is.
        changed: whether anything was written at all.
        messages: messages kept.
        samples: samples kept.
        span_s: times of the first and last sample kept [s]; None without samples.
        bytes_dropped: length of the tail that was no whole record.
        chunks_dropped: damaged chunks left out.
        original: where the cut file was kept; None if nothing of it was left out.
        notes: a sentence on everything odd.
    """

    path: Path
    was_complete: bool
    changed: bool
    messages: int
    samples: int
    span_s: tuple[float, float] | None
    bytes_dropped: int
    chunks_dropped: int
    original: Path | None
    notes: tuple[str, ...]


@dataclass
class _Survey:
    """First pass over the file."""

    scan: Scan
    tallies: dict[str, Tally] = field(default_factory=dict)
    samples: int = 0
    span_s: tuple[float, float] | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def messages(self) -> int:
        return sum(tally.count for tally in self.tallies.values())

    @property
    def lost(self) -> bool:
        scan = self.scan
        return bool(scan.kept < scan.size or scan.damaged or scan.skipped)


def recover(path: Path | str, out: Path | str | None = None) -> RecoveryReport:
    """Rebuild index, summary and ``metadata.yaml`` of a run that was not finished.

    The new file replaces the old one at once when it is whole. The old one stays as
    ``NAME_0.mcap.cut`` if anything in it had to be left out. A finished run is left as it is; only
    a missing or wrong ``metadata.yaml`` is written.

    Args:
        path: run folder or its .mcap file.
        out: folder to create for the recovered run; the original is then left alone.

    Raises:
        RecordingError: nothing to recover, several files in the folder, ``out`` exists, or the
            disk fails; the original is then as it was.
    """
    file = _the_file(Path(path))
    survey = _survey(file)
    report = _report(file, survey)
    try:
        if out is not None:
            return _recover_elsewhere(file, survey, Path(out), report)
        if survey.scan.complete:
            return _mend_metadata(file, survey, report)
        return replace(report, changed=True, original=_recover_in_place(file, survey))
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError(
            f"can't write the recovered run of {file} ({error}): the original is as it was; free "
            "the disk, or choose another folder with --out"
        ) from error


def _the_file(path: Path) -> Path:
    files = bag_files(path)
    beside = bag_files(path.parent) if path.is_file() and path.suffix == ".mcap" else files
    if len(beside) > 1:
        raise RecordingError(
            f"a run must be one .mcap file in a folder of its own, {beside[0].parent} has "
            f"{len(beside)}: move the cut one into a folder of its own"
        )
    return files[0]


def _survey(file: Path) -> _Survey:
    survey = _Survey(Scan(file))
    for found in survey.scan.messages():
        tally = survey.tallies.setdefault(found.topic.name, Tally(found.topic))
        tally.add(found.log_ns)
        if is_samples(found):
            _count_samples(survey, found)
    topics = survey.scan.topics.values()
    survey.tallies = {t.name: survey.tallies.get(t.name, Tally(t)) for t in topics}
    survey.notes += survey.scan.notes
    return survey


def _count_samples(survey: _Survey, found: Found) -> None:
    try:
        names, rows = decode_samples(found.message)
    except RecordingError as error:
        survey.notes.append(f"a message of {found.topic.name} is kept, but can't be read: {error}")
        return
    survey.samples += len(rows)
    if len(rows) and "t" in names:
        times = rows[:, names.index("t")]
        first = survey.span_s[0] if survey.span_s else float(times[0])
        survey.span_s = (first, float(times[-1]))


def _report(file: Path, survey: _Survey) -> RecoveryReport:
    scan = survey.scan
    return RecoveryReport(
        path=file,
        was_complete=scan.complete,
        changed=False,
        messages=survey.messages,
        samples=survey.samples,
        span_s=survey.span_s,
        bytes_dropped=0 if scan.complete else scan.size - scan.kept,
        chunks_dropped=scan.damaged,
        original=None,
        notes=tuple(survey.notes),
    )


def _mend_metadata(file: Path, survey: _Survey, report: RecoveryReport) -> RecoveryReport:
    told, _ = bag_information(file.parent)
    if told.get("message_count") == survey.messages:
        return report
    write_metadata(file.parent, bag_metadata(file.name, survey.tallies.values()))
    note = f"{METADATA_NAME} was missing or wrong and is written anew"
    return replace(report, changed=True, notes=(*report.notes, note))


def _recover_elsewhere(
    file: Path, survey: _Survey, out: Path, report: RecoveryReport
) -> RecoveryReport:
    if out.exists():
        raise RecordingError(f"the folder for the recovered run must be new, {out} exists")
    out.mkdir(parents=True)
    target = out / f"{out.resolve().name}_0.mcap"
    try:
        _rewrite(file, survey, target).replace(target)
    except OSError:
        with suppress(OSError):
            out.rmdir()
        raise
    return replace(report, path=target, changed=True, original=file)


def _recover_in_place(file: Path, survey: _Survey) -> Path | None:
    cut = file.with_name(f"{file.name}.cut")
    if survey.lost and cut.exists():
        raise RecordingError(
            f"{cut} exists, from a recovery before this one: move it away, then recover again"
        )
    part = _rewrite(file, survey, file)
    if survey.lost:
        _keep(file, cut)
    part.replace(file)
    return cut if survey.lost else None


def _keep(file: Path, cut: Path) -> None:
    """Second name for the cut file; where the file system has no links, its only one."""
    try:
        os.link(file, cut)
    except OSError:
        file.rename(cut)


def _rewrite(file: Path, survey: _Survey, target: Path) -> Path:
    """Second pass: copy every whole message into ``target.part``, finished; gives its path."""
    part = target.with_name(f"{target.name}.part")
    part.unlink(missing_ok=True)
    bag = Bag(part)
    try:
        _copy(file, survey, bag)
        for name, content in _records(survey):
            bag.add_record(name, content)
        bag.finish(target.name)
    except BaseException:
        with suppress(OSError):
            bag.abandon()
        part.unlink()
        raise
    return part


def _copy(file: Path, survey: _Survey, bag: Bag) -> None:
    channels = {name: bag.add_topic(tally.topic) for name, tally in survey.tallies.items()}
    for found in Scan(file).messages():
        bag.write(channels[found.topic.name], found.log_ns, found.publish_ns, found.message)
    bag.flush()


def _records(survey: _Survey) -> list[tuple[str, dict[str, str]]]:
    told = [record for record in survey.scan.metadata if record[0] not in ("rosbag2", RECORD_NAME)]
    own = dict(survey.scan.metadata).get(RECORD_NAME, {})
    counted = {"samples_written": str(survey.samples), **own, "recovered": "true"}
    return [*told, (RECORD_NAME, counted)]
