"""Parallel map over runs in threads: NumPy and compiled kernels release the interpreter lock."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")
# Longest wait [s] for the interpreter lock after a compiled call: a tenth of the time of a usual
# call. Python's default, 5 ms, is five such calls.
SWITCH_INTERVAL_S = 1e-4
_lock = threading.Lock()
_before: list[float] = []  # switch interval to restore, one entry for each map in progress


def parallel_map(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """Apply ``function`` to every item, in one thread per core; results in the order of items."""
    with _short_turns(), ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        return list(threads.map(function, items))


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
