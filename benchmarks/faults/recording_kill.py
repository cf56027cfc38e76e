"""SIGKILL before, within and after every call with which a recording changes a file."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

import numpy as np

from benchmarks.faults.recovery import killed_at
from benchmarks.faults.trial import Trial
from benchmarks.faults.writing import BLOCK, rows_of, seconds_of, write_run
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.recover import recover
from herringbone_sim.recording.writer import RunWriter

_PROGRESS = struct.Struct("<qq")


def recording_kill(seed: int, folder: Path) -> Trial:
    """Each call in turn, before and after it; the fault is empty where there is no such call."""
    number, after = divmod(seed, 2)
    with mmap.mmap(-1, _PROGRESS.size) as shared:

        def note(writer: RunWriter, handed: int) -> None:
            shared[:] = _PROGRESS.pack(handed + BLOCK, writer.samples_kept)

        reached = killed_at(number, bool(after), lambda: write_run(folder, note) and None)
        handed, kept = _PROGRESS.unpack(shared[:])
    read, broken = _recovered(folder / "run")
    if len(read) < kept:
        broken.append(f"{kept} samples were flushed, {len(read)} came back")
    altered = int((read != rows_of(0, len(read))).sum())
    fault = f"killed {'after' if after else 'before'} call {number}" if reached else ""
    lost_s = seconds_of(max(handed - len(read), 0))
    return Trial(fault, lost_s=lost_s, altered=altered, broken=tuple(broken))


def _recovered(run: Path) -> tuple[np.ndarray, list[str]]:
    """Samples (n, 7) after a recovery, and what is wrong with it."""
    try:
        before = read_recording(run).samples.data
    except RecordingError:
        return np.empty((0, 7)), []
    recover(run)
    recording, broken = read_recording(run), []
    if not np.array_equal(recording.samples.data, before):
        broken.append("the recovery altered the samples")
    if not recording.complete or recover(run).changed:
        broken.append("it is not recovered at once")
    if list(run.glob("*.part")):
        broken.append("a half file was left")
    return recording.samples.data, broken
