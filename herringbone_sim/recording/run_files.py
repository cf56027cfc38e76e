"""Write the files of a run one after the other; notice if other programs change them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from herringbone_sim.errors import RecordingError, RecordingLostError
from herringbone_sim.recording.bag import (
    METADATA_NAME,
    Bag,
    Tally,
    Topic,
    split_metadata,
    write_metadata,
)
from herringbone_sim.recording.cdr import Buffer
from herringbone_sim.recording.guarded_file import FileIdentity, FileLostError
from herringbone_sim.recording.messages import decode_samples
from herringbone_sim.recording.run_folder import reason, remedy
from herringbone_sim.recording.scan import Scan

RECORD_NAME = "herringbone_sim"


@dataclass
class _Count:
    """Numbers of samples of one file.

    Attributes:
        written: number of samples passed to the writer.
        flushed: number of samples known to be on the disk.
        first_s, last_s: times of the first and last sample written [s]; NaN without samples.
    """

    written: int = 0
    flushed: int = 0
    first_s: float = float("nan")
    last_s: float = float("nan")

    def add(self, n: int, first_s: float, last_s: float) -> None:
        """Count n samples, with the times [s] of the first and the last."""
        self.first_s = self.first_s if self.written else first_s
        self.last_s = last_s
        self.written += n

    def lose(self, flushed: int) -> str:
        """Record that only ``flushed`` samples are left; return a text on the loss."""
        self.flushed = flushed
        gone = self.written - flushed
        span = f"t = {self.first_s:.9g} to {self.last_s:.9g} s" if self.written else "no time"
        return f"{gone} of its {self.written} samples ({span}) are lost"


@dataclass(frozen=True)
class _Finished:
    """Identity, tallies and sample count of a closed file of the run."""

    file: FileIdentity
    tallies: tuple[Tally, ...]
    count: _Count


class RunFiles:
    """Writer of ``NAME_0.mcap``, ``NAME_1.mcap``, ... and ``metadata.yaml`` in a run folder.

    The first disk failure truncates the file after its last complete record and ends the run with
    RecordingError. A file that was deleted, replaced, cut or moved by another program ends it with
    RecordingLostError. Every later call is refused.

    Args:
        path: existing folder of the run.
        topics: topics of each file; the first two are ``channels`` and ``samples``.

    Attributes:
        losses: a sentence on each file that another program deleted, replaced, cut or moved.
        ended: why the run has ended; None before.
    """

    def __init__(self, path: Path, topics: Sequence[Topic]) -> None:
        self.path = path
        self.losses: tuple[str, ...] = ()
        self.ended: str | None = None
        self._topics = topics
        self._counts: list[_Count] = []
        self._finished: list[_Finished] = []

    @property
    def samples_written(self) -> int:
        """Number of samples written so far, to compare with those in the files."""
        return sum(count.written for count in self._counts)

    @property
    def samples_kept(self) -> int:
        """Number of samples known to be on the disk: flushed and not lost since."""
        return sum(count.flushed for count in self._counts)

    @property
    def file_bytes(self) -> int:
        """Size of the current file [bytes], without samples that are still buffered."""
        return self._bag.stream.position

    @property
    def file_first_s(self) -> float:
        """Time [s] of the first sample of the current file; NaN without samples."""
        return self._counts[-1].first_s

    def _open(self, log_ns: int, channels: Buffer) -> None:
        """Open the next file; it gets its final name once the ``channels`` message is on the disk.

        Args:
            log_ns: log time of the message [ns].
            channels: the serialised ``channels`` message.

        Raises:
            OSError: the disk fails, or another program takes the new file away.
        """
        path = self.path / f"{self.path.name}_{len(self._counts)}.mcap"
        part = path.with_name(f"{path.name}.part")
        bag = Bag(part)
        try:
            self._numbers = [bag.add_topic(topic) for topic in self._topics]
            bag.write(self._numbers[0], log_ns, log_ns, channels)
            bag.flush()
            bag.stream.rename(path)
        except BaseException as error:
            bag.stream.close()
            part.unlink(missing_ok=True)
            if isinstance(error, FileLostError):  # of this file, not of the one before it
                raise OSError(f"{part} {error}") from error
            raise
        self._bag = bag
        self._counts.append(_Count())

    def flush(self) -> None:
        """Write everything to the disk and check the files; call it at least every half second.

        Raises:
            RecordingLostError: the file is no longer what was written.
            RecordingError: the disk fails.
        """
        with self._writing():
            self._bag.flush()
            self._counts[-1].flushed = self._counts[-1].written
        self._note_gone()

    def close(self, health: Mapping[str, str]) -> None:
        """Finish the current file with the counters ``health``, and write ``metadata.yaml``."""
        self._finish(health)
        self._note_gone()
        self._write_metadata()
        self.ended = f"the recording {self.path} is closed: start another"

    def _write_metadata(self) -> None:
        """Write ``metadata.yaml``; RecordingError says how to repair the run if that fails."""
        files = {finished.file.path.name: finished.tallies for finished in self._finished}
        try:
            write_metadata(self.path, split_metadata(files))
        except OSError as error:
            said = (
                f"can't write {self.path / METADATA_NAME} ({reason(error)}): the recording is "
                f"finished, {self.samples_kept} of {self.samples_written} samples are on the "
                f"disk; {remedy(error)} and run 'python -m herringbone_sim recover {self.path}'"
            )
            self.ended = said
            raise RecordingError(said) from error

    def _finish(self, health: Mapping[str, str]) -> None:
        """Flush, complete and close the current file."""
        self.flush()
        with self._writing():
            self._end(health)
            written = self._bag.stream.check()
            self._bag.stream.close()
        self._finished.append(_Finished(written, self._bag.tallies, self._counts[-1]))

    def _end(self, health: Mapping[str, str]) -> None:
        """Append the metadata record and the index, unless the file has them."""
        if not self._bag.complete:
            counts = {"samples_written": str(self._counts[-1].written)}
            self._bag.add_record(RECORD_NAME, {**health, **counts})
            self._bag.end()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Context manager in which a disk failure or a lost file ends the run with an error."""
        if self.ended:
            raise RecordingError(self.ended)
        try:
            yield
        except FileLostError as lost:
            raise self._lost(lost) from lost
        except OSError as error:
            with suppress(OSError):
                self._bag.abandon()
            failed = f"the recording {self.path} ended early ({reason(error)})"
            self.ended = f"{failed}: {remedy(error)} and start another"
            raise RecordingError(
                f"{failed}: {self.samples_kept} of {self.samples_written} samples were flushed to "
                f"the disk and stay readable; {remedy(error)}, run 'python -m herringbone_sim "
                f"recover {self.path}', and start another"
            ) from error

    def _lost(self, lost: FileLostError) -> RecordingLostError:
        """End the run after its current file was lost; return the error that says what is lost."""
        path, flushed = self._bag.stream.path, self._left(lost)
        lies = self._counts[-1].lose(flushed)
        left = f"; the rest is in {lost.where}" if lost.where else ""
        if lost.where and flushed == self._counts[-1].written:
            lies, left = f"nothing is lost, its {flushed} samples are in {lost.where}", ""
        said = f"{path} {lost}: {lies}{left}"
        self.losses += (said,)
        self._note_gone(Path(lost.where).parent if lost.where else None)
        self.ended = f"the recording {self.path} ended, as {path} {lost}: start another"
        return RecordingLostError(said)

    def _left(self, lost: FileLostError) -> int:
        """Close a lost file; return the number of its samples that can still be read."""
        if lost.where:
            with suppress(OSError):
                self._end({})
                self._bag.stream.close()
                return self._counts[-1].written
            with suppress(OSError):
                self._bag.abandon()
            return self._counts[-1].flushed
        self._bag.stream.close()
        return readable_samples(self._bag.stream.path, self._topics[1].name) if lost.cut else 0

    def _note_gone(self, moved: Path | None = None) -> None:
        """Add a loss for each finished file not intact in the run folder, nor in ``moved``."""
        places = [self.path] if moved is None else [self.path, moved]
        for finished in list(self._finished):
            faults = [finished.file.fault(place) for place in places]
            if all(faults):
                self._finished.remove(finished)
                self.losses += (f"{finished.file.path} {faults[0]}: {finished.count.lose(0)}",)


def readable_samples(file: Path, topic: str) -> int:
    """Count the samples of a topic that can still be read from a file."""
    n_samples = 0
    with suppress(RecordingError):
        for message in Scan(file).messages():
            if message.topic.name == topic:
                n_samples += len(decode_samples(message.message)[1])
    return n_samples
