"""Processes that compute on one thread each, or a Dask cluster, as an executor."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

from herringbone_sim.sweeps.cluster import cluster

THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


@contextmanager
def pool(workers: int, scheduler: str | None = None) -> Iterator[tuple[Executor, int]]:
    """An executor and the number of its cores.

    Processes are started afresh: only so do their libraries heed the number of threads.

    Raises:
        AnalysisError: no scheduler there, no workers, or no Dask.
    """
    if scheduler is not None:
        with cluster(scheduler) as found:
            yield found
        return
    with _single_threads():
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, context, _end_quietly) as processes:
            yield processes, workers


def _end_quietly() -> None:
    """Ctrl-C reaches every process of a terminal: a worker just ends, what it did is not kept."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def _single_threads() -> Iterator[None]:
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
