"""Files of a recording that others delete, cut, replace or move while it is written."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.faults.trial import Trial
from benchmarks.faults.writing import (
    BLOCK,
    BLOCKS,
    FLUSH_BLOCKS,
    RATE_HZ,
    rows_of,
    seconds_of,
    write_run,
)
from herringbone_sim.errors import RecordingError, RecordingLostError
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.writer import RunWriter

Rng = np.random.Generator


def _file(run: Path, rng: Rng) -> Path:
    return Path(rng.choice(sorted(str(file) for file in run.glob("*.mcap"))))


def unlink(run: Path, rng: Rng) -> None:
    _file(run, rng).unlink()


def cut(run: Path, rng: Rng) -> None:
    file = _file(run, rng)
    os.truncate(file, int(rng.integers(file.stat().st_size)))


def replace(run: Path, rng: Rng) -> None:
    file = _file(run, rng)
    other = file.with_name("other")
    other.write_bytes(rng.bytes(file.stat().st_size))
    other.replace(file)


def copy_over(run: Path, rng: Rng) -> None:
    """As an editor or rsync does: the same content, another file."""
    file = _file(run, rng)
    other = file.with_name("other")
    shutil.copy(file, other)
    other.replace(file)


def append(run: Path, rng: Rng) -> None:
    with _file(run, rng).open("ab") as file:
        file.write(rng.bytes(100))


def remove_folder(run: Path, rng: Rng) -> None:
    del rng
    shutil.rmtree(run)


def move_folder(run: Path, rng: Rng) -> None:
    del rng
    run.rename(run.with_name("moved"))


def replace_folder(run: Path, rng: Rng) -> None:
    del rng
    shutil.copytree(run, run.with_name("copy"))
    shutil.rmtree(run)
    run.with_name("copy").rename(run)


FAULTS: tuple[Callable[[Path, Rng], None], ...] = (
    *(unlink, cut, replace, copy_over, append),
    *(remove_folder, move_folder, replace_folder),
)


def vanish(seed: int, folder: Path) -> Trial:
    """Do it at a random block; it must be told by the next flush, with numbers that hold."""
    rng = np.random.default_rng(seed)
    fault, at = FAULTS[seed % len(FAULTS)], int(rng.integers(1, BLOCKS)) * BLOCK
    told_at, last = BLOCK * BLOCKS, list[RunWriter]()

    def note(writer: RunWriter, handed: int) -> None:
        nonlocal told_at
        last[:] = [writer]
        if handed == at:
            fault(writer.path, rng)
        if writer.losses:
            told_at = min(told_at, handed)

    try:
        write_run(folder, note)
    except RecordingLostError:
        told_at = min(told_at, last[0].samples_written)
    (writer,) = last
    lost_s = seconds_of(max(told_at - at, 0))
    broken = []
    if not writer.losses:
        broken.append("nothing was told")
    if told_at - at > FLUSH_BLOCKS * BLOCK:
        broken.append(f"told {told_at - at} samples later")
    left = sum(_readable(path) for path in (folder / "run", folder / "moved") if path.exists())
    if fault in (unlink, remove_folder, move_folder) and left != writer.samples_kept:
        broken.append(f"{writer.samples_kept} samples told as kept, {left} can be read")
    return Trial(f"{fault.__name__} at {at}", lost_s=lost_s, broken=tuple(broken))


def _readable(run: Path) -> int:
    """Samples that can be read in a folder, all of them as they were written."""
    try:
        data = read_recording(run).samples.data
    except RecordingError:
        return 0
    index = np.round(data[:, 0] * RATE_HZ).astype(int)
    return len(data) if (data == rows_of(0, BLOCK * BLOCKS)[index]).all() else -1
