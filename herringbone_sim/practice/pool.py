"""Executor of processes that share the cores of this machine, or a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

from herringbone_sim.diagnosis.parallel import cores, limit_cores
from herringbone_sim.sweeps.cluster import cluster

THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


@dataclass(frozen=True)
class Resources:
    """Where to compute.

    Attributes:
        workers: processes on this machine, which share its cores.
        scheduler: address of a Dask scheduler to run on instead; None for this machine.
    """

    workers: int = 2
    scheduler: str | None = None


LOCAL = Resources()


@contextmanager
def pool(workers: int, scheduler: str | None = None) -> Iterator[tuple[Executor, int]]:
    """Context that gives an executor and how many tasks it runs at once, and ends it at exit.

    Processes are spawned, because libraries read the number of threads only at start.

    Raises:
        AnalysisError: no scheduler answers, it has no workers, or Dask is not installed.
    """
    if scheduler is not None:
        with cluster(scheduler) as remote:
            yield remote
        return
    with _single_threads():
        context = multiprocessing.get_context("spawn")
        each = max(1, cores() // workers)
        with ProcessPoolExecutor(workers, context, _begin_worker, (each,)) as processes:
            yield processes, workers


def _begin_worker(most: int) -> None:
    """Keep a worker to so many cores, and let it end with its parent and quietly on Ctrl-C."""
    limit_cores(most)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Exit the process when its parent has ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _single_threads() -> Iterator[None]:
    """Context in which the environment limits numerical libraries to one thread."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
