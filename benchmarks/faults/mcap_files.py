"""MCAP files spoilt by chance and by design, given to every verb that reads recordings."""

from __future__ import annotations

import atexit
import os
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import yaml
from mcap.writer import CompressionType

from benchmarks.faults.runs import copied, motion, of_rig, simulated
from benchmarks.faults.spoil import SPOILS
from benchmarks.faults.texts import hostile_channels
from benchmarks.faults.trial import Trial
from benchmarks.faults.verbs import Attempt, Verbs
from herringbone_sim.errors import HerringboneError
from herringbone_sim.recording.reader import read_recording

# Each trial prints a page; a value that is printed whole is larger by orders of magnitude.
MOST_PRINTED = 20_000
# Figures take seconds, so not every trial draws them.
ANALYSED = 50


def _rig(compression: CompressionType, folder: Path) -> Path:
    return of_rig(folder / "rig", compression)


def _split(folder: Path) -> Path:
    return simulated(folder, split=True)


# Runs whose samples lie in chunks with checksums, so a value that is altered can be told.
RUNS: tuple[Callable[[Path], Path], ...] = (
    simulated,
    _split,
    *(partial(_rig, compression) for compression in CompressionType),
)


@lru_cache(maxsize=1)
def _verbs() -> Verbs:
    verbs = Verbs()
    atexit.register(verbs.__exit__)
    return verbs


def mcap(seed: int, folder: Path) -> Trial:
    """Spoil a run, read it by every verb, and compare what comes out."""
    rng = np.random.default_rng(seed)
    victim = folder / "victim.mcap"
    victim.write_bytes(b"precious")
    kind, spoilt = _spoilt(seed, rng, folder)
    tried = [
        _verbs()(["info", spoilt]),
        _verbs()(["recover", spoilt, "--out", folder / "whole"]),
        _verbs()(["replay", spoilt, "--verify"]),
    ]
    if seed % ANALYSED == 0:
        tried.append(_verbs()(["analyze", spoilt, "--out", folder / "analysis"]))
    else:
        tried.append(_verbs()(["recover", spoilt]))
    altered = sum(_altered(path) for path in (spoilt, folder / "whole") if path.exists())
    return Trial(
        f"{kind}, seed {seed}",
        seconds=max(one.seconds for one in tried),
        peak_bytes=max(one.peak_bytes for one in tried),
        traceback=next((one.traceback for one in tried if one.traceback), ""),
        altered=altered,
        broken=tuple(_broken(tried, victim)),
    )


def _spoilt(seed: int, rng: np.random.Generator, folder: Path) -> tuple[str, Path]:
    """What was done, and the run it was done to."""
    kinds = [*SPOILS, _channels, _names]
    spoil = kinds[seed % len(kinds)]
    if spoil is _channels:
        texts = hostile_channels()
        number = seed // len(kinds) % len(texts)
        run = of_rig(folder / "rig", CompressionType.LZ4, channels=texts[number])
        return f"channels {number}", run
    run = copied(RUNS[seed // len(kinds) % len(RUNS)], folder)
    if spoil is _names:
        return f"names {_names(run, rng)}", run
    file = sorted(run.glob("*.mcap"))[-1]
    file.write_bytes(spoil(file.read_bytes(), rng))
    return spoil.__name__, run


def _channels() -> None:
    """Stands for a run whose channels message is hostile."""


def _names(run: Path, rng: np.random.Generator) -> str:
    """Files that lead out of the folder, or are none; gives what was done."""
    odd = ["../victim.mcap", str(run.parent / "victim.mcap"), "n" * 300, "a\0b.mcap", ".", "link"]
    (run / "link").symlink_to(run.parent / "victim.mcap")
    name = odd[rng.integers(len(odd))]
    content = {"message_count": 1, "relative_file_paths": [name], "compression_mode": None}
    (run / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": content}))
    file = next(iter(run.glob("*.mcap")))
    beside = int(rng.integers(4))
    if beside == 1:
        file.unlink()
        os.mkfifo(file)
    elif beside == 2:
        file.unlink()
        file.symlink_to(file)
    elif beside == 3:
        file.unlink()
        file.symlink_to(run.parent / "victim.mcap")
    return f"{name[:20]!r}, {['whole', 'pipe', 'loop', 'leads out'][beside]}"


def _altered(run: Path) -> int:
    """Samples that are read and were never written."""
    try:
        recording = read_recording(run, cut_at_jump=True)
    except HerringboneError:
        return 0
    names, rows, _ = motion()
    if recording.samples.names != names:
        return len(recording.samples)
    written = {row.tobytes() for row in rows}
    return sum(row.tobytes() not in written for row in recording.samples.data)


def _broken(tried: list[Attempt], victim: Path) -> list[str]:
    broken = [f"printed {one.printed} bytes" for one in tried if one.printed > MOST_PRINTED]
    if victim.read_bytes() != b"precious":
        broken.append("a file outside of the folder was changed")
    return broken + [f"exit code {one.code}" for one in tried if one.code not in (0, 1, 2)]
