"""Run what is missing of sweeps, over the cores of this machine or on a Dask cluster.

Parts are computed anywhere and written here, each as soon as it is done, so a run that is cut off
loses only the parts under way. What a part holds does not depend on who computes it.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.chains import last_states, observe_part, part_before
from herringbone_sim.sweeps.observe import Table
from herringbone_sim.sweeps.store import Store

Array = NDArray[np.float64]
Task = tuple[Store, int, Array | None]

AHEAD = 2  # parts under way for each core: one computed, one waiting
RETRIES = 10
PATIENCE_S = 60


def run_stores(
    stores: Sequence[Store], workers: int | None = None, scheduler: str | None = None
) -> None:
    """Compute and write every part that is missing.

    Ctrl-C ends it after the parts under way; what was written stays, and the next call goes on.

    Args:
        stores: sweeps that run side by side.
        workers: threads of this process; the number of cores by default.
        scheduler: address of a Dask scheduler to run on instead.

    Raises:
        AnalysisError: no scheduler there, or no Dask.
    """
    values = sum(store.sweep.size for store in stores)
    lacking = {id(store): store.missing() for store in stores}
    to_do = sum(len(s.sweep.part(n)) for s in stores for n in lacking[id(s)])
    if not to_do:
        return
    waiting = deque(task for store in stores for task in _ready(store, lacking[id(store)]))
    with (
        _pool(workers, scheduler) as (pool, cores),
        tqdm(
            total=values, initial=values - to_do, unit="value", disable=None, smoothing=0.05
        ) as bar,
    ):
        for store, part, table in _completed(pool, waiting, AHEAD * cores):
            store.write(part, table)
            bar.update(len(store.sweep.part(part)))
            waiting.extend(_next(store, part, table))


def _ready(store: Store, missing: Sequence[int]) -> Iterator[Task]:
    """Parts that can be computed now: all, or of chains the first whose forerunner is there."""
    if not store.sweep.chained:
        yield from ((store, part, None) for part in missing)
        return
    part = missing[-1 if store.sweep.downwards else 0] if missing else None
    if part is not None:
        before = part_before(store.sweep, part)
        table = None if before is None else store.read_part(before)
        yield store, part, None if table is None else last_states(store.sweep, table)


def _next(store: Store, part: int, table: Table) -> Iterator[Task]:
    """The part of a chain that goes on from one that is done."""
    following = part - 1 if store.sweep.downwards else part + 1
    if store.sweep.chained and 0 <= following < store.sweep.n_parts:
        if store.has(following):
            yield from _next(store, following, store.read_part(following))
        else:
            yield store, following, last_states(store.sweep, table)


def _completed(
    pool: Executor, waiting: deque[Task], most: int
) -> Iterator[tuple[Store, int, Table]]:
    """Results in the order in which they come, at most so many parts under way."""
    running: dict[Future[Table], Task] = {}
    try:
        while waiting or running:
            while waiting and len(running) < most:
                store, part, before = task = waiting.popleft()
                running[pool.submit(observe_part, store.sweep, part, before)] = task
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                store, part, _ = running.pop(future)
                yield store, part, future.result()
    finally:
        for future in running:
            future.cancel()


@contextmanager
def _pool(workers: int | None, scheduler: str | None) -> Iterator[tuple[Executor, int]]:
    """An executor and the number of its cores."""
    if scheduler is not None:
        with _cluster(scheduler) as pool:
            yield pool
        return
    cores = workers or os.cpu_count() or 1
    with ThreadPoolExecutor(cores) as threads:
        yield threads, cores


@contextmanager
def _cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """The same on a Dask cluster; work of a worker that dies is given to another."""
    try:
        from distributed import Client
    except ImportError:
        raise AnalysisError(
            'a scheduler needs Dask: type pip install "dask[distributed]"'
        ) from None
    try:
        connect: Any = Client
        client = connect(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise AnalysisError(
            f"no Dask scheduler answers at {address!r} ({error}): give its address, such as "
            "tcp://HOST:8786"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE_S)
        except TimeoutError:
            raise AnalysisError(
                f"the Dask scheduler at {address} has no workers: start some with dask worker"
            ) from None
        cores = sum(client.nthreads().values())
        yield client.get_executor(pure=False, retries=RETRIES), cores
