"""A disk that fails while it is recorded to: full, cut writes, errors of fsync."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.faults.trial import Trial
from benchmarks.faults.writing import rows_of, seconds_of, write_run
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.recover import recover
from herringbone_sim.recording.writer import RunWriter

FAULTS = ("full at write", "cut short, full at write", "write in pieces", "EIO at fsync")
CALLS = 40  # a short recording makes some more than so many of each kind


class BadDisk:
    """Fails from the n-th call of one kind on; ``write in pieces`` takes a few bytes each time."""

    def __init__(self, fault: str, n: int) -> None:
        self.fault, self.left = fault, n
        self.sound_write, self.sound_sync = os.write, os.fsync

    def write(self, handle: int, content: Any) -> int:
        if "write" not in self.fault:
            return self.sound_write(handle, content)
        self.left -= 1
        if self.fault == "write in pieces" and self.left < 0:
            return self.sound_write(handle, memoryview(content)[: max(len(content) // 3, 1)])
        if self.fault.startswith("cut short") and self.left == 0:
            return self.sound_write(handle, memoryview(content)[: len(content) // 2])
        if self.left < 0 or (self.left == 0 and self.fault == "full at write"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self.sound_write(handle, content)

    def sync(self, handle: int) -> None:
        if "fsync" in self.fault:
            self.left -= 1
            if self.left < 0:
                raise OSError(errno.EIO, os.strerror(errno.EIO))
        self.sound_sync(handle)


@contextmanager
def bad_disk(fault: str, n: int) -> Iterator[None]:
    """``os.write`` and ``os.fsync`` of a disk that fails at the n-th call of the kind."""
    disk = BadDisk(fault, n)
    os.write, os.fsync = disk.write, disk.sync  # type: ignore[assignment]
    try:
        yield
    finally:
        os.write, os.fsync = disk.sound_write, disk.sound_sync


def disk(seed: int, folder: Path) -> Trial:
    """Record to a disk that fails; hold what is said against what can be read and recovered."""
    fault, n = FAULTS[seed % len(FAULTS)], seed // len(FAULTS) % CALLS
    said, run, handed, kept = "", folder / "run", 0, 0

    def note(writer: RunWriter, samples: int) -> None:
        nonlocal handed, kept
        handed, kept = samples, writer.samples_kept

    with bad_disk(fault, n):
        try:
            done = write_run(folder, note)
            handed = kept = done.samples_kept
        except RecordingError as error:
            said = str(error)
    found = list(_broken(run, said, kept))
    read = _samples(run)
    altered = int((read != rows_of(0, len(read))).sum())
    lost_s = seconds_of(max(handed - len(read), 0))
    return Trial(f"{fault} {n}", lost_s=lost_s, altered=altered, broken=tuple(found))


def _broken(run: Path, said: str, kept: int) -> Iterator[str]:
    if said and "space left" not in said and "Input/output" not in said:
        yield f"the error does not say what the disk did: {said}"
    if said and not kept:
        return
    before = _samples(run)
    if len(before) < kept:
        yield f"{kept} samples were told as kept, {len(before)} can be read"
    recover(run)
    recording = read_recording(run)
    if not recording.complete or len(recording.samples) != len(before):
        yield f"recovered to {len(recording.samples)} of {len(before)} samples"


def _samples(run: Path) -> np.ndarray:
    """Samples (n, 7) that can be read; none where the recording never began."""
    try:
        return read_recording(run).samples.data
    except RecordingError:
        return np.empty((0, 7))
