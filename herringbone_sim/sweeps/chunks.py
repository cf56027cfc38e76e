"""Compute chunks of runs on threads, and cache the arrays of each chunk in a folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from tqdm import tqdm

from herringbone_sim.sweeps.array_cache import ArrayCache, Arrays


@dataclass(frozen=True)
class Chunk:
    """Runs that are computed and stored together.

    Attributes:
        key: all inputs that the arrays depend on, see ``array_cache.digest``.
        compute: returns the arrays by name, each with a row per run.
        runs: number of runs.
    """

    key: Sequence[Any]
    compute: Callable[[], Mapping[str, Any]]
    runs: int


@dataclass(frozen=True)
class ChunkRunner:
    """Computes chunks on threads, or reads those that are stored.

    Attributes:
        cache: where arrays are stored.
        workers: number of threads.
        bar: counts the runs, or None; its total grows by those that are asked for.
    """

    cache: ArrayCache
    workers: int
    bar: tqdm | None

    def arrays(self, jobs: Sequence[Sequence[Chunk]]) -> list[Arrays]:
        """Arrays of each job by name, the rows of its chunks joined; jobs run side by side."""
        every = list(chain.from_iterable(jobs))
        if self.bar is not None:
            self.bar.total += sum(chunk.runs for chunk in every)
            self.bar.refresh()
        with ThreadPoolExecutor(self.workers) as pool:
            results = pool.map(lambda chunk: self.cache.get(chunk.key, chunk.compute), every)
            parts = [[self._counted(next(results), chunk) for chunk in job] for job in jobs]
        return [
            {name: np.concatenate([part[name] for part in job]) for name in job[0]}
            for job in parts
        ]

    def _counted(self, arrays: Arrays, chunk: Chunk) -> Arrays:
        if self.bar is not None:
            self.bar.update(chunk.runs)
        return arrays
