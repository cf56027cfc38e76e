"""Parallel map over runs; NumPy and compiled kernels release the GIL."""

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
# Longest time [s] that a thread back from a compiled call waits for the interpreter: a tenth of
# such a call (Python's own is five of them).
SWITCH_INTERVAL_S = 1e-4
_lock = threading.Lock()
_before: list[float] = []  # interval to restore, once for each map that runs


def parallel_map(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """Apply ``function`` to every item in one thread per core; results in the order of items."""
    with _short_turns(), ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        return list(threads.map(function, items))


@contextmanager
def _short_turns() -> Iterator[None]:
    """Let threads take turns every ``SWITCH_INTERVAL_S``."""
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
