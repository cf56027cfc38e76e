"""SIGKILL before and after every call with which a recovery changes a file."""

from __future__ import annotations

import builtins
import io
import os
import signal
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.faults.runs import copied, cut_run, split_run
from benchmarks.faults.trial import Trial
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.recover import recover

CALLS = (
    *("write", "fsync", "ftruncate", "link", "rename", "replace"),
    *("unlink", "remove", "mkdir", "rmdir"),
)


def _one(run: Path) -> None:
    recover(run)


def _without_links(run: Path) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise PermissionError("no links here")

    os.link = refuse
    recover(run)


def _elsewhere(run: Path) -> None:
    recover(run, run.with_name("out"))


# How a recovery is done: of what run, by what call.
WAYS: tuple[tuple[str, Callable[[Path], Path], Callable[[Path], None]], ...] = (
    ("in place", cut_run, _one),
    ("several files", split_run, _one),
    ("no links", cut_run, _without_links),
    ("elsewhere", split_run, _elsewhere),
)


def killed_at(n: int, after: bool, work: Callable[[], None]) -> bool:
    """Do the work in a child that is killed at its n-th call; whether it got that far."""
    child = os.fork()
    if child == 0:
        try:
            _watch(n, after)
            work()
        finally:
            os._exit(0)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status)


def _watch(n: int, after: bool) -> None:
    """Kill this process at its n-th call that changes a file."""
    calls = count()

    def watched(call: Callable[..., Any], name: str) -> Callable[..., Any]:
        def guarded(*args: Any, **kwargs: Any) -> Any:
            if name == "open" and not set("wax+") & set(str(_mode(args, kwargs))):
                return call(*args, **kwargs)
            mine = next(calls) == n
            if mine and not after:
                os.kill(os.getpid(), signal.SIGKILL)
            if mine and name == "write":
                args = (args[0], bytes(args[1])[: (len(args[1]) + 1) // 2])
            try:
                return call(*args, **kwargs)
            finally:
                if mine:
                    os.kill(os.getpid(), signal.SIGKILL)

        return guarded

    for name in CALLS:
        setattr(os, name, watched(getattr(os, name), name))
    builtins.open = io.open = watched(io.open, "open")


def _mode(args: tuple[Any, ...], kwargs: dict[str, Any]) -> object:
    return kwargs.get("mode", args[1] if len(args) > 1 else "r")


def recover_kill(seed: int, folder: Path) -> Trial:
    """The ways in turn, each call in turn, before and after it."""
    name, make, work = WAYS[seed % len(WAYS)]
    number, after = divmod(seed // len(WAYS), 2)
    run = copied(make, folder)
    whole = read_recording(run).samples.data
    reached = killed_at(number, bool(after), lambda: work(run))
    fault = f"killed {'after' if after else 'before'} call {number}, {name}"
    return Trial(fault if reached else "", broken=tuple(_faults(run, work, whole)))


def _faults(run: Path, work: Callable[[Path], None], whole: np.ndarray) -> list[str]:
    """What is wrong with a run whose recovery was killed; then recovers it once more."""
    found = []
    if not np.array_equal(read_recording(run).samples.data, whole):
        found.append("the samples can't be read before it is recovered again")
    out = run.with_name("out")
    if work is not _elsewhere:
        recover(run)
    elif not out.exists():
        recover(run, out)
    good = out if work is _elsewhere else run
    recording = read_recording(good)
    if not np.array_equal(recording.samples.data, whole) or not recording.complete:
        found.append("the samples did not come out whole")
    if recover(good).changed:
        found.append("it is not recovered at once")
    left = {file.suffix for file in (*good.iterdir(), *good.parent.iterdir()) if file.is_file()}
    if ".part" in left or good.with_name(f"{good.name}.part").exists():
        found.append("a half file was left")
    return found
