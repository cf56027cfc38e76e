"""Compute the missing parts of sweeps, on the cores of this machine or on a Dask cluster.

Workers compute parts and this process writes each part when it is complete, so that an
interruption loses only the parts in progress. The content of a part does not depend on the
worker.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any

from tqdm import tqdm

from herringbone_sim.core.lanes.vector import LANES
from herringbone_sim.sweeps.array_cache import print_above_bar
from herringbone_sim.sweeps.chains import (
    Job,
    job_of,
    last_states,
    observe_parts,
    part_before,
)
from herringbone_sim.sweeps.cluster import cluster, completed
from herringbone_sim.sweeps.observe import Table
from herringbone_sim.sweeps.store import Store

Entry = tuple[Store, Job]
Task = tuple[Entry, ...]


def run_stores(
    stores: Sequence[Store], workers: int | None = None, scheduler: str | None = None
) -> None:
    """Compute and write every missing part of some sweeps.

    Ctrl-C ends it after the parts in progress; stored parts stay, and the next call computes the
    rest. Damaged parts are named on stderr and computed again.

    Args:
        stores: sweeps that are computed side by side.
        workers: threads of this process; the number of cores by default.
        scheduler: address of a Dask scheduler to use instead of threads.

    Raises:
        AnalysisError: no scheduler answers there, or Dask is not installed.
    """
    values = sum(store.sweep.size for store in stores)
    lacking = [store.missing() for store in stores]
    for store, parts in zip(stores, lacking, strict=True):
        _report_damaged(store, parts)
    to_do = sum(
        len(s.sweep.part(n)) for s, parts in zip(stores, lacking, strict=True) for n in parts
    )
    if not to_do:
        return
    first = [job for pair in zip(stores, lacking, strict=True) for job in _ready(*pair)]
    waiting = deque(_tasks(first))
    look: dict[str, Any] = {"unit": "value", "disable": None, "smoothing": 0.05}
    with (
        _pool(workers, scheduler) as (pool, cores),
        tqdm(total=values, initial=values - to_do, **look) as bar,
    ):
        for task, tables in completed(partial(_submit, pool), waiting, cores):
            following: list[Entry] = []
            for (store, job), table in zip(task, tables, strict=True):
                store.write(job.part, table)
                bar.update(len(table["index"]))
                following.extend(_next(store, job.part, table))
            waiting.extendleft(_tasks(following))


def _report_damaged(store: Store, lacking: Sequence[int]) -> None:
    """Print on stderr which of the parts to be computed have a file already: it is damaged.

    Args:
        store: parts of one sweep.
        lacking: numbers of the parts that are missing or damaged, from ``store.missing``.
    """
    paths = [store.path(part) for part in lacking]
    names = [path.name for path in paths if path.exists()]
    if names:
        print_above_bar(
            f"{store.folder / 'parts'}: {', '.join(names)} can't be believed (damaged, or written "
            "without a checksum by an earlier version): computed again"
        )


def _ready(store: Store, missing: Sequence[int]) -> Iterator[Entry]:
    """Yield jobs that can start now: all missing parts, or only the first of a chained sweep."""
    sweep = store.sweep
    if not sweep.chained:
        yield from ((store, job_of(sweep, part)) for part in missing)
    elif missing:
        part = missing[-1 if sweep.downwards else 0]
        before = part_before(sweep, part)
        table = None if before is None else store.read_part(before)
        states = None if table is None else last_states(sweep, table)
        yield store, job_of(sweep, part, states)


def _next(store: Store, part: int, table: Table) -> Iterator[Entry]:
    """Yield the job that continues a chain behind a completed part, skipping stored parts."""
    sweep, step = store.sweep, -1 if store.sweep.downwards else 1
    while sweep.chained and 0 <= part + step < sweep.n_parts:
        part += step
        there = store.read_part(part)
        if there is None:
            yield store, job_of(sweep, part, last_states(sweep, table))
            return
        table = there


def _tasks(entries: Sequence[Entry]) -> Iterator[Task]:
    """Yield tasks of one job each; compatible chains too narrow to fill the lanes are grouped."""
    compatible: dict[object, list[Entry]] = {}
    for store, job in entries:
        sweep = store.sweep
        if sweep.chained and not sweep.ramped and sweep.width < LANES:
            base = sweep.base
            kind = (base.layout, base.order, base.method, sweep.observation, sweep.effects)
            compatible.setdefault(kind, []).append((store, job))
        else:
            yield ((store, job),)
    yield from (tuple(together) for together in compatible.values())


def _submit(pool: Executor, task: Task) -> Future[list[Table]]:
    return pool.submit(observe_parts, [job for _, job in task])


@contextmanager
def _pool(workers: int | None, scheduler: str | None) -> Iterator[tuple[Executor, int]]:
    """Context with an executor, of threads or of a Dask cluster, and its number of cores."""
    if scheduler is not None:
        with cluster(scheduler) as pool:
            yield pool
        return
    cores = workers or os.cpu_count() or 1
    with ThreadPoolExecutor(cores) as threads:
        yield threads, cores
