"""Map a function over items on all cores: in threads, or in processes forked for the map."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

A = TypeVar("A")
B = TypeVar("B")
# Longest wait [s] for the interpreter lock after a compiled call: a tenth of the time of a usual
# call. Python's default, 5 ms, is five such calls.
SWITCH_INTERVAL_S = 1e-4
TOKEN_BYTES = 4  # of the number of a job in a pipe
MAX_JOBS = 1024  # their numbers fill a page, the smallest pipe
_lock = threading.Lock()
_before: list[float] = []  # switch interval to restore, one entry for each map in progress
_in_processes = False  # whether a map in processes runs; maps inside it use one core
_most_cores = sys.maxsize  # see ``limit_cores``


def limit_cores(most: int) -> None:
    """Let the maps of this process use at most so many cores."""
    global _most_cores
    _most_cores = most


def cores() -> int:
    """Number of cores that the maps of this process may use."""
    there = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
    return min(there, _most_cores)


def parallel_map(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """Apply ``function`` to every item, in one thread per core; results in the order of items.

    For work of NumPy and compiled kernels, which release the interpreter lock. Inside a map in
    processes, which uses all cores already, there are no further threads.
    """
    if _in_processes or cores() == 1:
        return list(map(function, items))
    with _short_turns(), ThreadPoolExecutor(cores()) as threads:
        return list(threads.map(function, items))


def forked_map(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """Apply ``function`` to every item, in one process per core; results in the order of items.

    For work of the interpreter, of a tenth of a second at least. The other processes are forks of
    this one and end with the map: what ``function`` changes is lost there, and only its results
    come back. What they do not send, as ``function`` raised, its result can't be pickled, or they
    were killed, is done here.

    All work is done here off the main thread, on systems but Linux, and inside another such map.

    Raises:
        Exception: what ``function`` raised for an item.
    """
    global _in_processes
    every = list(items)
    others = min(cores(), len(every)) - 1
    main = threading.current_thread() is threading.main_thread() and sys.platform == "linux"
    if others < 1 or not main or _in_processes:
        return list(map(function, every))
    work = _Work(function, every, min(len(every), MAX_JOBS))
    queue, tokens = os.pipe()
    children: list[tuple[int, int]] = []
    _in_processes = True
    try:
        try:
            os.write(tokens, b"".join(i.to_bytes(TOKEN_BYTES, "little") for i in range(work.jobs)))
            for _ in range(others):
                children.append(_forked(work, queue, tokens))
        except OSError:
            pass  # no more processes: those that there are do the work
        finally:
            os.close(tokens)
        done = dict(work.done(queue))
        for _, results in children:
            done |= _received(results)
        return [done[i] if i in done else function(item) for i, item in enumerate(every)]
    finally:
        _in_processes = False
        os.close(queue)
        for process, results in children:
            os.close(results)
            with suppress(ProcessLookupError, ChildProcessError):
                os.kill(process, signal.SIGKILL)  # it has sent all, or this map was interrupted
                os.waitpid(process, 0)


@dataclass(frozen=True)
class _Work(Generic[A, B]):
    """Items in jobs; a process takes a job by reading its number from a pipe."""

    function: Callable[[A], B]
    items: Sequence[A]
    jobs: int

    def done(self, queue: int) -> Iterator[tuple[int, B]]:
        """Yield numbers and results of the items of the jobs that this process takes.

        A read takes one number or none, as pipes are read under a lock.
        """
        while token := os.read(queue, TOKEN_BYTES):
            for i in range(int.from_bytes(token, "little"), len(self.items), self.jobs):
                yield i, self.function(self.items[i])

    def done_for(self, parent: int, queue: int) -> dict[int, B]:
        """Results in a process forked for it, while its parent lives; without what raised."""
        done: dict[int, B] = {}
        while os.getppid() == parent:
            try:
                for i, result in self.done(queue):
                    done[i] = result
                    if os.getppid() != parent:
                        break
                return done
            except Exception:  # the parent does this job, and raises
                continue
        return done


def _forked(work: _Work[A, B], queue: int, tokens: int) -> tuple[int, int]:
    """Fork a process that takes jobs; its id, and the pipe from which its results come."""
    results, sent = os.pipe()
    here = os.getpid()
    try:
        process = os.fork()
        if os.getpid() != here:
            gc.freeze()  # a collection would write to, and so copy, what it looks at
            os.close(tokens)
            os.close(results)
            done = work.done_for(here, queue)
            with os.fdopen(sent, "wb") as pipe:
                pickle.dump(done, pipe, pickle.HIGHEST_PROTOCOL)
    except OSError:
        os.close(results)
        raise
    finally:
        if os.getpid() != here:
            os._exit(0)
        os.close(sent)
    return process, results


def _received(results: int) -> dict[int, Any]:
    """What a forked process sends; nothing if it was killed, or if that can't be unpickled."""
    with os.fdopen(os.dup(results), "rb") as pipe:
        try:
            return dict(pickle.load(pipe))
        except Exception:
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
