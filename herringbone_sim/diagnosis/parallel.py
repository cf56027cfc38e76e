"""Map a function over items on all cores: in threads, or in processes forked for the map."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

A = TypeVar("A")
B = TypeVar("B")
# Longest wait [s] for the interpreter lock after a compiled call: a tenth of the time of a usual
# call. Python's default, 5 ms, is five such calls.
SWITCH_INTERVAL_S = 1e-4
TOKEN_BYTES = 4  # of the number of a job in a pipe
MAX_JOBS = 4096  # their numbers fill a quarter of what a pipe holds
_lock = threading.Lock()
_before: list[float] = []  # switch interval to restore, one entry for each map in progress
_in_processes = False  # whether a map in processes runs; maps inside it use one core


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def parallel_map(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """Apply ``function`` to every item, in one thread per core; results in the order of items.

    For work of NumPy and compiled kernels, which release the interpreter lock.
    """
    if _in_processes:
        return list(map(function, items))
    with _short_turns(), ThreadPoolExecutor(cores()) as threads:
        return list(threads.map(function, items))


def forked_map(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """Apply ``function`` to every item, in one process per core; results in the order of items.

    For work of the interpreter, of a tenth of a second at least. The other processes are forks of
    this one and end with the map: what ``function`` changes is lost there, and only its results,
    which must be picklable, come back. All work is done here where a fork may not be safe (in
    threads but the main one, on systems but Linux), and inside another such map.

    Raises:
        Exception: the first that ``function`` raised, by the order of items.
    """
    global _in_processes
    every = list(items)
    others = min(cores(), len(every)) - 1
    main = threading.current_thread() is threading.main_thread() and sys.platform == "linux"
    if others < 1 or not main or _in_processes:
        return list(map(function, every))
    jobs = min(len(every), MAX_JOBS)
    queue, tokens = os.pipe()
    os.write(tokens, b"".join(job.to_bytes(TOKEN_BYTES, "little") for job in range(jobs)))
    work = _Work(function, every, jobs, queue)
    _in_processes = True
    children: list[tuple[int, int]] = []
    try:
        for _ in range(others):
            children.append(_forked(work, tokens))
        os.close(tokens)
        done = work.outcomes()
        for _, results in children:
            done |= _received(results)
    finally:
        _in_processes = False
        os.close(queue)
        for process, results in children:
            os.close(results)
            os.kill(process, signal.SIGKILL)  # it has sent all, or this map was interrupted
            os.waitpid(process, 0)
    # What a process did not send, as it was killed, is done here.
    outcomes = [done[i] if i in done else work.outcome(i) for i in range(len(every))]
    for outcome in outcomes:
        if isinstance(outcome, _Failure):
            raise outcome.error
    return [outcome for outcome in outcomes if not isinstance(outcome, _Failure)]


class _Failure:
    """An exception that a function raised for an item."""

    def __init__(self, error: Exception) -> None:
        self.error = error


@dataclass(frozen=True)
class _Work(Generic[A, B]):
    """Items in jobs; a process takes a job by reading its number from the pipe ``queue``."""

    function: Callable[[A], B]
    items: Sequence[A]
    jobs: int
    queue: int

    def outcomes(self) -> dict[int, B | _Failure]:
        """Outcomes, by the number of the item, of the jobs that this process takes.

        A read takes one number or none, as pipes are read under a lock.
        """
        done = {}
        while token := os.read(self.queue, TOKEN_BYTES):
            for i in range(int.from_bytes(token, "little"), len(self.items), self.jobs):
                done[i] = self.outcome(i)
        return done

    def outcome(self, i: int) -> B | _Failure:
        """Result of the function for item i, or what it raised."""
        try:
            return self.function(self.items[i])
        except Exception as error:
            return _Failure(error)


def _forked(work: _Work[A, B], tokens: int) -> tuple[int, int]:
    """Fork a process that takes jobs; its id, and the pipe from which its outcomes come."""
    results, sent = os.pipe()
    process = os.fork()
    if process:
        os.close(sent)
        return process, results
    try:
        gc.freeze()  # a collection would write to, and so copy, all shared memory
        os.close(tokens)
        os.close(results)
        done = work.outcomes()
        with os.fdopen(sent, "wb") as pipe:
            pickle.dump(done, pipe, pickle.HIGHEST_PROTOCOL)
    except Exception:
        traceback.print_exc()
    finally:
        os._exit(0)


def _received(results: int) -> dict[int, Any]:
    """What a forked process sends; nothing if it was killed."""
    with os.fdopen(os.dup(results), "rb") as pipe:
        try:
            return dict(pickle.load(pipe))
        except (EOFError, pickle.UnpicklingError):
            return {}


@contextmanager
def _short_turns() -> Iterator[None]:
    """Set the thread switch interval to ``SWITCH_INTERVAL_S`` until the last open map ends."""
    with _lock:
        _before.append(_before[0] if _before else sys.getswitchinterval())
        sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        with _lock:
            before = _before.pop()
            if not _before:
                sys.setswitchinterval(before)
